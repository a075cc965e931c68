"""How soon each joint alone can be at a release state, and the acceleration in which it is soonest.

With a free acceleration at the release no launch is sooner than the slowest joint alone; the others have time to
arrive without acceleration. Ruckig gives a joint's least time for a given final acceleration; the least over that
acceleration is found by a scan and golden sections, for the joints that decide.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.backends.ruckig_otg import calls
from planner.problem import ThrowProblem
from planner.seeds.candidates import Candidate
from planner.timing.grid import grid_limits

Vector = NDArray[np.float64]

SCAN = 9  # final accelerations tried, from the least allowed to the largest
SECTIONS = 14  # of the interval beside the best of them: 1/4 of the range * 0.618^14 = 3e-4 of it
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
INSIDE = 0.999  # [-] of the final acceleration with which a joint just keeps its velocity limit beyond the release


@dataclass(frozen=True, eq=False)
class Arrival:
    """The soonest arrival at a release state.

    Attributes:
        time_s: when the slowest joint alone can be there [s].
        qdd: with which accelerations (6,) [rad/s^2]; zero for the joints that have time.
    """

    time_s: float
    qdd: Vector


def least_times(problem: ThrowProblem, candidate: Candidate) -> Vector:
    """Returns each joint's own least time (6,) [s] to the candidate with zero acceleration there."""
    zero = np.zeros(6)
    start, release = (problem.start, zero, zero), (candidate.q, candidate.qd, zero)
    motion = calls.reaching(start, release, problem.limits, problem.dt, on_ticks=False)
    return np.array(motion.independent_min_durations)


def soonest(problem: ThrowProblem, candidate: Candidate) -> Arrival:
    """Returns the soonest arrival at a candidate, with free acceleration there unless the motion ends in it.

    Raises:
        SolverFailed: Ruckig refuses the states.
        BackendUnavailable: ruckig is not installed.
    """
    times = least_times(problem, candidate)
    qdd = np.zeros(6)
    if problem.ends_at_rest:
        return Arrival(float(times.max()), qdd)
    limits, time_s = grid_limits(problem.limits, problem.dt), 0.0
    joint = _Joint()
    for i in np.argsort(-times):
        if times[i] <= time_s:
            break
        maxima = float(limits.qd_max[i]), float(limits.qdd_max[i]), float(limits.jerk_max[i])
        own, a = joint.soonest(float(candidate.q[i] - problem.start[i]), float(candidate.qd[i]), maxima)
        if own < times[i]:
            qdd[i] = a
        time_s = max(time_s, min(own, float(times[i])))
    return Arrival(time_s, qdd)


class _Joint:
    """One joint from rest, with Ruckig's objects for it."""

    def __init__(self) -> None:
        self.ruckig: Any = calls.library()
        self.solver, self.motion = self.ruckig.Ruckig(1), self.ruckig.Trajectory(1)
        self.solved = (self.ruckig.Result.Working, self.ruckig.Result.Finished)
        self.request = request = self.ruckig.InputParameter(1)
        request.current_position = request.current_velocity = request.current_acceleration = [0.0]

    def soonest(self, distance: float, velocity: float, maxima: tuple[float, float, float]) -> tuple[float, float]:
        """Returns the least time [s] over `distance` [rad] to `velocity` [rad/s], and the final acceleration of it."""
        v_max, a_max, j_max = maxima
        request = self.request
        request.target_position, request.target_velocity = [distance], [velocity]
        request.max_velocity, request.max_acceleration = [max(v_max, abs(velocity))], [a_max]
        request.max_jerk = [j_max]
        # A jerk takes |a| / j to undo an acceleration: meanwhile the velocity changes by a^2 / 2j, and keeps its limit.
        low = -INSIDE * min(a_max, math.sqrt(max(2.0 * j_max * (v_max + velocity), 0.0)))
        high = INSIDE * min(a_max, math.sqrt(max(2.0 * j_max * (v_max - velocity), 0.0)))
        grid = np.linspace(low, high, SCAN).tolist()
        times = [self._time(a) for a in grid]
        k = int(np.argmin(times))
        section = _golden(self._time, grid[max(k - 1, 0)], grid[min(k + 1, SCAN - 1)])
        return min(section, (times[k], grid[k]))

    def _time(self, acceleration: float) -> float:
        self.request.target_acceleration = [acceleration]
        try:
            result = self.solver.calculate(self.request, self.motion)
        except self.ruckig.RuckigError:
            return math.inf
        return float(self.motion.duration) if result in self.solved else math.inf


def _golden(function: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Returns the least value, and where, of a function that has one valley in [low, high]."""
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = function(left), function(right)
    for _ in range(SECTIONS):
        if at_left <= at_right:
            high, right, at_right = right, left, at_left
            left = high - GOLDEN * (high - low)
            at_left = function(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + GOLDEN * (high - low)
            at_right = function(right)
    return min((at_left, left), (at_right, right))
