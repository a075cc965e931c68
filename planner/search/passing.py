"""The accelerations with which a chain passes its states.

A state demands position and velocity; the acceleration is free. Of a few values a joint, each passage takes those with
which the legs before and after it take the least time together, while its neighbours stay as they are: exactly, since a
leg lasts as long as its slowest joint. A few sweeps over the passages make the whole chain sooner.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.arrays import Array, Index
from planner.backends import ruckig_otg
from planner.errors import SolverFailed
from planner.problem import ThrowProblem

SHARES = (-0.6, -0.3, 0.0, 0.3, 0.6)  # [-] of the limit on acceleration; more leaves little torque to anything else
SWEEPS = 3  # [-] over all passages
State = tuple[Array, Array, Array]  # q, qd, qdd (6,) [rad, rad/s, rad/s^2]


def passing_accelerations(
    problem: ThrowProblem, ends: Sequence[tuple[State, State | None]], free: Sequence[bool]
) -> list[Array]:
    """Returns the acceleration at the end of every leg (6,) [rad/s^2] but the last, chosen where it is free.

    Args:
        problem: gives the limits.
        ends: start and end of each leg; None for rest, anywhere.
        free: whether the acceleration between a leg and the next may be chosen, one fewer than legs.
    """
    between = [ends[number][1] for number in range(len(free))]
    values = [_values(problem, state, is_free) for state, is_free in zip(between, free, strict=True)]
    chosen = [np.zeros(6, np.intp) for _ in free]
    joints = np.arange(6)
    tables = []
    for number, (start, end) in enumerate(ends):
        before = values[number - 1] if number else start[2][None]
        after = values[number] if number < len(free) else None
        tables.append(_times(problem, start, end, before, after))
    for _ in range(SWEEPS):
        for number, is_free in enumerate(free):
            if not is_free:
                continue
            first = chosen[number - 1] if number else np.zeros(6, np.intp)
            last = chosen[number + 1] if number + 1 < len(free) else np.zeros(6, np.intp)
            chosen[number] = _soonest(tables[number][first, :, joints], tables[number + 1][:, last, joints].T)
    return [each[index, joints] for each, index in zip(values, chosen, strict=True)]


def _values(problem: ThrowProblem, state: State | None, is_free: bool) -> Array:
    """Returns the accelerations (n, 6) to choose from, the present one first: after none is a speed limit exceeded."""
    assert state is not None
    if not is_free:
        return state[2][None]
    limits = problem.limits
    room = np.sqrt(2.0 * limits.jerk_max * np.maximum(limits.qd_max - np.abs(state[1]), 0.0))
    most = np.minimum(limits.qdd_max, 0.9 * room)
    others = [share for share in SHARES if share != 0.0 or state[2].any()]  # of which the present one may be zero
    return np.array([state[2], *(np.clip(share * limits.qdd_max, -most, most) for share in others)])


def _times(problem: ThrowProblem, start: State, end: State | None, before: Array, after: Array | None) -> Array:
    """Returns each joint's own time over a leg (n, m, 6) [s], by its accelerations at start (n, 6) and end (m, 6)."""
    last = np.zeros((1, 6)) if after is None else after
    found = np.full((len(before), len(last), 6), np.inf)
    for i, first in enumerate(before):
        for k, arriving in enumerate(last):
            there = end if end is None or after is None else (end[0], end[1], arriving)
            try:
                found[i, k] = ruckig_otg.joint_times(problem, (start[0], start[1], first), there)
            except SolverFailed:
                continue
    return found


def _soonest(left: Array, right: Array) -> Index:
    """Returns the value (6,) of every joint with which the slowest joints before and after take the least together.

    Args:
        left, right: times (6, n) [s] of every joint before and after, by value.
    """
    best = np.inf
    chosen = np.zeros(len(left), np.intp)
    for most in np.unique(left[np.isfinite(left)]):
        allowed = np.where(left <= most, right, np.inf)
        total = most + allowed.min(axis=1).max()
        if total < best:
            best = total
            chosen = allowed.argmin(axis=1)
    return chosen
