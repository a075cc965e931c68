"""Clearance of the body along paths in joint space, bounded between evaluated positions too.

Between two positions a point deviates from its chord by at most sup|p''| h^2 / 8, bounded by the rotations of the
joints as in the certificate. A height is then at least the lower end less that; a distance d from a shape at least
(d0 + d1 - |p1 - p0|) / 2 less that; and the distance of two links at least (d0 + d1 - L) / 2, where L sums the
rotations of the joints between them times their levers. The rule is that of the certificate: what these bounds leave
open, positions closer together decide.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array, Mask
from planner.cell import Cell
from planner.certificate import Rates, curvature_bound, point_bound, slope_bound
from planner.geometry import SELF_CLEARANCE_M, body_model

PATHS_AT_ONCE = 64  # [-] keeps the arrays of many paths in the processor's cache
ONE_STEP = np.ones(())  # time between neighbouring positions, in units of itself


@dataclass(frozen=True, eq=False)
class SweptPaths:
    """M paths through U positions each.

    Attributes:
        q: positions (M, U, 6) [rad].
        turn: largest rotation of each joint from one position to the next (M, U-1, 6) [rad].
        bend: its acceleration there times the square of the time between (M, U-1, 6) [rad]; 0 on a straight path.
    """

    q: Array
    turn: Array
    bend: Array

    @classmethod
    def straight(cls, q: Array) -> SweptPaths:
        """Returns paths that are straight and of constant speed between their positions (M, U, 6)."""
        turn = np.abs(np.diff(q, axis=1))
        return cls(q, turn, np.zeros_like(turn))

    def blocks(self) -> list[SweptPaths]:
        """Returns the paths in blocks of `PATHS_AT_ONCE`."""
        rows = [slice(first, first + PATHS_AT_ONCE) for first in range(0, len(self.q), PATHS_AT_ONCE)]
        return [SweptPaths(self.q[row], self.turn[row], self.bend[row]) for row in rows]


@dataclass(frozen=True, eq=False)
class SweptClearance:
    """Distance of one part of the body from one obstacle, along M paths through U positions.

    Attributes:
        name: such as "wrist_3 and the floor".
        values: at the positions (M, U) [m].
        between: lower bounds between them (M, U-1) [m].
        required: least distance [m].
    """

    name: str
    values: Array
    between: Array
    required: float

    @property
    def kept(self) -> Mask:
        """Whether the distance is kept on each path (M,)."""
        return np.asarray(self.between.min(axis=1) >= self.required, np.bool_) & ~self.broken

    @property
    def broken(self) -> Mask:
        """Whether one of the positions on each path is too close (M,)."""
        return np.asarray(self.values.min(axis=1) < self.required, np.bool_)


def keep_clear(cell: Cell, paths: SweptPaths, with_object: bool = True) -> tuple[Mask, Mask]:
    """Returns whether each path is proven to keep clear (M,), and whether one of its positions does not (M,).

    Where neither holds the bounds leave a doubt, which positions closer together settle.
    """
    blocks = [list(swept_clearances(cell, block, with_object)) for block in paths.blocks()]
    kept = [np.all([each.kept for each in block], axis=0) for block in blocks]
    broken = [np.any([each.broken for each in block], axis=0) for block in blocks]
    return np.concatenate(kept), np.concatenate(broken)


def swept_clearances(cell: Cell, paths: SweptPaths, with_object: bool = True) -> Iterator[SweptClearance]:
    """Yields the clearances of arm and tool of a cell along paths, and of the object in the tool where there is one."""
    body = body_model(cell)
    around = cell.surroundings
    shape = paths.q.shape[:2]
    ends = body.end_points(body.link_poses(paths.q.reshape(-1, 6)))
    turn, bend = (steps.reshape(-1, 6).T for steps in (paths.turn, paths.bend))
    rates = Rates(np.array([turn, bend, *np.zeros((2, *turn.shape))]))
    bends = point_bound(body.levers, rates, 2).reshape(-1, *paths.turn.shape[:2])
    heights = body.heights(ends).reshape(-1, *shape)
    stands = body.shape_distances(ends).reshape(-1, len(body.moving), *shape)
    clearances = (around.clearance_m + around.further_clearances).tolist()
    for item, capsule in enumerate(body.moving):
        if capsule == body.object and not with_object:
            continue
        name = body.names[capsule]
        yield _smooth(f"{name} and the floor", heights[item], bends[capsule], around.clearance_m)
        for other, distances, clearance_m in zip(around.keep_out_names, stands[:, item], clearances, strict=True):
            chords = _longest_chords(ends[capsule].reshape(2, 3, *shape))
            between = slope_bound(*_neighbours(distances), chords, ONE_STEP) - bends[capsule] / 8.0
            yield SweptClearance(f"{name} and keep-out {other}", distances, between, clearance_m)
    rooms = zip(around.keep_in_names, around.keep_in_clearances.tolist(), strict=True)
    for (name, clearance_m), distances in zip(rooms, body.wall_distances(ends).reshape(-1, *shape), strict=True):
        yield _smooth(f"the tool and the wall of keep-in {name}", distances, bends[body.object], clearance_m)
    approaches = (body.pair_levers @ (turn + bend)).reshape(-1, *paths.turn.shape[:2])
    for pair, distances, moved in zip(
        body.pairs, body.pair_distances(ends).reshape(-1, *shape), approaches, strict=True
    ):
        if body.object in pair and not with_object:
            continue
        one, other = (body.names[i] for i in pair)
        between = slope_bound(*_neighbours(distances), moved, ONE_STEP)
        yield SweptClearance(f"{one} and {other}", distances, between, SELF_CLEARANCE_M)


def _smooth(name: str, values: Array, bends: Array, required: float) -> SweptClearance:
    return SweptClearance(name, values, curvature_bound(*_neighbours(values), bends, ONE_STEP), required)


def _neighbours(values: Array) -> tuple[Array, Array]:
    """Returns the values at both ends of every step (M, U-1)."""
    return values[:, :-1], values[:, 1:]


def _longest_chords(ends: Array) -> Array:
    """Returns how far the farther-moving end (2, 3, M, U) moves in every step (M, U-1) [m]."""
    return np.linalg.norm(np.diff(ends, axis=-1), axis=1).max(axis=0)
