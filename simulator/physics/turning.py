"""How a thrown body turns, and how far it reaches down: the simulator's own, apart from the planner's.

Free of torque its angular momentum L stays in the world. So its axes R turn with the angular velocity R I^-1 R^T L, and
the quaternion alone is integrated, by the classical fourth-order Runge-Kutta method. Its lowest point is the lowest of
points on it: the corners of a box, points on the rims of a cylinder, the lowest points of a capsule's two balls.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.cell import ThrownBody

Vector = NDArray[np.float64]
Quaternion = tuple[float, float, float, float]  # w x y z

STEP_RAD = 0.02  # [rad] of one integration step: its error is below 1e-9 rad
RIM_POINTS = 128  # [-] of each rim: between two of them it is lower by 0.03 % of its radius


@dataclass(frozen=True)
class Turning:
    """How a body is turned, and turns.

    Attributes:
        q: quaternion of its axes in the world, w first.
        momentum: its angular momentum there, of a body whose mass is the cell's (3,) [kg m^2/s].
    """

    q: Quaternion
    momentum: tuple[float, float, float]


class TurningBody:
    """A body: its moments of inertia, and points of it.

    Attributes:
        farthest_m: distance of its farthest point from its centre [m].
    """

    def __init__(self, thing: ThrownBody) -> None:
        """Takes the object of a cell."""
        self._R_TO: Vector = thing.R_TO
        self._moments: list[float] = thing.inertia_kg_m2.tolist()
        self._points, self._radius_m = _points(thing.kind, *(0.5 * thing.size_m).tolist())
        self.farthest_m = float(np.linalg.norm(self._points, axis=1).max()) + self._radius_m

    def leaving(self, R_WT: Vector, w_W: Sequence[float]) -> Turning:
        """Returns how it turns as it leaves a tool with axes (3, 3) and angular velocity (3,) [rad/s] in the world."""
        R_WO = R_WT @ self._R_TO
        momentum = R_WO @ (np.array(self._moments) * (R_WO.T @ np.asarray(w_W, float)))
        return Turning(_quaternion(R_WO), tuple(momentum.tolist()))

    def after(self, turning: Turning, s: float) -> Turning:
        """Returns how it turns `s` [s] later."""
        steps = max(1, math.ceil(self.speed(turning) * abs(s) / STEP_RAD))
        h = s / steps
        q = turning.q
        for _ in range(steps):
            k1 = self._rate(q, turning.momentum)
            k2 = self._rate(_moved(q, 0.5 * h, k1), turning.momentum)
            k3 = self._rate(_moved(q, 0.5 * h, k2), turning.momentum)
            k4 = self._rate(_moved(q, h, k3), turning.momentum)
            mean = tuple((a + 2.0 * b + 2.0 * c + d) / 6.0 for a, b, c, d in zip(k1, k2, k3, k4, strict=True))
            q = _moved(q, h, mean)
            size = math.sqrt(sum(x * x for x in q))
            q = (q[0] / size, q[1] / size, q[2] / size, q[3] / size)
        return replace(turning, q=q)

    def axes(self, turning: Turning) -> Vector:
        """Returns its axes (3, 3) in the world."""
        return np.array(_rows(turning.q))

    def speed(self, turning: Turning) -> float:
        """Returns a bound on its angular velocity in flight [rad/s]: sqrt(5) times that of now, see `planner.spin`."""
        return math.sqrt(5.0) * self._speed(turning)

    def below(self, turning: Turning) -> float:
        """Returns how far it reaches below its centre [m]."""
        return self._radius_m - float((self._points @ np.array(_rows(turning.q)[2])).min())

    def _speed(self, turning: Turning) -> float:
        """Returns the angular velocity [rad/s]."""
        return math.sqrt(sum(x * x for x in self._velocity(_rows(turning.q), turning.momentum)))

    def _velocity(self, rows: list[list[float]], momentum: Sequence[float]) -> list[float]:
        """Returns the angular velocity (3,) in the world [rad/s] for axes with these rows."""
        own = [sum(rows[i][k] * momentum[i] for i in range(3)) / self._moments[k] for k in range(3)]
        return [sum(rows[i][k] * own[k] for k in range(3)) for i in range(3)]

    def _rate(self, q: Sequence[float], momentum: Sequence[float]) -> tuple[float, float, float, float]:
        """Returns the derivative of the quaternion."""
        w, x, y, z = q
        a, b, c = self._velocity(_rows(q), momentum)
        return (
            0.5 * (-a * x - b * y - c * z),
            0.5 * (a * w + b * z - c * y),
            0.5 * (b * w + c * x - a * z),
            0.5 * (c * w + a * y - b * x),
        )


def _points(kind: str, x: float, y: float, z: float) -> tuple[Vector, float]:
    """Returns points (n, 3) of a body with these half sizes, and a radius [m] about each, among them its lowest."""
    if kind == "box":
        return np.array([[i * x, j * y, k * z] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], float), 0.0
    if kind == "capsule":
        return np.array([[0.0, 0.0, x - z], [0.0, 0.0, z - x]]), x
    angle = np.arange(RIM_POINTS) * 2.0 * math.pi / RIM_POINTS
    rim = np.column_stack([x * np.cos(angle), x * np.sin(angle)])
    return np.concatenate([np.column_stack([rim, np.full(RIM_POINTS, end)]) for end in (-z, z)]), 0.0


def _moved(q: Sequence[float], h: float, rate: Sequence[float]) -> Quaternion:
    """Returns a quaternion moved at a rate for `h` [s]; not a unit one."""
    w, x, y, z = (a + h * b for a, b in zip(q, rate, strict=True))
    return (w, x, y, z)


def _rows(q: Sequence[float]) -> list[list[float]]:
    """Returns the rows of the rotation matrix of a quaternion, which need not be a unit one."""
    w, x, y, z = q
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return [
        [1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
        [s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)],
        [s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)],
    ]


def _quaternion(R: Vector) -> Quaternion:
    """Returns the quaternion of a rotation matrix: the eigenvector of Bar-Itzhack's matrix with the largest value."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    K = np.array(
        [
            [a - e - i, d + b, g + c, h - f],
            [d + b, e - a - i, h + f, c - g],
            [g + c, h + f, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    x, y, z, w = np.linalg.eigh(K)[1][:, 3].tolist()
    return (w, x, y, z)
