"""Approach to a plan's start: straight in joint space where that is certified, otherwise around what is in the way.

One rule decides what is clear: the certificate. It proves the straight move as it proves a plan, bisecting where a
coarse bound leaves a doubt, so a posture at which a certified plan ends is a start that no approach refuses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from planner.approach.posture import way_clear
from planner.approach.rest_to_rest import SLOWEST, rest_to_rest_motion
from planner.approach.rrt_connect import Obstacles, find_path
from planner.arrays import Array
from planner.cell import Cell, Limits
from planner.certificate import Check, Examination
from planner.errors import InvalidProblem
from planner.geometry import passable
from planner.problem import JointRelease, ThrowProblem
from planner.trajectory import Trajectory

NEAR_RAD = 1e-3  # [rad] distance from the start within which no motion is needed; accepted beyond a joint's limit
APPROACH_SPEED = 1.0  # [rad/s] just below 1.05, the default of UR's movej
APPROACH_ACCELERATION = 1.4  # [rad/s^2] source: URScript manual, default of movej
APPROACH_JERK = 14.0  # [rad/s^3] full acceleration after 0.1 s
# [m] margin beyond the cell's clearance that a path search keeps away from the ends, tried in turn: beside a wrist bent
# as far as the clearance allows, no straight way out keeps more than the last.
MARGINS_M = (0.01, 0.002, 0.0005)
CHECKED_S = 0.016  # [s] between checked postures of a motion that cuts its corners
SLOWER = 0.7  # [-] of the speed, at a corner where the motion is not clear
PACES = (1.0, 0.5, 0.25)  # [-] shares of the pace, tried in turn: torques and tool speed may require a slower motion
# Checks that depend on the path alone: a slower motion along it breaks them, too.
PATH_CHECKS = {"joint_position", "floor", "keep_in", "keep_out", "self_collision"}


@dataclass(frozen=True, eq=False)
class Approach:
    """Motion of the arm to a plan's start.

    Attributes:
        goal: start of the plan (6,) [rad].
        problem, trajectory: planned and certified motion; None where the arm is at the goal.
        is_straight: whether it is the straight line in joint space, at the whole pace.
    """

    goal: Array
    problem: ThrowProblem | None = None
    trajectory: Trajectory | None = None
    is_straight: bool = False

    @property
    def duration_s(self) -> float:
        """Duration of the motion [s]."""
        return 0.0 if self.trajectory is None else self.trajectory.duration_s


def find_approach(
    cell: Cell,
    now: Array,
    start: Array,
    pace: float = 1.0,
    with_object: bool = True,
    limits: Limits | None = None,
    deadline_s: float = math.inf,
) -> tuple[Approach | None, tuple[Check, ...]]:
    """Returns the approach from one posture to another.

    Args:
        cell: the robot station.
        now, start: present posture and start of the plan (6,) [rad].
        pace: share of the nominal pace [-].
        with_object: whether the object is in the tool.
        limits: of the motion; the cell's by default.
        deadline_s: of the search for a path, on `time.perf_counter`; the straight move is always tried.

    Returns:
        The approach, None if none is found, and the checks that a straight joint move fails, empty if none.
    """
    if np.abs(start - now).max() < NEAR_RAD:
        return Approach(start), ()
    limits = limits or cell.limits
    ends = np.array([now, start])
    beyond = np.maximum(limits.q_lower - ends, ends - limits.q_upper)
    if beyond.max() > NEAR_RAD:
        return None, (_out_of_range(cell, limits, ends, beyond),)
    limits = replace(
        limits,
        q_lower=np.minimum(limits.q_lower, ends.min(axis=0)),
        q_upper=np.maximum(limits.q_upper, ends.max(axis=0)),
    )
    return _Search(cell, limits, pace, with_object, deadline_s).approach(now, start)


def _out_of_range(cell: Cell, limits: Limits, ends: Array, beyond: Array) -> Check:
    """Returns the check of the joint that is farthest `beyond` (2, 6) its range [rad]."""
    end, joint = np.unravel_index(int(beyond.argmax()), beyond.shape)
    value = float(ends[end, joint])
    names = cell.robot.joint_names
    limit = limits.q_lower[joint] if value < limits.q_lower[joint] else limits.q_upper[joint]
    return Check(
        "joint_position", value, float(limit), "rad", -float(beyond[end, joint]), None, False, names[int(joint)]
    )


@dataclass(frozen=True, eq=False)
class _Search:
    """What all motions of one search for an approach have in common; the arguments of `find_approach`."""

    cell: Cell
    limits: Limits
    pace: float
    with_object: bool
    deadline_s: float

    def approach(self, now: Array, start: Array) -> tuple[Approach | None, tuple[Check, ...]]:
        """Returns the approach, and the checks that the straight move fails."""
        straight, failures = self._timed(np.array([now, start]))
        if straight is not None:
            return straight, ()
        out = way_clear(self.cell, now, self.with_object)
        back = way_clear(self.cell, start, self.with_object)
        if out is None or back is None:
            return None, failures
        motions = (self._motion(path, len(out) - 1, len(back) - 1) for path in self._paths(out, back[::-1]))
        return next((motion for motion in motions if motion is not None), None), failures

    def _paths(self, out: Array, back: Array) -> Iterator[Array]:
        """Yields paths (K, 6) that begin and end with the postures `out` and `back` (K, 6); none past a barrier."""
        now = out[-1]
        start = back[0]
        limits = self.limits
        lower, upper = passable(self.cell.robot, self.cell.tool.capsules, now, self.cell.surroundings)
        if (start < lower).any() or (start > upper).any():
            return
        lower = np.maximum(lower, limits.q_lower)
        upper = np.minimum(upper, limits.q_upper)
        for margin in MARGINS_M:
            around = Obstacles.of(self.cell, margin, np.array([now, start]), self.with_object)
            path = find_path(around, lower, upper, deadline_s=self.deadline_s)
            if path is not None:
                yield np.concatenate([out[:-1], path, back[1:]])

    def _motion(self, path: Array, leaving: int, arriving: int) -> Approach | None:
        """Returns the fastest certified motion along a path: through its corners, or else with a stop in each.

        The first and last pieces, of numbers `leaving` and `arriving`, lead an arm clear that stands too close, or back
        to a posture that is too close; they are not certified.
        """
        inner = path[leaving : len(path) - arriving]
        for corners in (self._corners(inner), np.zeros(len(inner))):
            motion, _ = self._timed(inner, corners)
            if motion is None or motion.problem is None:
                continue
            if leaving == arriving == 0:
                return motion
            limits = motion.problem.limits
            shares = np.concatenate([np.zeros(leaving), corners, np.zeros(arriving)])
            whole = rest_to_rest_motion(path, limits, motion.problem.dt, shares)
            return Approach(path[-1], self._problem(path[0], path[-1], limits), whole)
        return None

    def _corners(self, path: Array) -> Array:
        """Returns the share of the limits (K,) at which a motion can pass each corner of a path and stay clear.

        All begin with the whole; those about which the motion is not clear are slowed down until it is, or they stop.
        """
        limits = paced(self.limits, self.pace)
        around = Obstacles.of(self.cell, MARGINS_M[-1], path[[0, -1]], self.with_object)
        corners = np.ones(len(path))
        corners[[0, -1]] = 0.0
        while corners.any():
            q = rest_to_rest_motion(path, limits, CHECKED_S, corners).q
            close = q[:-1][~around.clear(q[:-1], q[1:])]
            if len(close) == 0:
                break
            nearest = np.unique(np.abs(close[:, None] - path[1:-1]).max(axis=2).argmin(axis=1) + 1)
            if not corners[nearest].any():
                break
            corners[nearest] *= SLOWER
            corners[corners < SLOWEST] = 0.0
        return corners

    def _timed(self, path: Array, corners: Array | None = None) -> tuple[Approach | None, tuple[Check, ...]]:
        """Returns the fastest certified motion along a path (K, 6), None if none is, and the failed checks then."""
        failures: tuple[Check, ...] = ()
        for share in PACES:
            limits = paced(self.limits, self.pace * share)
            try:
                problem = self._problem(path[0], path[-1], limits)
            except InvalidProblem:
                return None, failures
            motion = rest_to_rest_motion(path, limits, problem.dt, corners)
            failures = Examination(problem, motion).failures
            if not failures:
                return Approach(path[-1], problem, motion, len(path) == 2 and share == 1.0), ()
            if any(check.name in PATH_CHECKS for check in failures):
                break
        return None, failures

    def _problem(self, now: Array, start: Array, limits: Limits) -> ThrowProblem:
        """Returns the problem of a move from rest to rest."""
        return ThrowProblem(self.cell, now, JointRelease(start, np.zeros(6)), limits, holds_object=self.with_object)


def paced(limits: Limits, pace: float) -> Limits:
    """Returns the limits of an approach at a pace; like a joint move it may pass a singularity."""
    return replace(
        limits,
        qd_max=np.minimum(limits.qd_max, pace * APPROACH_SPEED),
        qdd_max=np.minimum(limits.qdd_max, pace**2 * APPROACH_ACCELERATION),
        jerk_max=np.minimum(limits.jerk_max, pace**3 * APPROACH_JERK),
        singularity_distance_min=0.0,
    )
