"""The approach to the plan's start where a straight joint move would hit something."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from planner.geometry import body_model
from tests.system.rig import Rig

LEFT, RIGHT = ([side, -1.2, 1.6, -1.9, -1.57, 0.0] for side in (0.55, -0.55))
BOX = "keep_out = [{lower_m = [-0.656, -0.194, 0.07], upper_m = [-0.536, -0.074, 0.19]}]"  # half way, at the tool


@pytest.fixture(scope="module")
def boxed_rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    rig = Rig(tmp_path_factory.mktemp("boxed"), replace={"keep_out = []": BOX})
    rig.start()
    yield rig
    rig.stop()


def move(to: list[float]) -> dict:
    """A move that ends at rest, a little further on."""
    return {"kind": "joint", "positions": [to[0] + 0.02, *to[1:]], "velocities": [0.0] * 6}


@pytest.mark.slow
def test_the_approach_goes_around_an_obstacle(boxed_rig: Rig) -> None:
    rig = boxed_rig
    straight = np.array(LEFT) + np.linspace(0.0, 1.0, 100)[:, None] * (np.array(RIGHT) - LEFT)
    assert body_model(rig.cell).clearances(straight).least.min() < 0.0
    assert rig.quiet_throw(move(LEFT)).outcome == "completed"
    go_around(rig, RIGHT, "speedj")
    go_around(rig, LEFT, "servoj")
    rig.abort_approaching(queue(rig, RIGHT, "speedj"), 0.7)


def queue(rig: Rig, start: list[float], mode: str) -> str:
    """Queues a small move that starts at `start`; returns its id."""
    return rig.queue_plan(rig.plan(move(start), start={"positions": start}), mode)


def go_around(rig: Rig, start: list[float], mode: str) -> None:
    """Executes a small move that starts behind the box; the arm truly keeps clear."""
    id = queue(rig, start, mode)
    seen = [rig.state()["q"]]

    def over() -> bool:
        seen.append(rig.state()["q"])
        return rig.row(id).state == "finished"

    rig.until(over)
    row = rig.row(id)
    assert row.outcome == "completed", row.reason
    assert body_model(rig.cell).clearances(np.array(seen)).least.min() > 0.0
    assert rig.state()["q"] == pytest.approx(move(start)["positions"], abs=1e-3)
