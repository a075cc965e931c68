"""Ways to the plan's start: straight joint moves that keep clear, one or several after the other."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from executor.surroundings import Space, Ways

Vector = NDArray[np.float64]

STEP_RAD = 0.005  # [rad] spacing at which a move is looked at; in between the bound of `Space` holds
NEAR_RAD = 1e-3  # [rad] an arm this close to the start has no way to go


def find_way(space: Space, now: Vector, start: Vector) -> tuple[list[Vector], str]:
    """Returns the positions (K, 6) to pass from `now` to `start` [rad], or none of them and what stands in the way.

    Tried in turn: straight; over home; base or arm first; up to home's shape before turning. The first clear one wins.
    """
    if np.abs(start - now).max() < NEAR_RAD:
        return [start], ""
    first_hit = ""
    for way in _candidates(now, start, space.cell.home):
        hit = next((name for a, b in zip([now, *way], way, strict=False) if (name := _hit(space, a, b))), "")
        if not hit:
            return way, ""
        first_hit = first_hit or hit
    return [], first_hit


def _candidates(now: Vector, start: Vector, home: Vector) -> Iterator[list[Vector]]:
    def turned_to(base: Vector, arm: Vector) -> Vector:
        return np.concatenate([base[:1], arm[1:]])

    yield [start]
    yield [home, start]
    yield [turned_to(start, now), start]
    yield [turned_to(now, start), start]
    yield [turned_to(now, home), turned_to(start, home), start]


def _hit(space: Space, a: Vector, b: Vector) -> str:
    count = int(np.ceil(np.abs(b - a).max() / STEP_RAD)) + 1
    if count < 2:
        return ""
    way = a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)
    limits = space.cell.limits
    if (way < limits.q_lower - NEAR_RAD).any() or (way > limits.q_upper + NEAR_RAD).any():
        return "a joint's limit"
    return space.judge(Ways.straight(way[None]))[1]
