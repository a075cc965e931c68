"""How far two arms of one model are apart: what a calibration corrects."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from planner.arrays import Array, read_only
from planner.kinematics.forward_kinematics import forward
from planner.robots import Robot
from planner.rotations import angle_between

POSTURES = 2000  # [-] evenly drawn postures on which two arms are compared: the largest found is the largest to 5 %
DIFFERENCES_KEPT = 64  # pairs of arms whose difference is cached


@dataclass(frozen=True)
class ChainDifference:
    """Distance of the flanges of two arms at the same joint positions, over evenly drawn postures.

    Attributes:
        median_m, largest_m: distances [m].
        largest_rad: largest angle between them [rad].
    """

    median_m: float
    largest_m: float
    largest_rad: float

    def words(self, decimals: int = 1) -> str:
        """Returns the distances as a sentence says them."""
        median, largest = (f"{1e3 * value:.{decimals}f} mm" for value in (self.median_m, self.largest_m))
        return f"{median} in the median of postures, up to {largest}"


@lru_cache(maxsize=DIFFERENCES_KEPT)
def chain_difference(first: Robot, second: Robot) -> ChainDifference:
    """Returns how far two arms are apart."""
    X, Y = (forward(robot, _postures()) for robot in (first, second))
    apart = np.linalg.norm(X[:, :3, 3] - Y[:, :3, 3], axis=1)
    turned = max(angle_between(R, S) for R, S in zip(X[:, :3, :3], Y[:, :3, :3], strict=True))
    return ChainDifference(float(np.median(apart)), float(apart.max()), turned)


@lru_cache(maxsize=1)
def _postures() -> Array:
    return read_only(np.random.default_rng(0).uniform(-np.pi, np.pi, (POSTURES, 6)))
