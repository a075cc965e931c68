"""Points spread evenly by a fixed rule: what is drawn from them is the same for the same request."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@cache
def _halton(count: int, dimension: int) -> Vector:
    """Returns a Halton sequence (count, dimension) in (0, 1): deterministic and evenly spread.

    Source: Halton 1960, doi 10.1007/BF01386213.
    """
    primes = (2, 3, 5, 7, 11, 13)[:dimension]
    columns = []
    for prime in primes:
        index, value, scale = np.arange(1, count + 1), np.zeros(count), 1.0 / prime
        while index.any():
            value += scale * (index % prime)
            index, scale = index // prime, scale / prime
        columns.append(value)
    points = np.stack(columns, axis=1)
    points.setflags(write=False)
    return points


def quaternions(count: int) -> Vector:
    """Returns unit quaternions (count, 4) spread evenly. Source: Shoemake, Graphics Gems III (1992), p. 124."""
    u = _halton(count, 3)
    angle_1, angle_2 = 2.0 * np.pi * u[:, 1], 2.0 * np.pi * u[:, 2]
    low, high = np.sqrt(1.0 - u[:, 0]), np.sqrt(u[:, 0])
    return np.stack(
        [low * np.sin(angle_1), low * np.cos(angle_1), high * np.sin(angle_2), high * np.cos(angle_2)], axis=1
    )


def offsets(count: int) -> Vector:
    """Returns joint offsets (count, 6) [rad] from the start: dense near it, as the soonest throws are, but far too."""
    u = 2.0 * _halton(count, 6) - 1.0
    return np.array([np.pi, 1.8, 1.8, 2.2, 2.2, np.pi]) * np.sign(u) * np.abs(u) ** 1.5
