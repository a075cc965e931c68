"""Earliest arrival of each joint alone at a release state, and the release acceleration that gives it.

With a free acceleration at the release no launch is sooner than the slowest joint alone; the other joints have time to
arrive with zero acceleration. Ruckig gives a joint's least time for a given final acceleration. The minimum over that
acceleration is found by a scan and golden-section search, for the joints that decide.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from planner.arrays import read_only
from planner.backends.ruckig_otg import library
from planner.backends.ruckig_otg.library import State, Vector
from planner.errors import SolverFailed
from planner.problem import ThrowProblem
from planner.seeds import Candidate
from planner.timing import grid_limits

SCAN = 9  # final accelerations scanned, from the lowest to the highest allowed
SECTIONS = 14  # golden sections beside the best of them: 1/4 of the range * 0.618^14 = 3e-4 of the range
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
ARRIVALS_KEPT = 64  # arrivals that are cached: the ranking asks for those that launches and initial guesses then use
INSIDE = 0.999  # [-] of the final acceleration from which the velocity just keeps its limit after the release


@dataclass(frozen=True, eq=False)
class Arrival:
    """The earliest arrival at a release state.

    Attributes:
        time_s: least time of the slowest joint alone [s].
        qdd: release accelerations (6,) [rad/s^2]; zero for the joints that have time to spare.
    """

    time_s: float
    qdd: Vector


def arrival(problem: ThrowProblem, candidate: Candidate) -> Arrival | None:
    """Returns the earliest arrival at a candidate, None where Ruckig refuses it.

    Raises:
        BackendUnavailable: ruckig is not installed.
    """
    try:
        return earliest_arrival(problem, candidate)
    except SolverFailed:
        return None


def joint_times(problem: ThrowProblem, start: State, end: State | None) -> Vector:
    """Returns the least time of each joint alone (6,) [s] from one state to another.

    Args:
        problem: gives limits and tick.
        start: q [rad], qd [rad/s], qdd [rad/s^2], each (6,).
        end: the same quantities; None for rest, anywhere.

    Raises:
        SolverFailed: Ruckig refuses the states.
        BackendUnavailable: ruckig is not installed.
    """
    motion = library.fastest_motion(start, end, problem.limits, problem.dt, on_ticks=False)
    return np.array(motion.independent_min_durations)


def least_times(problem: ThrowProblem, candidate: Candidate) -> Vector:
    """Returns each joint's own least time (6,) [s] to the candidate with zero acceleration there.

    Raises:
        SolverFailed: Ruckig refuses the states.
        BackendUnavailable: ruckig is not installed.
    """
    release = (candidate.q, candidate.qd, np.zeros(6))
    return joint_times(problem, problem.start_state, release)


@lru_cache(maxsize=ARRIVALS_KEPT)
def earliest_arrival(problem: ThrowProblem, candidate: Candidate) -> Arrival:
    """Returns the earliest arrival at a candidate; its release acceleration is zero for a move that ends at rest.

    Raises:
        SolverFailed: Ruckig refuses the states.
        BackendUnavailable: ruckig is not installed.
    """
    times = least_times(problem, candidate)
    qdd = np.zeros(6)
    if problem.ends_at_rest:
        return Arrival(float(times.max()), read_only(qdd))
    limits = grid_limits(problem.limits, problem.dt)
    time_s = 0.0
    joint = _Joint()
    for i in np.argsort(-times):
        if times[i] <= time_s:
            break
        maxima = float(limits.qd_max[i]), float(limits.qdd_max[i]), float(limits.jerk_max[i])
        joint.starts_with(float(problem.start_qd[i]), float(problem.start_qdd[i]))
        own, a = joint.earliest(float(candidate.q[i] - problem.start[i]), float(candidate.qd[i]), maxima)
        if own < times[i]:
            qdd[i] = a
        time_s = max(time_s, min(own, float(times[i])))
    return Arrival(time_s, read_only(qdd))


class _Joint:
    """One joint; Ruckig's objects for it are made once."""

    def __init__(self) -> None:
        self.ruckig: Any = library.ruckig_module()
        self.solver, self.motion = self.ruckig.Ruckig(1), self.ruckig.Trajectory(1)
        self.solved = (self.ruckig.Result.Working, self.ruckig.Result.Finished)
        self.request = self.ruckig.InputParameter(1)
        self.request.current_position = [0.0]

    def starts_with(self, velocity: float, acceleration: float) -> None:
        """Sets the joint's velocity [rad/s] and acceleration [rad/s^2] at the start."""
        self.request.current_velocity = [velocity]
        self.request.current_acceleration = [acceleration]

    def earliest(self, distance: float, velocity: float, maxima: tuple[float, float, float]) -> tuple[float, float]:
        """Returns the least time [s] over `distance` [rad] to `velocity` [rad/s], and its final acceleration."""
        (v_max, a_max, j_max) = maxima
        request = self.request
        request.target_position = [distance]
        request.target_velocity = [velocity]
        request.max_velocity = [max(v_max, abs(velocity))]
        request.max_acceleration = [a_max]
        request.max_jerk = [j_max]
        # Undoing an acceleration a takes |a| / j and changes the velocity by a^2 / 2j, which must keep its limit.
        low = -INSIDE * min(a_max, math.sqrt(max(2.0 * j_max * (v_max + velocity), 0.0)))
        high = INSIDE * min(a_max, math.sqrt(max(2.0 * j_max * (v_max - velocity), 0.0)))
        grid = np.linspace(low, high, SCAN).tolist()
        times = [self._time(a) for a in grid]
        k = int(np.argmin(times))
        section = golden_section(self._time, grid[max(k - 1, 0)], grid[min(k + 1, SCAN - 1)], SECTIONS)
        return min(section, (times[k], grid[k]))

    def _time(self, acceleration: float) -> float:
        self.request.target_acceleration = [acceleration]
        try:
            result = self.solver.calculate(self.request, self.motion)
        except self.ruckig.RuckigError:
            return math.inf
        return float(self.motion.duration) if result in self.solved else math.inf


def golden_section(function: Callable[[float], float], low: float, high: float, sections: int) -> tuple[float, float]:
    """Returns the minimum and its place of a function with one valley in [low, high]."""
    left = high - GOLDEN * (high - low)
    right = low + GOLDEN * (high - low)
    at_left = function(left)
    at_right = function(right)
    for _ in range(sections):
        if at_left <= at_right:
            high = right
            right = left
            at_right = at_left
            left = high - GOLDEN * (high - low)
            at_left = function(left)
        else:
            low = left
            left = right
            at_left = at_right
            right = low + GOLDEN * (high - low)
            at_right = function(right)
    return min((at_left, left), (at_right, right))
