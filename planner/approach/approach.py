"""The way to the plan's start: a straight joint move where that keeps clear, a planned motion where it would not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.approach.rest_to_rest import through
from planner.approach.rrt_connect import find_path, is_clear
from planner.approach.swept_clearance import Space, Ways
from planner.cell import Cell, Limits
from planner.certificate import certify
from planner.errors import InvalidProblem
from planner.problem import JointRelease, ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

STEP_RAD = 0.005  # [rad] spacing at which a straight move is looked at; in between the bound of `Space` holds
NEAR_RAD = 1e-3  # [rad] an arm this close to the start has no way to go
SPEED = 1.0  # [rad/s] unhurried; UR's own default for movej is 1.05
ACCELERATION = 1.4  # [rad/s^2] source: URScript manual, movej's default
JERK = 14.0  # [rad/s^3] full acceleration after 0.1 s
ROOMS_M = (0.01, 0.002)  # [m] beyond the cell's clearance that a search is asked to keep, in turn
PACES = (1.0, 0.5, 0.25)  # [-] shares of the pace, in turn: torques and tool speed may ask for a slower one


@dataclass(frozen=True, eq=False)
class Way:
    """How the arm gets to the plan's start: a joint move of the controller's own, or a motion that is streamed.

    Attributes:
        goal: where it leads (6,) [rad].
        problem, trajectory: the planned motion, certified as the plan is; None for a straight move.
    """

    goal: Vector
    problem: ThrowProblem | None = None
    trajectory: Trajectory | None = None


def find_way(space: Space, now: Vector, start: Vector, pace: float = 1.0) -> tuple[Way | None, str]:
    """Returns the way from `now` to `start` (6,) [rad], or None and what stands in the way."""
    if np.abs(start - now).max() < NEAR_RAD:
        return Way(start), ""
    hit = _hit(space, now, start)
    return (Way(start), "") if not hit else (_planned(space.cell, now, start, pace), hit)


def _planned(cell: Cell, now: Vector, start: Vector, pace: float) -> Way | None:
    """Returns a motion around what stands in the straight way; None where none is found."""
    limits = cell.limits
    if any((q < limits.q_lower).any() or (q > limits.q_upper).any() for q in (now, start)):
        return None
    for room in ROOMS_M:
        path = find_path(is_clear(cell, room), now, start, limits.q_lower, limits.q_upper)
        if path is not None and (way := _timed(cell, path, pace)) is not None:
            return way
    return None


def _timed(cell: Cell, path: Vector, pace: float) -> Way | None:
    """Returns the fastest motion along a path whose certificate holds."""
    ways = (_certified(cell, path, _unhurried(cell.limits, pace * share)) for share in PACES)
    return next((way for way in ways if way is not None), None)


def _certified(cell: Cell, path: Vector, limits: Limits) -> Way | None:
    """Returns the motion along a path where its certificate holds."""
    trajectory = through(path, limits, 1.0 / cell.robot.sample_rate_hz)
    try:
        problem = ThrowProblem(cell, path[0], JointRelease(path[-1], np.zeros(6)), limits)
    except InvalidProblem:
        return None
    return Way(path[-1], problem, trajectory) if certify(problem, trajectory).valid else None


def _unhurried(limits: Limits, pace: float) -> Limits:
    """Returns the cell's limits at the pace of an approach; like a joint move it may pass a singularity."""
    return replace(
        limits,
        qd_max=np.minimum(limits.qd_max, pace * SPEED),
        qdd_max=np.minimum(limits.qdd_max, pace**2 * ACCELERATION),
        jerk_max=np.minimum(limits.jerk_max, pace**3 * JERK),
        singularity_distance_min=0.0,
    )


def _hit(space: Space, a: Vector, b: Vector) -> str:
    count = int(np.ceil(np.abs(b - a).max() / STEP_RAD)) + 1
    way = a + np.linspace(0.0, 1.0, max(count, 2))[:, None] * (b - a)
    limits = space.cell.limits
    if (way < limits.q_lower - NEAR_RAD).any() or (way > limits.q_upper + NEAR_RAD).any():
        return "a joint's limit"
    return space.judge(Ways.straight(way[None]))[1]
