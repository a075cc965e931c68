"""Which joint states a launch can be at soonest: a lower bound, the choice by it, and sooner states nearby."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from planner import native
from planner.arrays import Array, Index, read_only
from planner.cell import Limits
from planner.geometry import body_model
from planner.problem import ThrowProblem
from planner.seeds.aspects import aspects, first_rows
from planner.seeds.quasi_random import joint_offsets

STATES_MAX = 48  # states kept, those of the least lower bound that are apart from one another
APART_RAD = 0.35  # [rad] least difference of two kept states in some joint
TOO_FAST_S = 1e3  # [s] penalty per multiple of a speed limit: every state that is too fast comes after all others
MOVED = 12  # soonest states that are moved
# [-] of `joint_offsets`: distances from the soonest states at which sooner ones are looked for, in turn, and how many
# postures are tried near each. Six dimensions are too many to fill: this brings a point's least lower bound down by a
# third, twice as many postures by a tenth.
NEARBY_SHARES = (0.4, 0.15)
NEARBY = 12
# The same where postures on the way to the states' run-ups are tried, too: a target's comes down to a half.
NEARBY_RUN_UPS_SHARES = (0.3, 0.2, 0.1, 0.05)
NEARBY_RUN_UPS = 4
# [-] The same for as long as every state is too fast, the slowest by `A_LITTLE` at most, in 14 ms: of 90 bins and far
# targets that were refused 11 are answered.
SLOWER_SHARES = 6 * NEARBY_RUN_UPS_SHARES
A_LITTLE = 1.3
RUN_UP_SHARES = np.array([0.3, 0.6, 1.0])  # [-] of that way

StatesNear = Callable[[Array], tuple[Array, Array]]


def least_time(distance: Array, qd: Array, limits: Limits) -> Array:
    """Returns a lower bound (...,) [s] on the time from rest over `distance` to the velocity `qd`.

    The maximum over the joints of each joint's own least time with unbounded jerk. Source: time-optimal control of a
    double integrator with bounded acceleration and velocity (Pontryagin; e.g. Biagiotti and Melchiorri, Trajectory
    Planning for Automatic Machines and Robots, Springer 2008, section 3.2).

    Args:
        distance: joint distances (..., n) [rad].
        qd: joint velocities (..., n) at the end [rad/s].
        limits: of velocity and acceleration.
    """
    return _least_time(distance, qd, limits.qd_max, limits.qdd_max)


def _least_time(distance: Array, qd: Array, v_max: Array, a_max: Array) -> Array:
    turn = np.where(distance >= qd * np.abs(qd) / (2.0 * a_max), 1.0, -1.0)
    d = turn * distance
    v = turn * qd
    peak = np.sqrt(np.maximum(a_max * d + v**2 / 2.0, 0.0))
    direct = (2.0 * peak - v) / a_max
    accelerating = (2.0 * v_max**2 - v**2) / (2.0 * a_max)
    cruising = (2.0 * v_max - v) / a_max + (d - accelerating) / v_max
    return np.where(peak <= v_max, direct, cruising).max(axis=-1)


def soonest_nearby(
    problem: ThrowProblem, q: Array, qd: Array, states_near: StatesNear, towards_run_ups: bool = False
) -> tuple[Array, Array]:
    """Returns the soonest distinct states (n, 6), the first `MOVED` of them moved to sooner ones near them.

    So is the soonest of every aspect.

    Args:
        problem: the problem.
        q: positions of the states (m, 6) [rad].
        qd: their velocities (m, 6) [rad/s].
        states_near: returns states q, qd (k, 6) next to postures (k, 6); NaN where there is none.
        towards_run_ups: whether postures on the way to the states' own run-ups are tried, too.
    """
    offsets, _ = _nearby_offsets(towards_run_ups)
    return soonest(problem, *_moved_nearby(problem, *soonest(problem, q, qd), states_near, offsets, towards_run_ups))


def slower_nearby(
    problem: ThrowProblem, q: Array, qd: Array, states_near: StatesNear, towards_run_ups: bool = False
) -> tuple[Array, Array]:
    """Returns the states of `soonest_nearby`, moved on until one keeps the speed limits where all exceed them a little.

    Takes what that does. States that were moved on are neither sorted nor distinct.
    """
    for offsets in _nearby_offsets(towards_run_ups)[1]:
        least = penalised_bound(problem, q, qd).min(initial=np.inf)
        if not TOO_FAST_S <= least <= A_LITTLE * TOO_FAST_S:
            break
        q, qd = _moved_nearby(problem, *soonest(problem, q, qd), states_near, [offsets], towards_run_ups)
    return q, qd


def soonest(problem: ThrowProblem, q: Array, qd: Array) -> tuple[Array, Array]:
    """Returns those of the states q, qd (m, 6) that are kept: see `_soonest`."""
    rows = _soonest(problem, q, qd)
    return q[rows], qd[rows]


def _moved_nearby(
    problem: ThrowProblem,
    q: Array,
    qd: Array,
    states_near: StatesNear,
    offsets: Sequence[Array],
    towards_run_ups: bool,
) -> tuple[Array, Array]:
    """Returns the states q, qd (n, 6), the first moved to sooner ones near them in which the arm is clear.

    Those are the first `MOVED`, and the first of every aspect.

    Args:
        problem: the problem.
        q: postures (n, 6), the soonest first.
        qd: their joint velocities (n, 6).
        states_near: returns states q, qd (m, 6) next to postures (m, 6); NaN where there is none.
        offsets: of the postures that are tried in turn, each (MOVED, k, 6) [rad].
        towards_run_ups: whether postures on the way to the states' own run-ups are tried, too.
    """
    q = q.copy()
    qd = qd.copy()
    body = body_model(problem.cell_with_bin)
    aspect = aspects(problem.cell.robot, q)
    rows = np.union1d(np.arange(min(MOVED, len(q))), first_rows(aspect))
    bound = penalised_bound(problem, q[rows], qd[rows])
    for each in offsets:
        tried = q[rows, None] + each[np.arange(len(rows)) % MOVED]
        if towards_run_ups:
            tried = np.concatenate([tried, _towards_run_ups(problem, q[rows], qd[rows], bound)], axis=1)
        near_q, near_qd = states_near(tried.reshape(-1, 6))
        near = penalised_bound(problem, near_q, near_qd).reshape(tried.shape[:2])
        if towards_run_ups:
            stays = aspects(problem.cell.robot, near_q).reshape(near.shape) == aspect[rows, None]
            near = np.where(stays, near, np.inf)
        moved = np.flatnonzero(near.min(axis=1) < bound)
        best = moved * tried.shape[1] + near[moved].argmin(axis=1)
        clear = body.clearances(near_q[best]).least >= 0.0
        moved = moved[clear]
        best = best[clear]
        q[rows[moved]] = near_q[best]
        qd[rows[moved]] = near_qd[best]
        bound[moved] = near.ravel()[best]
    return q, qd


def _towards_run_ups(problem: ThrowProblem, q: Array, qd: Array, bound: Array) -> Array:
    """Returns postures (n, 6, 6) on the way from postures q (n, 6) to their run-ups.

    From those a constant acceleration leads to the velocities qd (n, 6): in the time `bound` (n,) [s], or each joint's
    largest one in as short a time as it takes.
    """
    ways = (bound[:, None] / 2.0, np.abs(qd) / (2.0 * problem.limits.qdd_max))
    steps = np.stack([problem.start + qd * way - q for way in ways], axis=1)
    return (q[:, None, None] + RUN_UP_SHARES[:, None] * steps[:, :, None]).reshape(len(q), -1, q.shape[1])


def penalised_bound(problem: ThrowProblem, q: Array, qd: Array) -> Array:
    """Returns the lower bounds (..., n) [s] of states with velocities `qd` (..., n, 6) in postures `q` (n, 6).

    Beyond all others for states that are too fast; infinite for NaN.
    """
    limits = problem.limits
    bounds = limits.qd_max, limits.qdd_max
    return native.penalised_bounds(q, qd.reshape(-1, 6), problem.start, bounds, TOO_FAST_S).reshape(qd.shape[:-1])


def _soonest(problem: ThrowProblem, q: Array, qd: Array) -> Index:
    """Returns the rows of up to `STATES_MAX` distinct states of least lower bound, and of the soonest of every aspect.

    If all states are too fast, the slowest.
    """
    bound = penalised_bound(problem, q, qd)
    order = np.argsort(bound, kind="stable")
    usable = order[bound[order] < TOO_FAST_S]
    if len(usable) == 0:
        return order[:STATES_MAX]
    first = first_rows(aspects(problem.cell.robot, q[usable]))
    others = native.distinct_rows(q[usable], APART_RAD, STATES_MAX)
    return usable[np.concatenate([others, first[~np.isin(first, others)]])]


@cache
def _nearby_offsets(towards_run_ups: bool) -> tuple[list[Array], list[Array]]:
    """Returns joint offsets (MOVED, k, 6) [rad] for each of the usual shares, and for each of `SLOWER_SHARES`."""
    usual, count = (NEARBY_RUN_UPS_SHARES, NEARBY_RUN_UPS) if towards_run_ups else (NEARBY_SHARES, NEARBY)
    shares = (*usual, *SLOWER_SHARES)
    offsets = joint_offsets(len(shares) * MOVED * count).reshape(len(shares), MOVED, count, 6)
    scaled = [read_only(share * each) for share, each in zip(shares, offsets, strict=True)]
    return scaled[: len(usual)], scaled[len(usual) :]
