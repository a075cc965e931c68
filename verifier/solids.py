"""Shapes of arm, tool, object and surroundings: capsules that move, and convex solids that stand still.

Two convex sets are at least as far apart as their projections on any line. So the direction of that line may come from
any estimate, and is taken from where the two are nearest in the middle of a piece of time; what is proven is the
distance of the projections, all along the piece.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from planner.cell import Cell, Solid, ThrownBody
from verifier.arm import ArmPieces, fixed_transforms
from verifier.capsules import MovingCapsule, capsules_of
from verifier.elementary import ROUNDING, Array
from verifier.taylor import TaylorModel, dot

CELLS_KEPT = 32  # cells whose pairs are kept
SELF_CLEARANCE_M = 0.005  # [m] source: docs/collision-geometry.md
POSTURES = 600  # random ones in which pairs are looked at first, and then those of them that are apart in none
MORE_POSTURES = 6000
STEPS = 40  # [-] of a search along a segment: 0.62^40 of its length
LENGTHENED = 1.0 + 64.0 * ROUNDING  # [-] rounds the length of a direction up


class ArmEnds:
    """The ends of capsules over pieces of a motion, each a model (3, n) [m], and their places in the middles."""

    def __init__(self, arm: ArmPieces, capsules: Sequence[MovingCapsule]) -> None:
        """Takes an arm, and the capsules on it."""
        self.models = [[arm.point(c.frame, end) for end in c.ends] for c in capsules]
        self.middles = np.array([[end.c0 for end in ends] for ends in self.models])  # (k, 2, 3, n)

    @cached_property
    def boxes(self) -> list[tuple[Array, Array]]:
        """Lower and upper corners (3, n) [m] of boxes about each, which hold it all along the pieces."""
        return [(np.minimum(one.lower, other.lower), np.maximum(one.upper, other.upper)) for one, other in self.models]


def toward(apart: Array) -> Array:
    """Returns directions (3, n) from vectors (3, n), to rounding: any vector is one; 0 of a vector of no length."""
    length = np.sqrt((apart * apart).sum(axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(length > 0.0, apart / length, 0.0)


def lengths_up(n: Array) -> Array:
    """Returns upper bounds (m,) on the lengths of directions (3, m), at least 1e-3: one of no length says nothing."""
    return np.maximum(np.sqrt((n * n).sum(axis=0)) * LENGTHENED, 1e-3)


def apart_between(first: Sequence[TaylorModel], second: Sequence[TaylorModel], n: Array) -> Array:
    """Returns lower bounds (m,) [m] on the distance of hulls of points, by their projections on directions (3, m)."""
    return shortened(np.min([dot(n, a - b).lower for a in first for b in second], axis=0), n)


def apart_from_solid(ends: Sequence[TaylorModel], solid: Solid, n: Array) -> Array:
    """Returns lower bounds (m,) [m] on the distance of the hull of points from a solid, likewise."""
    reach = support(solid, n)
    gap = np.min([dot(n, end).lower for end in ends], axis=0) - reach
    return shortened(gap - 2.0 * ROUNDING * np.abs(reach), n)


def shortened(gap: Array, n: Array) -> Array:
    """Returns gaps (m,) along directions (3, m) of about unit length as bounds on a distance."""
    return np.where(gap > 0.0, gap / lengths_up(n) * (1.0 - 4.0 * ROUNDING), gap)


def apart_in_middle(apart: Array, ends: Sequence[TaylorModel]) -> Array:
    """Returns upper bounds (m,) [m] on a distance in the middles, from vectors (3, m) between points of both sets."""
    unsure = np.sum([end.r.sum(axis=0) + 64.0 * ROUNDING * end.size.sum(axis=0) for end in ends], axis=0)
    return np.sqrt((apart * apart).sum(axis=0)) * LENGTHENED + unsure


def nearest_on_segments(a: Array, b: Array) -> tuple[Array, Array]:
    """Returns the nearest points (3, n) of segments with ends (2, 3, n), to rounding.

    Source: Ericson, Real-Time Collision Detection (2005), section 5.1.9.
    """
    d1, d2, r = a[1] - a[0], b[1] - b[0], a[0] - b[0]
    aa, ee, bb = (d1 * d1).sum(axis=0), (d2 * d2).sum(axis=0), (d1 * d2).sum(axis=0)
    c, f = (d1 * r).sum(axis=0), (d2 * r).sum(axis=0)
    aa, ee = np.maximum(aa, 1e-30), np.maximum(ee, 1e-30)
    denominator = aa * ee - bb * bb
    s = np.where(denominator > 1e-14 * aa * ee, np.clip((bb * f - c * ee) / np.maximum(denominator, 1e-60), 0, 1), 0.0)
    t = np.clip((bb * s + f) / ee, 0.0, 1.0)
    s = np.clip((bb * t - c) / aa, 0.0, 1.0)
    return a[0] + s * d1, b[0] + t * d2


def support(solid: Solid, n: Array) -> Array:
    """Returns how far a solid reaches in directions (3, m), rounded up (m,) [m]."""
    X = solid.X_WC
    half = 0.5 * solid.extent
    along = X[:3, :3].T @ n
    if solid.kind == "box":
        reach = (half[:, None] * np.abs(along)).sum(axis=0)
    elif solid.kind == "cylinder":
        reach = half[0] * np.sqrt(along[0] ** 2 + along[1] ** 2) + half[2] * np.abs(along[2])
    else:
        reach = (half[2] - half[0]) * np.abs(along[2]) + half[0] * lengths_up(n)
    middle = X[:3, 3] @ n
    sizes = np.abs(X[:3, 3]) @ np.abs(n) + half.sum() * np.abs(n).sum(axis=0)
    return middle + reach + 32.0 * ROUNDING * sizes


def from_solid(x: Array, solid: Solid) -> Array:
    """Returns the vectors (3, n) [m] to points (3, n) from the nearest points of a solid, to rounding; 0 within it."""
    X = solid.X_WC
    half = 0.5 * solid.extent
    y = X[:3, :3].T @ (x - X[:3, 3, None])
    if solid.kind == "box":
        near = np.clip(y, -half[:, None], half[:, None])
    elif solid.kind == "cylinder":
        inwards = np.minimum(1.0, half[0] / np.maximum(np.hypot(y[0], y[1]), 1e-300))
        near = np.stack([y[0] * inwards, y[1] * inwards, np.clip(y[2], -half[2], half[2])])
    else:
        straight = half[2] - half[0]
        core = np.stack([np.zeros_like(y[0]), np.zeros_like(y[0]), np.clip(y[2], -straight, straight)])
        out = y - core
        length = np.sqrt((out * out).sum(axis=0))
        near = core + out * np.minimum(1.0, half[0] / np.maximum(length, 1e-300))
    return X[:3, :3] @ (y - near)


def out_of_solid(ends: Array, solid: Solid) -> Array:
    """Returns vectors (3, n) [m] from a solid to the nearest points of segments with ends (2, 3, n), to rounding.

    The distance is convex along a segment: a golden section search finds it.
    """
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    low, high = np.zeros(ends.shape[-1]), np.ones(ends.shape[-1])

    def gap(s: Array) -> Array:
        out = from_solid(ends[0] + s * (ends[1] - ends[0]), solid)
        return (out * out).sum(axis=0)

    one, two = high - golden * (high - low), low + golden * (high - low)
    f_one, f_two = gap(one), gap(two)
    for _ in range(STEPS if (ends[0] != ends[1]).any() else 0):
        left = f_one <= f_two
        low, high = np.where(left, low, one), np.where(left, two, high)
        one_, two_ = high - golden * (high - low), low + golden * (high - low)
        f_one, f_two = np.where(left, gap(one_), f_two), np.where(left, f_one, gap(two_))
        one, two = one_, two_
    s = 0.5 * (low + high)
    return from_solid(ends[0] + s * (ends[1] - ends[0]), solid)


@lru_cache(maxsize=CELLS_KEPT)
def judged_pairs(cell: Cell) -> list[tuple[int, int]]:
    """Returns pairs of indices into `capsules_of` that must stay apart: all but what may touch, and neighbours.

    Neighbours are closer than the self clearance in each of thousands of random postures, and so are what grips the
    object and the object. The links that a body pierces always are none: its every link counts.
    """
    capsules = capsules_of(cell)
    last = len(capsules) - 1
    free = cell.surroundings.is_free_to_touch
    pairs = [
        (i, j)
        for i in range(last)
        for j in range(i + 1, last + 1)
        if capsules[i].frame != capsules[j].frame
        and not free(capsules[i].name, capsules[j].name)
        and not (j == last and capsules[i].name.startswith("tool_"))
    ]
    is_body = isinstance(cell.object, ThrownBody)
    always = [pair for pair in pairs if is_body and pair[1] == last]
    waiting = [pair for pair in pairs if pair not in always]
    rng = np.random.default_rng(0)
    for count in (POSTURES, MORE_POSTURES):
        apart = _apart(cell, capsules, waiting, rng.uniform(cell.robot.q_lower, cell.robot.q_upper, (count, 6)))
        always += [pair for pair, is_apart in zip(waiting, apart, strict=True) if is_apart]
        waiting = [pair for pair, is_apart in zip(waiting, apart, strict=True) if not is_apart]
    return sorted(always)


def _apart(
    cell: Cell, capsules: Sequence[MovingCapsule], pairs: Sequence[tuple[int, int]], q: Array
) -> NDArray[np.bool_]:
    """Returns which pairs (p,) are apart by the self clearance in one of some postures (m, 6), to rounding."""
    X = _poses(cell, q)
    ends = [(X[c.frame][:, :3, :3] @ c.ends.T).transpose(2, 1, 0) + X[c.frame][:, :3, 3].T for c in capsules]
    found = []
    for i, j in pairs:
        a, b = nearest_on_segments(ends[i], ends[j])
        gap = np.sqrt(((a - b) ** 2).sum(axis=0)) - capsules[i].radius_m - capsules[j].radius_m
        found.append(bool((gap >= SELF_CLEARANCE_M).any()))
    return np.array(found, bool)


def _poses(cell: Cell, q: Array) -> list[Array]:
    """Returns poses (m, 4, 4) of base and links at postures (m, 6), to rounding."""
    turns, shifts = fixed_transforms(cell)
    X = np.tile(np.eye(4), (len(q), 1, 1))
    found = [X]
    for i in range(6):
        c, s = np.cos(q[:, i]), np.sin(q[:, i])
        Z = np.tile(np.eye(4), (len(q), 1, 1))
        Z[:, 0, 0], Z[:, 0, 1], Z[:, 1, 0], Z[:, 1, 1] = c, -s, s, c
        M = np.eye(4)
        M[:3, :3], M[:3, 3] = turns[i], shifts[i]
        X = X @ Z @ M
        found.append(X)
    return found
