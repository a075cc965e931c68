"""Distances to the three singularities of the arm, and measures of a Jacobian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array
from planner.robots import Robot

SINGULARITIES = ("wrist", "elbow", "shoulder")


@dataclass(frozen=True, eq=False)
class SingularityDistances:
    """Dimensionless distances (...) to the singularities; zero on them.

    Their product times |a2 a3| (|a2| + |a3|) is |det J| of the arm [m3].
    """

    wrist: Array
    elbow: Array
    shoulder: Array

    @property
    def minimum(self) -> Array:
        """The smallest of the three (...)."""
        return np.minimum(np.minimum(self.wrist, self.elbow), self.shoulder)


def signed_singularity_distances(robot: Robot, q: ArrayLike) -> Array:
    """Returns distances (..., 3) to wrist, elbow and shoulder singularity, signed by side and smooth in q.

    Wrist: axes 4 and 6 are parallel. Elbow: the arm is stretched or folded. Shoulder: the wrist's centre lies over the
    axis of joint 1.
    """
    q = np.asarray(q, dtype=np.float64)
    lift = q[..., 1]
    elbow = q[..., 1] + q[..., 2]
    turn = q[..., 1] + q[..., 2] + q[..., 3]
    offset = robot.a[1] * np.cos(lift) + robot.a[2] * np.cos(elbow) + robot.d[4] * np.sin(turn)
    shoulder = offset / (abs(robot.a[1]) + abs(robot.a[2]))
    return np.stack([np.sin(q[..., 4]), np.sin(q[..., 2]), shoulder], axis=-1)


def singularity_distances(robot: Robot, q: ArrayLike) -> SingularityDistances:
    """Returns the distances (...) of joint positions (..., 6) [rad] to the three singularities, each at least 0."""
    distances = np.abs(signed_singularity_distances(robot, q))
    return SingularityDistances(distances[..., 0], distances[..., 1], distances[..., 2])


def manipulability(J: ArrayLike) -> Array:
    """Returns the manipulability sqrt(det(J J^T)) (...) of a Jacobian (..., m, n). Source: Yoshikawa 1985."""
    J = np.asarray(J, dtype=np.float64)
    if J.shape[-2] > J.shape[-1]:
        return np.zeros(J.shape[:-2])
    return np.prod(np.linalg.svd(J, compute_uv=False), axis=-1)


def smallest_singular_value(J: ArrayLike) -> Array:
    """Returns the smallest singular value (...) of a Jacobian (..., m, n): twist per joint velocity at its worst."""
    s = np.linalg.svd(np.asarray(J, dtype=np.float64), compute_uv=False)
    return np.asarray(s[..., -1], dtype=np.float64)
