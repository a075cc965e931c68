"""Kinematics of one arm on plain Python floats: some 20 us per call; small numpy arrays cost several times as much.

The planner's kinematics is the reference; tests compare the two. A transform is a tuple of twelve numbers, the upper
three rows of the homogeneous matrix, row by row. A pose is UR's: position [m] and rotation vector [rad].
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from planner.calibration import DhTable
from planner.robots import Robot
from simulator.physics.controller_kinematics import controller_table
from simulator.truth import DhDeviation

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
        theta: its offsets of the joint positions (6,) [rad].
    """

    def __init__(self, table: DhTable) -> None:
        self.table = table
        self.theta: list[float] = table.theta.tolist()
        self.links = [(a, d, math.cos(alpha), math.sin(alpha)) for _, a, d, alpha in table.rows]

    def forward(self, q: Vector, tool: Transform = IDENTITY) -> Transform:
        """Returns the pose of the tool in the base."""
        return self.motion(q, (0.0,) * 6, tool)[0]

    def motion(self, q: Vector, qd: Vector, tool: Transform = IDENTITY) -> tuple[Transform, list[float]]:
        """Returns the pose of the tool and its twist (vx, vy, vz, wx, wy, wz), both in the base."""
        axes, pose = self._axes(q, tool)
        px = pose[3]
        py = pose[7]
        pz = pose[11]
        vx = vy = vz = wx = wy = wz = 0.0
        for (zx, zy, zz, ox, oy, oz), v in zip(axes, qd, strict=True):
            rx = px - ox
            ry = py - oy
            rz = pz - oz
            vx += v * (zy * rz - zz * ry)
            vy += v * (zz * rx - zx * rz)
            vz += v * (zx * ry - zy * rx)
            wx = wx + v * zx
            wy = wy + v * zy
            wz = wz + v * zz
        return pose, [vx, vy, vz, wx, wy, wz]

    def jacobian(self, q: Vector, tool: Transform = IDENTITY) -> tuple[np.ndarray, Transform]:
        """Returns the geometric Jacobian (6, 6) of the tool in the base, rows v then w, and its pose."""
        axes, pose = self._axes(q, tool)
        columns = []
        for zx, zy, zz, px, py, pz in axes:
            rx = pose[3] - px
            ry = pose[7] - py
            rz = pose[11] - pz
            columns.append((zy * rz - zz * ry, zz * rx - zx * rz, zx * ry - zy * rx, zx, zy, zz))
        return np.array(columns).T, pose

    def _axes(self, q: Vector, tool: Transform) -> tuple[list[tuple[float, ...]], Transform]:
        """Returns direction and origin of each joint's axis, and the pose of the tool."""
        axes = []
        pose = IDENTITY
        for (a, d, ca, sa), angle, offset in zip(self.links, q, self.theta, strict=True):
            axes.append((pose[2], pose[6], pose[10], pose[3], pose[7], pose[11]))
            c = math.cos(angle + offset)
            s = math.sin(angle + offset)
            pose = product(pose, (c, -s * ca, s * sa, a * c, s, c * ca, -c * sa, a * s, 0.0, sa, ca, d))
        return axes, product(pose, tool)

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


class PublishedChain(KinematicChain):
    """An arm exactly as published: its motion has a closed form, which all arms of Universal Robots share.

    Joint 1 is vertical; joints 2, 3 and 4 are parallel; joints 5 and 6 are each perpendicular to the one before.
    """

    def __init__(self, robot: Robot) -> None:
        super().__init__(controller_table(robot))
        self.lengths = tuple(float(x) for x in (robot.d[0], robot.a[1], robot.a[2], robot.d[3], robot.d[4], robot.d[5]))

    def motion(self, q: Vector, qd: Vector, tool: Transform = IDENTITY) -> tuple[Transform, list[float]]:
        """Returns the pose of the tool and its twist (vx, vy, vz, wx, wy, wz), both in the base.

        e and the vertical span the plane of the arm; n is its normal, the axis of joints 2 to 4. The lengths r and h
        are the coordinates of elbow (1) and wrist (2) along e and upwards. One formula, hence one long function.
        """
        q1, q2, q3, q4, q5, q6 = q
        d1, a2, a3, d4, d5, d6 = self.lengths
        ex = math.cos(q1)
        ey = math.sin(q1)
        nx = math.sin(q1)
        ny = -math.cos(q1)
        c4 = math.cos(q2 + q3 + q4)
        s4 = math.sin(q2 + q3 + q4)
        c5 = math.cos(q5)
        s5 = math.sin(q5)
        c6 = math.cos(q6)
        s6 = math.sin(q6)
        r1 = a2 * math.cos(q2)
        h1 = a2 * math.sin(q2) + d1
        r2 = r1 + a3 * math.cos(q2 + q3)
        h2 = h1 + a3 * math.sin(q2 + q3)
        xx = c4 * ex
        xy = c4 * ey
        xz = s4  # x axis of frame 4
        bx = s4 * ex
        by = s4 * ey
        bz = -c4  # axis of joint 5
        ax = c5 * nx - s5 * xx
        ay = c5 * ny - s5 * xy
        az = -s5 * xz  # axis of joint 6
        ux = c5 * xx + s5 * nx
        uy = c5 * xy + s5 * ny
        uz = c5 * xz  # x axis of frame 5
        p4x = r2 * ex + d4 * nx
        p4y = r2 * ey + d4 * ny
        p5x = p4x + d5 * bx
        p5y = p4y + d5 * by
        p5z = h2 + d5 * bz
        pose: Transform = (
            c6 * ux - s6 * bx, -s6 * ux - c6 * bx, ax, p5x + d6 * ax,
            c6 * uy - s6 * by, -s6 * uy - c6 * by, ay, p5y + d6 * ay,
            c6 * uz - s6 * bz, -s6 * uz - c6 * bz, az, p5z + d6 * az,
        )  # fmt: skip
        if tool is not IDENTITY:
            pose = product(pose, tool)
        v1, v2, v3, v4, v5, v6 = qd
        px = pose[3]
        py = pose[7]
        pz = pose[11]
        v234 = v2 + v3 + v4
        along = ex * px + ey * py  # coordinate of the tool along e
        out = -(v2 * (pz - d1) + v3 * (pz - h1) + v4 * (pz - h2))
        up = v234 * along - v3 * r1 - v4 * r2
        fx = px - p4x
        fy = py - p4y
        fz = pz - h2
        gx = px - p5x
        gy = py - p5y
        gz = pz - p5z
        return pose, [
            out * ex - v1 * py + v5 * (by * fz - bz * fy) + v6 * (ay * gz - az * gy),
            out * ey + v1 * px + v5 * (bz * fx - bx * fz) + v6 * (az * gx - ax * gz),
            up + v5 * (bx * fy - by * fx) + v6 * (ax * gy - ay * gx),
            v234 * nx + v5 * bx + v6 * ax, v234 * ny + v5 * by + v6 * ay, v1 + v5 * bz + v6 * az,
        ]  # fmt: skip


def kinematic_chain(robot: Robot, deviation: DhDeviation | None) -> KinematicChain:
    """Returns the chain of an arm that deviates from the published one; None: the arm as the cell has it."""
    if deviation is None and robot.fixed is None:
        return PublishedChain(robot)
    return KinematicChain(controller_table(robot, deviation))


def pose_error(goal: Transform, pose: Transform) -> list[float]:
    """Returns the twist (6,) in the base that moves `pose` to `goal` in unit time."""
    turn = rotation_vector(product(goal, inverse(pose)))
    return [goal[3] - pose[3], goal[7] - pose[7], goal[11] - pose[11], *turn]
