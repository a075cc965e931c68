"""Allocation of a tool velocity to the joints, within their speed limits.

The linear velocity fixes three of six degrees of freedom. The solution is the least-norm one, weighted by the joints'
speed limits; where that exceeds a limit, or a balanced one is asked for, one with a smaller maximum share of them.
"""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, read_only
from planner.kinematics import jacobian, point_motion
from planner.native import loops
from planner.problem import ThrowProblem

REDUCIBLE_EXCESS = 1.5  # [-] times a limit; the maximum norm seldom reduces the largest share by a greater factor
REDUCED_MAX = 300  # states whose largest share is reduced
SHARE_FLOOR = 0.1  # [-] of the largest share; smaller ones would be weighted without bound
GRAM_FLOOR = 1e-13  # [-] keeps a singular posture solvable; changes velocities of equal weights by less than 1e-9
REFINEMENTS = (
    2  # weights a million apart miss the tool velocity by 2e-5 m/s without, by 6e-10 after one, 2e-12 after two
)
# p, whole numbers, of the p-norms on the way from the 2-norm to the maximum norm
NORMS = read_only([3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 8.0, 8.0])


def allocate_velocity(J: Array, v: Array, qd_max: Array) -> Array:
    """Returns joint velocities (..., n, 6) [rad/s] for tool velocities `v` (..., n, 3) [m/s].

    Least squares weighted with qd_max^2; where that exceeds a limit by a factor below `REDUCIBLE_EXCESS`, the largest
    share of a limit is reduced by going from the 2-norm towards the maximum norm.

    Args:
        J: linear Jacobians (n, 3, 6) in the frame of `v` [m/rad].
        v: tool velocities; may have leading dimensions that `J` lacks.
        qd_max: speed limits (6,) [rad/s].
    """
    v = np.zeros(J.shape[:-1]) + v
    qd = least_norm(J, v, qd_max)
    excess = largest_share(qd, qd_max)
    rows = np.flatnonzero((excess > 1.0) & (excess < REDUCIBLE_EXCESS))
    rows = np.unravel_index(rows[np.argsort(excess.ravel()[rows], kind="stable")][:REDUCED_MAX], excess.shape)
    qd[rows] = _towards_maximum_norm(J[rows[-1]], v[rows], qd[rows], qd_max)
    return qd


def balanced_velocity(J: Array, v: Array, qd_max: Array) -> Array:
    """Returns joint velocities (n, 6) [rad/s] for tool velocities `v` (n, 3) [m/s] of about the least largest share.

    All joints that the tool's velocity needs take about the same share of `qd_max`: so they are up to speed soonest.

    Args:
        J: linear Jacobians (n, 3, 6) in the frame of `v` [m/rad].
        v: tool velocities.
        qd_max: what the shares are of (6,), speed limits for one [rad/s].
    """
    qd = least_norm(J, v, qd_max)
    rows = np.flatnonzero(np.isfinite(qd).all(axis=1))
    qd[rows] = _towards_maximum_norm(J[rows], v[rows], qd[rows], qd_max)
    return qd


def tool_jacobian(problem: ThrowProblem, q: Array) -> Array:
    """Returns the linear Jacobian (n, 3, 6) [m/rad] of the tool centre, in the base frame."""
    return jacobian(problem.cell.robot, q, problem.cell.tool.X_FT)[:, :3, :]


def tool_motion(problem: ThrowProblem, q: Array) -> tuple[Array, Array]:
    """Returns the positions (n, 3) [m] of the tool centre and its linear Jacobians (n, 3, 6), in the base frame."""
    return point_motion(problem.cell.robot, q, problem.cell.tool.X_FT[:3, 3])


def tool_velocity(J: Array, qd: Array) -> Array:
    """Returns the tool velocities (n, 3) [m/s] of joint velocities `qd` (n, 6), in the frame of `J` (n, 3, 6)."""
    return np.asarray((J @ qd[..., None])[..., 0])


def largest_share(qd: Array, qd_max: Array) -> Array:
    """Returns the largest share (...,) [-] of the speed limits (6,) in joint velocities `qd` (..., 6)."""
    return loops.largest_shares(qd.reshape(-1, 6), qd_max).reshape(qd.shape[:-1])


def least_norm(J: Array, v: Array, qd_max: Array) -> Array:
    """Returns the joint velocities (..., n, 6) of least norm, weighted with qd_max^2, for v (..., n, 3)."""
    qd = loops.least_norms(J, qd_max**2, np.ascontiguousarray(v).reshape(-1, 3), GRAM_FLOOR)
    return qd.reshape(*v.shape[:-1], 6)


def _towards_maximum_norm(J: Array, v: Array, qd: Array, qd_max: Array) -> Array:
    """Returns `qd` (n, 6) after damped iteratively reweighted least squares.

    Source: Burrus, Iterative Reweighted Least Squares, 2012.
    """
    return loops.lower_shares((J, v, qd), qd_max, NORMS, (SHARE_FLOOR, GRAM_FLOOR), REFINEMENTS)
