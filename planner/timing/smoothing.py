"""Bounded jerk for a motion with steps in its acceleration; the release state stays exact.

The motion is averaged over a sliding window of `width` (a convolution with a box). The average keeps every bound on
velocity and acceleration that the motion keeps, and its jerk is (qdd(t + w/2) - qdd(t - w/2)) / w: at most the largest
change of acceleration within a window, over the window. A motion at constant velocity for half a window on each side
of the release has the same state at the release after averaging. A trapezoid of velocity becomes the double S.
Source: Biagiotti and Melchiorri, FIR filters for online trajectory planning with time- and frequency-domain
specifications, Control Engineering Practice 20 (2012).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from planner.arrays import Array
from planner.cell import Limits
from planner.problem import ThrowProblem
from planner.seeds import Candidate
from planner.timing.grid import RESERVES, fits, grid_limits, onto_grid
from planner.trajectory import Trajectory, integrate, join

# [-] bounds of the window's width, as multiples of acceleration limit / jerk limit: one full step of acceleration needs
# the first, a step from full acceleration to full deceleration the second.
NARROWEST = 1.0
WIDEST = 2.0


@dataclass(frozen=True, eq=False)
class RawMotion:
    """Joint velocities at the ticks of a motion whose acceleration may step, in three phases.

    Attributes:
        launch: from rest to half a window before the release (N+1, n) [rad/s].
        passage: from half a window before the release to half a window after it (width+1, n) [rad/s]; zero for a move
            that ends at rest.
        brake: from there to rest (M+1, n) [rad/s]; one row for a move that ends at rest.
    """

    launch: Array
    passage: Array
    brake: Array


MakeRawMotion = Callable[[Limits, int], RawMotion]


def smooth(problem: ThrowProblem, candidate: Candidate, make: MakeRawMotion) -> tuple[Trajectory, float]:
    """Returns the motion averaged over the narrowest window that keeps the limits, and the window's width [s].

    Args:
        problem: gives start, limits and tick.
        candidate: the release state.
        make: returns a motion within the given limits for a window of the given width [ticks]. After averaging it
            leads from the problem's start to the candidate, up to the sampling error, which is corrected.
    """
    dt = problem.dt
    narrowest, widest = (_width(problem.limits, multiple, dt) for multiple in (NARROWEST, WIDEST))
    raw, trajectory = _attempt(problem, candidate, make, widest, RESERVES[0])
    width = _narrowest(raw, narrowest, widest, problem.limits, dt)
    if width < widest:
        _, narrow = _attempt(problem, candidate, make, width, RESERVES[0])
        if _fits(problem, narrow):
            return narrow, width * dt
    for reserve in RESERVES[1:]:
        if _fits(problem, trajectory):
            break
        _, trajectory = _attempt(problem, candidate, make, widest, reserve)
    return trajectory, widest * dt


def _attempt(
    problem: ThrowProblem, candidate: Candidate, make: MakeRawMotion, width: int, reserve: float
) -> tuple[RawMotion, Trajectory]:
    limits = grid_limits(problem.limits, problem.dt, reserve)
    # A release at the very limit is allowed: only the way there keeps the room that the grid needs.
    limits = replace(limits, qd_max=np.maximum(limits.qd_max, np.abs(candidate.qd)))
    raw = make(limits, width)
    return raw, _averaged(problem, candidate, raw, width)


def _width(limits: Limits, multiple: float, dt: float) -> int:
    return math.ceil(multiple * float((limits.qdd_max / limits.jerk_max).max()) / dt)


def _fits(problem: ThrowProblem, trajectory: Trajectory) -> bool:
    return fits((trajectory.q, trajectory.qd, trajectory.qdd), problem.limits, problem.dt)


def _narrowest(raw: RawMotion, first: int, last: int, limits: Limits, dt: float) -> int:
    """Returns the narrowest width [ticks] from `first` to `last` that brings the motion's jerk within the limits."""
    still = np.zeros((last, 6))
    qd = np.concatenate([still, raw.launch, raw.passage[1:], raw.brake[1:], still])
    for width in range(first, last):
        jerk = np.diff(_slope(qd, width, dt), axis=0) / dt
        if np.all(np.abs(jerk) <= limits.jerk_max):
            return width
    return last


def _averaged(problem: ThrowProblem, candidate: Candidate, raw: RawMotion, width: int) -> Trajectory:
    dt = problem.dt
    zero = np.zeros(6)
    jerk_max = problem.limits.jerk_max
    still = np.zeros((width, 6))
    qdd = _slope(np.concatenate([still, raw.launch, raw.passage[1:]]), width, dt)
    release = (candidate.q, candidate.qd, zero if problem.ends_at_rest else qdd[-1])
    head = onto_grid((problem.start, zero, zero), release, qdd, dt, jerk_max)
    if problem.ends_at_rest:
        return join(head, (candidate.q[None], candidate.qd[None], zero[None]), 1.0 / dt)
    qdd = _slope(np.concatenate([raw.passage, raw.brake[1:], still]), width, dt)
    rest = integrate(*release, np.diff(qdd, axis=0) / dt, dt)[0][-1]
    tail = onto_grid(release, (rest, zero, zero), qdd, dt, jerk_max)
    return join(head, tail, 1.0 / dt)


def _slope(qd: Array, width: int, dt: float) -> Array:
    """Returns the averaged motion's accelerations at the ticks that end a full window of velocities."""
    return (qd[width:] - qd[:-width]) / (width * dt)
