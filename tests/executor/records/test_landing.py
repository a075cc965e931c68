"""The landing as the executor records it, from the control port of a simulated controller in this process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from executor.records import expect_throw, wait_for_landing
from executor.robot import simulator_client
from planner.cell import Cell, load_cell
from planner.problem import ThrowProblem
from planner.request import problem_from_request
from simulator.control_operations import control_operations
from simulator.settings import SimulatorSettings
from simulator.simulation import Simulation
from simulator.truth import CameraNoise, truth_of
from tests.executor.conftest import CELLS
from tests.simulator.conftest import unique_address

TARGET_M = [0.9, 0.18, 0.1]
STATE = (0.5, 0.1, 0.9, 1.0, 0.2, 0.0)  # of the object at its release [m, m/s]
FALL_S = np.sqrt(2.0 * 0.8 / 9.81)  # [s] from the release to the target's plane
THROUGH_M = [0.5 + 1.0 * FALL_S, 0.1 + 0.2 * FALL_S, 0.1]
TICKS = 20  # cycles between two requests


@pytest.fixture(scope="module")
def cell() -> Cell:
    return load_cell(CELLS / "ur5e-sim.toml")


def problem(cell: Cell, opening: dict[str, float] | None = None) -> ThrowProblem:
    """Returns a throw to TARGET_M, into a bin if there is an opening."""
    release = {"kind": "target", "position": TARGET_M, **({} if opening is None else {"opening": opening})}
    return problem_from_request({"release": release}, cell)


Start = Callable[..., Simulation]


@pytest.fixture
def start(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    """Starts a simulation of the cell: `start(**truth)`; requests reach it without a network and let time pass."""
    started: list[Simulation] = []

    def begin(**truth: Any) -> Simulation:
        simulation = Simulation(cell, SimulatorSettings(), unique_address(), replace(truth_of(cell), **truth))
        started.append(simulation)
        operations = control_operations(simulation, lambda: None)

        def request(_host: str, op: str, **parameters: Any) -> dict[str, Any]:
            for _ in range(TICKS):
                simulation.tick()
            return operations[op]({"op": op, **parameters}) or {}

        monkeypatch.setattr(simulator_client, "request", request)
        return simulation

    yield begin
    for simulation in started:
        simulation.network.close()


def release(simulation: Simulation) -> float:
    """Releases an object now; returns the time [s]."""
    now = simulation.controller.timeline.t
    simulation.controller.workcell.world.release(1, now, STATE, now)
    return now


def test_an_object_lands_on_the_plans_plane(start: Start, cell: Cell) -> None:
    simulation = start()
    throw = expect_throw("host", problem(cell))
    released_at = release(simulation)
    landing = wait_for_landing("host", throw, 0.5)
    assert landing is not None
    assert (landing.released_at, landing.surface) == (released_at, "landing plane")
    np.testing.assert_allclose(landing.point, THROUGH_M, atol=1e-9)
    assert landing.observed is not None
    np.testing.assert_array_equal(landing.observed.position, landing.point)
    assert landing.observed.std_m == 0.0


def test_a_bin_is_put_into_the_world_and_taken_away_before_a_throw_without_one(start: Start, cell: Cell) -> None:
    simulation = start()
    throw = expect_throw("host", problem(cell, {"radius_m": 0.1, "rim_height_m": 0.2}))
    release(simulation)
    landing = wait_for_landing("host", throw, 0.5)
    assert landing is not None
    assert landing.surface == "bin"
    np.testing.assert_allclose(landing.point, THROUGH_M, atol=1e-9)
    expect_throw("host", problem(cell))
    assert simulation.controller.workcell.world.bin is None


def test_a_throw_without_a_release_has_no_landing(start: Start, cell: Cell) -> None:
    simulation = start()
    release(simulation)  # of an earlier throw
    throw = expect_throw("host", problem(cell))
    assert wait_for_landing("host", throw, 0.5) is None


def test_of_a_hidden_truth_only_the_observation_is_known(start: Start, cell: Cell) -> None:
    simulation = start(hidden=True, camera=CameraNoise(std_m=0.003))
    throw = expect_throw("host", problem(cell))
    release(simulation)
    landing = wait_for_landing("host", throw, 0.5)
    assert landing is not None
    assert (landing.released_at, landing.point, landing.surface) == (None, None, "landing plane")
    assert landing.observed is not None
    error = np.abs(landing.observed.position - THROUGH_M)
    assert 0.0 < error.max() < 0.02
    assert landing.observed.std_m == 0.003
    nothing = wait_for_landing("host", expect_throw("host", problem(cell)), 0.1)
    assert nothing is not None
    assert (nothing.released_at, nothing.point, nothing.observed) == (None, None, None)
