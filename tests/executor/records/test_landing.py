"""The landing as the executor records it, from what a simulated controller reports."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from executor.records import place_bin, wait_for_landing
from executor.robot import simulator_client
from planner.cell import load_cell
from planner.problem import ThrowProblem
from planner.request import problem_from_request
from tests.executor.conftest import CELLS

TARGET_M = [1.2, 0.3, 0.1]
RELEASE = {"object": 3, "t": 7.0, "position_m": [0.5, 0.1, 0.9], "velocity_m_s": [1.0, 0.2, 0.0]}
FALL_S = np.sqrt(2.0 * 0.8 / 9.81)  # [s] from the release to the target's plane
THROUGH_M = [0.5 + 1.0 * FALL_S, 0.1 + 0.2 * FALL_S, 0.1]


def problem(opening: dict[str, float] | None = None) -> ThrowProblem:
    """Returns a throw to TARGET_M, into a bin if there is an opening."""
    release = {"kind": "target", "position": TARGET_M, **({} if opening is None else {"opening": opening})}
    return problem_from_request({"release": release}, load_cell(CELLS / "ur5e-sim.toml"))


class ControlPort:
    """Stands in for the simulator's control port: keeps the requests, answers with one release and `landings`."""

    def __init__(self) -> None:
        self.requests: list[dict[str, Any]] = []
        self.landings: list[dict[str, Any]] = []

    def request(self, host: str, op: str, **parameters: Any) -> dict[str, Any]:
        """Answers as `simulator_client.request` does."""
        self.requests.append({"op": op, **parameters})
        return {"t": 8.0, "releases": [RELEASE], "landings": self.landings}


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> ControlPort:
    """The control port of every host."""
    standing_in = ControlPort()
    monkeypatch.setattr(simulator_client, "request", standing_in.request)
    return standing_in


@pytest.mark.parametrize(
    ("surface", "after_s", "position_m", "point"),
    [
        ("floor", 0.45, [1.0, 0.2, 0.0], THROUGH_M),
        ("bin", 0.4, [0.9, 0.2, 0.1], [0.9, 0.2, 0.1]),
        ("bin wall", 0.2, [0.7, 0.14, 0.7], [0.7, 0.14, 0.7]),
        ("keep_out[0]", 0.2, [0.7, 0.14, 0.7], [0.7, 0.14, 0.7]),
        ("keep_out[0]", 0.42, [0.92, 0.184, 0.03], THROUGH_M),
    ],
    ids=["floor below the target", "bin", "bin wall", "box in the way", "box behind the target"],
)
def test_the_landing_is_on_the_plans_plane_unless_something_stopped_the_object(
    port: ControlPort, surface: str, after_s: float, position_m: list[float], point: list[float]
) -> None:
    port.landings.append({"object": 3, "t": 7.0 + after_s, "position_m": position_m, "surface": surface, "bounce": 0})
    landing = wait_for_landing("host", problem(), 6.0, 0.4)
    assert landing is not None
    assert (landing.released_at, landing.surface) == (7.0, surface)
    np.testing.assert_allclose(landing.point, point, atol=1e-9)


def test_the_bin_of_a_target_is_placed_and_that_of_another_throw_removed(port: ControlPort) -> None:
    place_bin("host", problem({"radius_m": 0.1, "rim_height_m": 0.2}))
    place_bin("host", problem())
    assert port.requests == [
        {"op": "place_bin", "bottom_m": TARGET_M, "radius_m": 0.1, "rim_height_m": 0.2},
        {"op": "remove_bin"},
    ]
