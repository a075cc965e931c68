"""Kinematics of one arm on plain Python floats: some 20 us per call; small numpy arrays cost several times as much.

The planner's kinematics is the reference; tests compare the two. A transform is a tuple of twelve numbers, the upper
three rows of the homogeneous matrix, row by row. A pose is UR's: position [m] and rotation vector [rad].
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from planner.calibration import DhTable

Transform = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
Vector = Sequence[float]

IDENTITY: Transform = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
SMALL_ANGLE = 1e-12  # [rad] below it a rotation vector counts as zero
NEAR_PI = 1e-6  # [rad] this close to half a turn, the axis is read from the symmetric part of the matrix
STEP_MAX = 0.3  # [rad] largest joint step of one Newton iteration
DAMPING_FAR = 1e-4
DAMPING_NEAR = 1e-9  # of the normal equations, far from and close to the solution
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
    x = t[3]
    y = t[7]
    z = t[11]
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
    ux = rx / angle
    uy = ry / angle
    uz = rz / angle
    c = math.cos(angle)
    s = math.sin(angle)
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


class KinematicChain:
    """The arm's joints with a tool at their end, by their Denavit–Hartenberg parameters, whatever these are.

    Attributes:
        table: the parameters, as the controller tells them.
    """

    def __init__(self, table: DhTable) -> None:
        self.table = table
        self.links = [(theta, a, d, math.cos(alpha), math.sin(alpha)) for theta, a, d, alpha in table.rows]

    def frames(self, q: Vector) -> list[Transform]:
        """Returns the frames of base and links (7) in the base; joint i turns about the z axis of frame i."""
        found = [IDENTITY]
        for (theta, a, d, ca, sa), angle in zip(self.links, q, strict=True):
            c = math.cos(angle + theta)
            s = math.sin(angle + theta)
            found.append(product(found[-1], (c, -s * ca, s * sa, a * c, s, c * ca, -c * sa, a * s, 0.0, sa, ca, d)))
        return found

    def forward(self, q: Vector, tool: Transform = IDENTITY) -> Transform:
        """Returns the pose of the tool in the base."""
        return product(self.frames(q)[-1], tool)

    def motion(self, q: Vector, qd: Vector, tool: Transform = IDENTITY) -> tuple[Transform, list[float]]:
        """Returns the pose of the tool and its twist (vx, vy, vz, wx, wy, wz), both in the base."""
        columns, pose = self._columns(q, tool)
        return pose, [sum(v * x for v, x in zip(qd, row, strict=True)) for row in zip(*columns, strict=True)]

    def jacobian(self, q: Vector, tool: Transform = IDENTITY) -> tuple[np.ndarray, Transform]:
        """Returns the geometric Jacobian (6, 6) of the tool in the base, rows v then w, and its pose."""
        columns, pose = self._columns(q, tool)
        return np.array(columns).T, pose

    def _columns(self, q: Vector, tool: Transform) -> tuple[list[tuple[float, ...]], Transform]:
        """Returns the twist of the tool by the unit speed of each joint, and the pose of the tool."""
        *joints, flange = self.frames(q)
        pose = product(flange, tool)
        point = (pose[3], pose[7], pose[11])
        return [(*_turned(joint, point), joint[2], joint[6], joint[10]) for joint in joints], pose

    def solve(self, goal: Transform, near: Vector, tool: Transform = IDENTITY) -> list[float] | None:
        """Returns joint angles (6,) near `near` that put the tool at `goal`, None if Newton's method finds none."""
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


def point_motion(frames: Sequence[Transform], qd: Vector, place: Vector = (0.0, 0.0, 0.0)) -> tuple[Vector, Vector]:
    """Returns position and velocity, in the base, of a point that moves with the last of some frames [m, m/s].

    Args:
        frames: of the base and the links up to the one that carries the point.
        qd: joint speeds [rad/s]; those beyond the links are ignored.
        place: of the point in the last frame [m].
    """
    *joints, t = frames
    x, y, z = place
    point = [t[i] * x + t[i + 1] * y + t[i + 2] * z + t[i + 3] for i in (0, 4, 8)]
    velocity = [0.0, 0.0, 0.0]
    for joint, rate in zip(joints, qd, strict=False):
        velocity = [v + rate * w for v, w in zip(velocity, _turned(joint, point), strict=True)]
    return point, velocity


def _turned(joint: Transform, point: Vector) -> tuple[float, float, float]:
    """Returns the velocity of a point that turns with unit speed about the z axis of a frame."""
    x = point[0] - joint[3]
    y = point[1] - joint[7]
    z = point[2] - joint[11]
    return (joint[6] * z - joint[10] * y, joint[10] * x - joint[2] * z, joint[2] * y - joint[6] * x)


def pose_error(goal: Transform, pose: Transform) -> list[float]:
    """Returns the twist (6,) in the base that moves `pose` to `goal` in unit time."""
    turn = rotation_vector(product(goal, inverse(pose)))
    return [goal[3] - pose[3], goal[7] - pose[7], goal[11] - pose[11], *turn]
