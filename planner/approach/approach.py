"""Approach to a plan's start: a straight joint move where it is clear, otherwise a planned motion from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.approach.rest_to_rest import rest_to_rest_motion
from planner.approach.rrt_connect import find_path, is_clear
from planner.approach.swept_clearance import SweptPaths, keep_clear
from planner.arrays import Array
from planner.cell import Cell, Limits
from planner.certificate import certify
from planner.errors import InvalidProblem
from planner.problem import JointRelease, ThrowProblem
from planner.trajectory import Trajectory

STEP_RAD = 0.005  # [rad] spacing of evaluated positions on a straight move; swept clearance is bounded in between
NEAR_RAD = 1e-3  # [rad] distance from the start within which no motion is needed
APPROACH_SPEED = 1.0  # [rad/s] just below 1.05, the default of UR's movej
APPROACH_ACCELERATION = 1.4  # [rad/s^2] source: URScript manual, default of movej
APPROACH_JERK = 14.0  # [rad/s^3] full acceleration after 0.1 s
MARGINS_M = (0.01, 0.002)  # [m] beyond the cell's clearance that path search keeps, tried in turn
PACES = (1.0, 0.5, 0.25)  # [-] shares of the pace, tried in turn: torques and tool speed may require a slower motion


@dataclass(frozen=True, eq=False)
class Approach:
    """Motion of the arm to a plan's start: a joint move of the controller, or a streamed motion.

    Attributes:
        goal: start of the plan (6,) [rad].
        problem, trajectory: planned and certified motion; None for a straight joint move.
    """

    goal: Array
    problem: ThrowProblem | None = None
    trajectory: Trajectory | None = None


def find_approach(cell: Cell, now: Array, start: Array, pace: float = 1.0) -> tuple[Approach | None, str]:
    """Returns the approach from one posture to another.

    Args:
        cell: the robot station.
        now, start: present posture and start of the plan (6,) [rad].
        pace: share of the nominal pace [-].

    Returns:
        The approach, None if none is found, and what a straight joint move would hit, "" if nothing.
    """
    if np.abs(start - now).max() < NEAR_RAD:
        return Approach(start), ""
    obstacle = _straight_obstacle(cell, now, start)
    return (_planned(cell, now, start, pace), obstacle) if obstacle else (Approach(start), "")


def _planned(cell: Cell, now: Array, start: Array, pace: float) -> Approach | None:
    """Returns a motion around the obstacle in the straight move; None if none is found."""
    limits = cell.limits
    if any((q < limits.q_lower).any() or (q > limits.q_upper).any() for q in (now, start)):
        return None
    for margin in MARGINS_M:
        path = find_path(is_clear(cell, margin), now, start, limits.q_lower, limits.q_upper)
        if path is not None and (approach := _timed(cell, path, pace)) is not None:
            return approach
    return None


def _timed(cell: Cell, path: Array, pace: float) -> Approach | None:
    """Returns the fastest certified motion along a path (K, 6); None if none is."""
    approaches = (_certified(cell, path, _paced(cell.limits, pace * share)) for share in PACES)
    return next((approach for approach in approaches if approach is not None), None)


def _certified(cell: Cell, path: Array, limits: Limits) -> Approach | None:
    """Returns the motion along a path within limits, if its certificate is valid."""
    trajectory = rest_to_rest_motion(path, limits, 1.0 / cell.robot.sample_rate_hz)
    try:
        problem = ThrowProblem(cell, path[0], JointRelease(path[-1], np.zeros(6)), limits)
    except InvalidProblem:
        return None
    return Approach(path[-1], problem, trajectory) if certify(problem, trajectory).valid else None


def _paced(limits: Limits, pace: float) -> Limits:
    """Returns the limits of an approach at a pace; like a joint move it may pass a singularity."""
    return replace(
        limits,
        qd_max=np.minimum(limits.qd_max, pace * APPROACH_SPEED),
        qdd_max=np.minimum(limits.qdd_max, pace**2 * APPROACH_ACCELERATION),
        jerk_max=np.minimum(limits.jerk_max, pace**3 * APPROACH_JERK),
        singularity_distance_min=0.0,
    )


def _straight_obstacle(cell: Cell, a: Array, b: Array) -> str:
    """Returns what a straight move between two postures (6,) would hit; "" if nothing."""
    count = int(np.ceil(np.abs(b - a).max() / STEP_RAD)) + 1
    q = a + np.linspace(0.0, 1.0, max(count, 2))[:, None] * (b - a)
    limits = cell.limits
    if (q < limits.q_lower - NEAR_RAD).any() or (q > limits.q_upper + NEAR_RAD).any():
        return "a joint's limit"
    return keep_clear(cell, SweptPaths.straight(q[None]))[1]
