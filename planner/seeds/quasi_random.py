"""Evenly spread samples from a fixed quasi-random sequence: the same request always has the same samples."""

from __future__ import annotations

from functools import cache

import numpy as np

from planner.arrays import Array, read_only

SPREAD_RAD = np.array([np.pi, 1.8, 1.8, 2.2, 2.2, np.pi])  # [rad] farthest joint states from the start


@cache
def _halton(count: int, dimension: int) -> Array:
    """Returns a Halton sequence (count, dimension) in (0, 1).

    Source: Halton 1960, doi 10.1007/BF01386213.
    """
    primes = (2, 3, 5, 7, 11, 13)[:dimension]
    columns = []
    for prime in primes:
        index = np.arange(1, count + 1)
        value = np.zeros(count)
        scale = 1.0 / prime
        while index.any():
            value += scale * (index % prime)
            index = index // prime
            scale = scale / prime
        columns.append(value)
    return read_only(np.stack(columns, axis=1))


def quaternions(count: int) -> Array:
    """Returns evenly spread unit quaternions (count, 4). Source: Shoemake, Graphics Gems III (1992), p. 124."""
    u = _halton(count, 3)
    angle_1 = 2.0 * np.pi * u[:, 1]
    angle_2 = 2.0 * np.pi * u[:, 2]
    low = np.sqrt(1.0 - u[:, 0])
    high = np.sqrt(u[:, 0])
    return np.stack(
        [low * np.sin(angle_1), low * np.cos(angle_1), high * np.sin(angle_2), high * np.cos(angle_2)], axis=1
    )


@cache
def joint_offsets(count: int, exponent: float) -> Array:
    """Returns joint offsets (count, 6) [rad]: spread evenly for the exponent 1, denser near zero for larger ones."""
    u = 2.0 * _halton(count, 6) - 1.0
    return read_only(SPREAD_RAD * np.sign(u) * np.abs(u) ** exponent)
