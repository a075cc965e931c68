"""Joint positions that no motion can pass: where two bodies collide that one joint alone moves to one another.

Which way the arm goes round does not matter there, so the joint's range falls into pieces, and a motion stays in the
one it begins in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from planner.cell import ToolCapsule
from planner.geometry.capsules import body_capsules
from planner.geometry.collisions import (
    SELF_CLEARANCE_M,
    Packed,
    distances_by_joint,
    packed,
    self_collision_pairs,
    unpacked,
)
from planner.robots import Robot

Array = NDArray[np.float64]

STEP_RAD = np.radians(0.5)  # positions looked at; a barrier narrower than that is left to the certificate


@dataclass(frozen=True, eq=False)
class Barrier:
    """Positions of one joint at which two bodies are too near to one another.

    Attributes:
        joint: its index.
        names: of the two bodies.
        q: the positions looked at that are blocked (k,), ascending [rad].
        distance_m: the least distance of the two.
    """

    joint: int
    names: tuple[str, str]
    q: Array
    distance_m: float


def barriers(robot: Robot, tool: Sequence[ToolCapsule]) -> tuple[Barrier, ...]:
    """Returns the barriers of an arm with a tool."""
    return _barriers(robot, packed(tool))


def passable(robot: Robot, tool: Sequence[ToolCapsule], q: Array) -> tuple[Array, Array]:
    """Returns the first blocked joint positions below and above `q` (6,), each (6,) [rad]; infinite where none is.

    From a position that is blocked itself, every other is taken for passable.
    """
    lower, upper = np.full(6, -np.inf), np.full(6, np.inf)
    for barrier in barriers(robot, tool):
        i, away = barrier.joint, barrier.q - q[barrier.joint]
        if np.abs(away).min() <= STEP_RAD:
            continue
        lower[i] = max(lower[i], barrier.q[away < 0.0].max(initial=-np.inf))
        upper[i] = min(upper[i], barrier.q[away > 0.0].min(initial=np.inf))
    return lower, upper


@lru_cache(maxsize=64)
def _barriers(robot: Robot, tool: Packed) -> tuple[Barrier, ...]:
    hung = unpacked(tool)
    capsules = body_capsules(robot, hung)
    found = []
    for i, j in self_collision_pairs(robot, hung):
        joint, q, distance = distances_by_joint(robot, capsules[i], capsules[j], STEP_RAD)
        blocked = distance < SELF_CLEARANCE_M
        if blocked.any():
            names = (capsules[i].name, capsules[j].name)
            found.append(Barrier(joint, names, q[blocked], float(distance.min())))
    return tuple(found)
