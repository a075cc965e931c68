"""Allocation of a tool velocity to the joints, within their speed limits.

The linear velocity fixes three of six degrees of freedom. The solution is the least-norm one, weighted by the joints'
speed limits; where that exceeds a limit, or a balanced one is asked for, one with a smaller maximum share of them.
"""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, Mask, read_only
from planner.kernel import Kernel, twin_of
from planner.kinematics import jacobian, point_motion
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


def allocate_velocity(J: Array, v: Array, qd_max: Array, wanted: Mask | None = None) -> Array:
    """Returns joint velocities (..., n, 6) [rad/s] for tool velocities `v` (..., n, 3) [m/s].

    Least squares weighted with qd_max^2; where that exceeds a limit by a factor below `REDUCIBLE_EXCESS`, the largest
    share of a limit is reduced by going from the 2-norm towards the maximum norm.

    Args:
        J: linear Jacobians (n, 3, 6) in the frame of `v` [m/rad].
        v: tool velocities; may have leading dimensions that `J` lacks.
        qd_max: speed limits (6,) [rad/s].
        wanted: mask (..., n) of the rows to be reduced; None: all.
    """
    v = np.zeros(J.shape[:-1]) + v
    qd = _least_norm(J, v, qd_max)
    if wanted is not None and not wanted.any():
        return qd
    excess = largest_share(qd, qd_max)
    over = (excess > 1.0) & (excess < REDUCIBLE_EXCESS) & (True if wanted is None else wanted)
    rows = np.flatnonzero(over)
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
    qd = _least_norm(J, v, qd_max)
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


def _compiled_share(kernel: Kernel, qd: Array, qd_max: Array) -> Array:
    return kernel.largest_shares(qd.reshape(-1, 6), qd_max).reshape(qd.shape[:-1])


@twin_of(_compiled_share, lambda: _example()[2:])
def largest_share(qd: Array, qd_max: Array) -> Array:
    """Returns the largest share (...,) [-] of the speed limits (6,) in joint velocities `qd` (..., 6)."""
    return np.asarray((np.abs(qd) / qd_max).max(axis=-1))


def _example() -> tuple[Array, Array, Array, Array]:
    """Returns Jacobians, tool velocities, joint velocities and their limits."""
    J, v, qd = (np.random.default_rng(0).uniform(-1.0, 1.0, (5, *shape)) for shape in ((3, 6), (3,), (6,)))
    return J, v, qd, np.linspace(2.0, 3.0, 6)


def _compiled_norm(kernel: Kernel, J: Array, v: Array, qd_max: Array) -> Array:
    qd = kernel.least_norms(J, qd_max**2, np.ascontiguousarray(v).reshape(-1, 3), GRAM_FLOOR)
    return qd.reshape(*v.shape[:-1], 6)


@twin_of(_compiled_norm, lambda: (_example()[0], np.ones((2, 5, 3)), _example()[-1]))
def _least_norm(J: Array, v: Array, qd_max: Array) -> Array:
    """Returns the joint velocities (..., n, 6) of least norm, weighted with qd_max^2, for v (..., n, 3)."""
    return _weighted(J, qd_max**2, v)


def _weighted(J: Array, weight: Array, v: Array, refinements: int = 0) -> Array:
    """Returns the weighted least-norm joint velocities (..., 6): W J^T (J W J^T)^-1 v for weights (..., 6).

    By Cramer's rule: for three rows and equal weights as accurate as a general solver, and far faster over thousands of
    states. Each refinement adds the solution for what the one before misses of v.
    """
    x, y, z = (J[..., i, :] for i in range(3))
    wx = weight * x
    wy = weight * y
    wz = weight * z
    xx = _dot(wx, x)
    yy = _dot(wy, y)
    zz = _dot(wz, z)
    xy = _dot(wx, y)
    xz = _dot(wx, z)
    yz = _dot(wy, z)
    floor = GRAM_FLOOR * (xx + yy + zz)
    xx = xx + floor
    yy = yy + floor
    zz = zz + floor
    c00 = yy * zz - yz * yz
    c01 = xz * yz - xy * zz
    c02 = xy * yz - xz * yy
    c11 = xx * zz - xz * xz
    c12 = xy * xz - xx * yz
    c22 = xx * yy - xy * xy
    scale = 1.0 / (xx * c00 + xy * c01 + xz * c02)

    def solution(v: Array) -> Array:
        a = v[..., 0] * scale
        b = v[..., 1] * scale
        c = v[..., 2] * scale
        first = c00 * a + c01 * b + c02 * c
        second = c01 * a + c11 * b + c12 * c
        third = c02 * a + c12 * b + c22 * c
        return first[..., None] * wx + second[..., None] * wy + third[..., None] * wz

    qd = solution(v)
    for _ in range(refinements):
        qd = qd + solution(v - _dot(J, qd[..., None, :]))
    return qd


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...j,...j->...", a, b)


def _compiled_reduction(kernel: Kernel, J: Array, v: Array, qd: Array, qd_max: Array) -> Array:
    return kernel.lower_shares((J, v, qd), qd_max, NORMS, (SHARE_FLOOR, GRAM_FLOOR), REFINEMENTS)


@twin_of(_compiled_reduction, _example)
def _towards_maximum_norm(J: Array, v: Array, qd: Array, qd_max: Array) -> Array:
    """Returns `qd` after damped iteratively reweighted least squares.

    Source: Burrus, Iterative Reweighted Least Squares, 2012.
    """
    for p in NORMS:
        share = np.abs(qd) / qd_max
        share = np.maximum(share / share.max(axis=1, keepdims=True), SHARE_FLOOR)
        step = _weighted(J, qd_max**2 * share ** (2.0 - p), v, REFINEMENTS)
        qd = qd + (step - qd) / (p - 1.0)
    return qd
