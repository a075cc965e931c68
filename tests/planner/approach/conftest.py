"""A throw and the brakes from its ticks: computed once, shared by the tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from planner.approach import Brakes, find_brakes
from planner.backends import ruckig_otg
from planner.cell import Cell
from planner.geometry import body_model, tool_pose
from planner.problem import TargetRelease, ThrowProblem
from planner.seeds import candidates
from planner.trajectory import Trajectory
from tests.planner.problems import cell, with_boxes

REST_TICKS = 15  # before and after the motion


@dataclass(frozen=True)
class BrakedThrow:
    """A throw on the controller's ticks, at rest before and after, with its brakes."""

    problem: ThrowProblem
    trajectory: Trajectory
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    brakes: Brakes

    @property
    def cell(self) -> Cell:
        return self.problem.cell

    @property
    def dt(self) -> float:
        return self.trajectory.dt


def braked_throw(name: str) -> BrakedThrow:
    """A throw in a shipped cell, sampled between the ticks of its plan, as the gripper's delay has it."""
    here = cell(name)
    problem = ThrowProblem(here, here.home, TargetRelease(np.array([1.2, 0.3, 0.0])), here.limits)
    trajectory = ruckig_otg.solve(problem, candidates(problem)[0]).trajectory
    first = -(REST_TICKS + 0.4) * trajectory.dt
    t = np.arange(first, trajectory.duration_s + REST_TICKS * trajectory.dt, trajectory.dt)
    q, qd, qdd = trajectory.at(t)
    still = (t <= 0.0) | (t >= trajectory.duration_s)
    qd[still] = 0.0
    qdd[still] = 0.0
    return BrakedThrow(problem, trajectory, q, qd, qdd, find_brakes(here, q, qd, qdd, trajectory.dt))


@pytest.fixture(scope="session", params=["ur5e-sim", "ur5-sim"])
def throw(request: pytest.FixtureRequest) -> BrakedThrow:
    """A throw of an e-Series arm at 500 Hz, and of a CB3 arm at 125 Hz."""
    return braked_throw(request.param)


def tool_position(cell: Cell, q: np.ndarray) -> np.ndarray:
    """Returns the position of the tool centre point (3,) [m]."""
    return tool_pose(cell, q)[:3, 3]


def near_a_box(cell: Cell, q: np.ndarray, spare_m: float) -> Cell:
    """Returns the cell with a box below the tool at a posture (6,), `spare_m` farther away than the clearance."""
    p = tool_position(cell, q)
    half = np.array([0.1, 0.1, 0.1])

    def with_top(z: float) -> Cell:
        centre = np.array([p[0], p[1], z - half[2]])
        return with_boxes(cell, (centre - half, centre + half))

    apart = float(body_model(with_top(p[2] - 0.1)).clearances(q[None]).keep_out[0])
    return with_top(p[2] - 0.1 + apart - spare_m)
