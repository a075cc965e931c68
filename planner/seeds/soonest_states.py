"""Which joint states a launch can be at soonest: a lower bound, the choice by it, and sooner states nearby."""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, Index
from planner.cell import Limits
from planner.native import loops
from planner.problem import ThrowProblem
from planner.seeds.aspects import aspects, first_rows

STATES_MAX = 48  # states kept, those of the least lower bound that are apart from one another
APART_RAD = 0.35  # [rad] least difference of two kept states in some joint
TOO_FAST_S = 1e3  # [s] penalty per multiple of a speed limit: every state that is too fast comes after all others


def least_time(distance: Array, qd: Array, limits: Limits, qd0: Array | float = 0.0) -> Array:
    """Returns a lower bound (...,) [s] on the time from the velocity `qd0` over `distance` to the velocity `qd`.

    The maximum over the joints of each joint's own least time with unbounded jerk. Source: time-optimal control of a
    double integrator with bounded acceleration and velocity (Pontryagin; e.g. Biagiotti and Melchiorri, Trajectory
    Planning for Automatic Machines and Robots, Springer 2008, section 3.2).

    Args:
        distance: joint distances (..., n) [rad].
        qd: joint velocities (..., n) at the end [rad/s].
        limits: of velocity and acceleration.
        qd0: joint velocities (n,) at the start [rad/s]; at rest by default.
    """
    v_max = limits.qd_max
    a_max = limits.qdd_max
    turn = np.where(distance >= (qd0 + qd) * np.abs(qd - qd0) / (2.0 * a_max), 1.0, -1.0)
    d = turn * distance
    v = turn * qd
    v0 = turn * qd0
    peak = np.sqrt(np.maximum(a_max * d + (v**2 + v0**2) / 2.0, 0.0))
    direct = (2.0 * peak - v - v0) / a_max
    accelerating = (2.0 * v_max**2 - v**2 - v0**2) / (2.0 * a_max)
    cruising = (2.0 * v_max - v - v0) / a_max + (d - accelerating) / v_max
    return np.where(peak <= v_max, direct, cruising).max(axis=-1)


def soonest(problem: ThrowProblem, q: Array, qd: Array) -> tuple[Array, Array]:
    """Returns those of the states q, qd (m, 6) that are kept: see `_soonest`."""
    rows = _soonest(problem, q, qd)
    return q[rows], qd[rows]


def penalised_bound(problem: ThrowProblem, q: Array, qd: Array) -> Array:
    """Returns the lower bounds (..., n) [s] of states with velocities `qd` (..., n, 6) in postures `q` (n, 6).

    Too-fast states sort last; infinite for NaN.
    """
    limits = problem.limits
    bounds = limits.qd_max, limits.qdd_max
    return loops.penalised_bounds(q, qd.reshape(-1, 6), problem.start, bounds, TOO_FAST_S).reshape(qd.shape[:-1])


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
    others = loops.distinct_rows(q[usable], APART_RAD, STATES_MAX)
    return usable[np.concatenate([others, first[~np.isin(first, others)]])]
