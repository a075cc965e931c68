"""Kinematics of one arm on plain Python floats: some 20 us a call, where small numpy arrays cost several times that.

The planner's kinematics is the reference; tests hold the two together. A transform is a tuple of twelve numbers, the
upper three rows of the homogeneous matrix, row by row. A pose is UR's: position [m] and rotation vector [rad].
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from planner.robots import Robot

Transform = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
Vector = Sequence[float]

IDENTITY: Transform = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
SMALL_ANGLE = 1e-12  # [rad] below it a rotation vector is taken for zero
NEAR_PI = 1e-6  # [rad] closer to half a turn the axis is read from the symmetric part
STEP_MAX = 0.3  # [rad] largest joint step of one Newton iteration
DAMPING_FAR, DAMPING_NEAR = 1e-4, 1e-9  # of the normal equations, far from and close to the solution
NEAR = 1e-2  # [m, rad] error below which the smaller damping is used
ITERATIONS_MAX = 30  # of Newton's method; from a neighbouring point it takes two or three
POSE_TOLERANCE = 1e-10  # [m, rad] largest component of the pose error of a solution


def product(a: Transform, b: Transform) -> Transform:
    """Returns the transform a b."""
    a0, a1, a2, a3, a4, a5, a6, a7, a8, a9, a10, a11 = a
    b0, b1, b2, b3, b4, b5, b6, b7, b8, b9, b10, b11 = b
    return (
        a0 * b0 + a1 * b4 + a2 * b8, a0 * b1 + a1 * b5 + a2 * b9,
        a0 * b2 + a1 * b6 + a2 * b10, a0 * b3 + a1 * b7 + a2 * b11 + a3,
        a4 * b0 + a5 * b4 + a6 * b8, a4 * b1 + a5 * b5 + a6 * b9,
        a4 * b2 + a5 * b6 + a6 * b10, a4 * b3 + a5 * b7 + a6 * b11 + a7,
        a8 * b0 + a9 * b4 + a10 * b8, a8 * b1 + a9 * b5 + a10 * b9,
        a8 * b2 + a9 * b6 + a10 * b10, a8 * b3 + a9 * b7 + a10 * b11 + a11,
    )  # fmt: skip


def inverse(t: Transform) -> Transform:
    """Returns the inverse transform."""
    x, y, z = t[3], t[7], t[11]
    return (
        t[0], t[4], t[8], -(t[0] * x + t[4] * y + t[8] * z),
        t[1], t[5], t[9], -(t[1] * x + t[5] * y + t[9] * z),
        t[2], t[6], t[10], -(t[2] * x + t[6] * y + t[10] * z),
    )  # fmt: skip


def rotation_vector(t: Transform) -> tuple[float, float, float]:
    """Returns the rotation vector [rad] of a transform, its length at most pi."""
    v = (t[9] - t[6], t[2] - t[8], t[4] - t[1])
    sine = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    angle = math.atan2(sine, t[0] + t[5] + t[10] - 1.0)
    if math.pi - angle < NEAR_PI:
        return _half_turn(t, angle)
    scale = 0.5 if sine < SMALL_ANGLE else angle / sine
    return (v[0] * scale, v[1] * scale, v[2] * scale)


def _half_turn(t: Transform, angle: float) -> tuple[float, float, float]:
    """Reads the axis u from R + 1 = 2 u u^T, which holds at half a turn, along its longest component."""
    rows = (t[0:3], t[4:7], t[8:11])
    k = max(range(3), key=lambda i: rows[i][i])
    axis = [rows[i][k] + rows[k][i] + (2.0 if i == k else 0.0) for i in range(3)]
    sign = (t[9] - t[6]) * axis[0] + (t[2] - t[8]) * axis[1] + (t[4] - t[1]) * axis[2]
    scale = math.copysign(angle, sign) / math.sqrt(sum(c * c for c in axis))
    return (axis[0] * scale, axis[1] * scale, axis[2] * scale)


def transform(pose: Vector) -> Transform:
    """Returns the transform of a pose (6,): position and rotation vector."""
    x, y, z, rx, ry, rz = pose
    angle = math.sqrt(rx * rx + ry * ry + rz * rz)
    if angle < SMALL_ANGLE:
        return (1.0, -rz, ry, x, rz, 1.0, -rx, y, -ry, rx, 1.0, z)
    ux, uy, uz = rx / angle, ry / angle, rz / angle
    c, s = math.cos(angle), math.sin(angle)
    k = 1.0 - c
    return (
        c + ux * ux * k, ux * uy * k - uz * s, ux * uz * k + uy * s, x,
        uy * ux * k + uz * s, c + uy * uy * k, uy * uz * k - ux * s, y,
        uz * ux * k - uy * s, uz * uy * k + ux * s, c + uz * uz * k, z,
    )  # fmt: skip


def pose_of(t: Transform) -> list[float]:
    """Returns the pose (6,) of a transform."""
    return [t[3], t[7], t[11], *rotation_vector(t)]


def from_matrix(matrix: np.ndarray) -> Transform:
    """Returns the transform of a 4x4 matrix."""
    return tuple(float(x) for x in matrix[:3].ravel())  # pyright: ignore[reportReturnType]


class Chain:
    """The arm's joints with a tool at their end."""

    def __init__(self, arm: Robot) -> None:
        self.links = [
            (float(a), float(d), math.cos(alpha), math.sin(alpha))
            for a, d, alpha in zip(arm.a, arm.d, arm.alpha, strict=True)
        ]

    def forward(self, q: Vector, tool: Transform = IDENTITY) -> Transform:
        """Returns the pose of the tool in the base."""
        return self.motion(q, (0.0,) * 6, tool)[0]

    def motion(self, q: Vector, qd: Vector, tool: Transform = IDENTITY) -> tuple[Transform, list[float]]:
        """Returns the pose of the tool and its twist (vx, vy, vz, wx, wy, wz), both in the base."""
        xx = yy = zz = 1.0
        xy = xz = yx = yz = zx = zy = 0.0  # column x is (xx, xy, xz), and so on
        px = py = pz = vx = vy = vz = wx = wy = wz = 0.0
        for (a, d, ca, sa), angle, rate in zip(self.links, q, qd, strict=True):
            c, s = math.cos(angle), math.sin(angle)
            wx += zx * rate
            wy += zy * rate
            wz += zz * rate
            nx, ny, nz = c * xx + s * yx, c * xy + s * yy, c * xz + s * yz
            mx, my, mz = c * yx - s * xx, c * yy - s * xy, c * yz - s * xz
            rx, ry, rz = d * zx + a * nx, d * zy + a * ny, d * zz + a * nz
            px += rx
            py += ry
            pz += rz
            vx += wy * rz - wz * ry
            vy += wz * rx - wx * rz
            vz += wx * ry - wy * rx
            xx, xy, xz = nx, ny, nz
            yx, yy, yz, zx, zy, zz = (
                ca * mx + sa * zx, ca * my + sa * zy, ca * mz + sa * zz,
                ca * zx - sa * mx, ca * zy - sa * my, ca * zz - sa * mz,
            )  # fmt: skip
        flange: Transform = (xx, yx, zx, px, xy, yy, zy, py, xz, yz, zz, pz)
        if tool is IDENTITY:
            return flange, [vx, vy, vz, wx, wy, wz]
        pose = product(flange, tool)
        rx, ry, rz = pose[3] - px, pose[7] - py, pose[11] - pz
        return pose, [vx + wy * rz - wz * ry, vy + wz * rx - wx * rz, vz + wx * ry - wy * rx, wx, wy, wz]

    def jacobian(self, q: Vector, tool: Transform = IDENTITY) -> tuple[np.ndarray, Transform]:
        """Returns the geometric Jacobian (6, 6) of the tool in the base, rows v then w, and its pose."""
        axes, pose = [], IDENTITY
        for (a, d, ca, sa), angle in zip(self.links, q, strict=True):
            axes.append((pose[2], pose[6], pose[10], pose[3], pose[7], pose[11]))
            c, s = math.cos(angle), math.sin(angle)
            pose = product(pose, (c, -s * ca, s * sa, a * c, s, c * ca, -c * sa, a * s, 0.0, sa, ca, d))
        pose = product(pose, tool)
        columns = []
        for zx, zy, zz, px, py, pz in axes:
            rx, ry, rz = pose[3] - px, pose[7] - py, pose[11] - pz
            columns.append((zy * rz - zz * ry, zz * rx - zx * rz, zx * ry - zy * rx, zx, zy, zz))
        return np.array(columns).T, pose

    def solve(self, goal: Transform, near: Vector, tool: Transform = IDENTITY) -> list[float] | None:
        """Returns joint angles near `near` that put the tool at `goal`, None where Newton's iteration finds none."""
        q = np.array(near, float)
        for _ in range(ITERATIONS_MAX):
            J, pose = self.jacobian(q.tolist(), tool)
            error = np.array(pose_error(goal, pose))
            size = float(np.abs(error).max())
            if size < POSE_TOLERANCE:
                return q.tolist()
            damping = DAMPING_NEAR if size < NEAR else DAMPING_FAR
            step = J.T @ np.linalg.solve(J @ J.T + damping * np.eye(6), error)
            q += step * min(1.0, STEP_MAX / max(float(np.abs(step).max()), STEP_MAX))
        return None


def pose_error(goal: Transform, pose: Transform) -> list[float]:
    """Returns the twist (6,) in the base that leads from `pose` to `goal` in unit time."""
    turn = rotation_vector(product(goal, inverse(pose)))
    return [goal[3] - pose[3], goal[7] - pose[7], goal[11] - pose[11], *turn]
