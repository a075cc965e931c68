"""Path search in joint space (RRT-Connect): straight pieces between postures, clear of all shapes and the arm itself.

Two trees, one from each end, grow towards random postures and towards each other until they meet; the path is then
shortened wherever a straight piece is clear. Sources: Kuffner and LaValle, RRT-Connect: an efficient approach to
single-query path planning, ICRA 2000; Geraerts and Overmars, Creating high-quality paths for motion planning, IJRR 2007
(shortcuts). The random numbers have a given seed and the effort is counted in postures, so the same problem has the
same path.

The kernel grows the trees, and checks a piece in its middle: a shape whose distance there is more than the arm can move
up to the ends of the piece is done with, and both halves are checked against the rest, until postures are `SPACING_RAD`
apart. Pieces keep a margin that falls to nothing at both ends: an end which the certificate accepts is never excluded.
The certificate proves the motion along the path.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from planner.arrays import Array, Mask
from planner.calibration import fixed_transforms
from planner.cell import Cell
from planner.geometry import POINT_M2, SELF_CLEARANCE_M, body_model
from planner.native import Pinned, loops
from planner.trajectory import columns_at

OWN_MARGIN_M = 1e-4  # [m] kept beyond the self clearance: the wrist of a UR5 leaves 0.2 mm where it is straight
SPACING_RAD = 0.02  # [rad] between checked postures: 26 mm at a reach of 1.3 m
STEP_RAD = 0.3  # [rad] by which a tree grows at most in one step
NEAR_END_RAD = 0.2  # [rad] distance from an end within which the margin grows from nothing: 5 cm at a lever of 0.25 m
BLOCK = 64  # [-] random postures between two looks at the clock
# In turn, where a block of them lies: beyond which ends, by how much in every joint [rad]. Beside one end they find the
# way out of a shelf; farther away, one between ends that a full turn of the wrist lies apart.
REGIONS = ((0, 2, 1.5), (1, 2, 1.5), (0, 1, 1.5), (0, 2, 3.0))
POSTURES = 1_000_000  # [-] evaluated by one search before it gives up, in about 5 s
MOST = 30_000  # [-] postures in a tree at most
SHORTCUTS = 12  # [-] times that a path is shortened
PIECES = 12  # [-] drawn each time, of which the most promising are checked
CHECKED = 4
LEAST_SAVED_RAD = 1e-6  # [rad] rounding: a piece within another one saves nothing
SEED = 0  # of the random postures


@dataclass(frozen=True, eq=False)
class Obstacles:
    """What an arm keeps clear of on its way between two postures.

    Attributes:
        scene: what moves among what, as the kernel takes it.
        margin_m: kept beyond the clearance, less within `NEAR_END_RAD` of the ends [m].
        ends: start and goal (2, 6) [rad].
    """

    scene: Pinned
    margin_m: float
    ends: Array

    @classmethod
    def of(cls, cell: Cell, margin_m: float, ends: Array, with_object: bool = True) -> Obstacles:
        """Returns those of a cell, with the object in the tool or without."""
        return cls(_scene(cell, with_object), margin_m, ends)

    @property
    def numbers(self) -> Array:
        """Margins, and what else the kernel counts by; see paths.c (5,)."""
        return np.array([self.margin_m, OWN_MARGIN_M, NEAR_END_RAD, SPACING_RAD, POINT_M2])

    def clear(self, start: Array, end: Array) -> Mask:
        """Returns whether straight pieces between postures are clear (n,), from `start` to `end`, both (n, 6) [rad]."""
        return loops.pieces_clear(self.scene, self.ends, self.numbers, start, end) > 0.0

    def grow(self, trees: _Trees, random: Array) -> None:
        """Grows both trees towards random postures (n, 6) until they meet, or as many were evaluated as may be."""
        found = trees.q, trees.parent, trees.state
        trees.state = loops.grow_trees(self.scene, self.ends, self.numbers, random, STEP_RAD, found)


@lru_cache(maxsize=32)
def _scene(cell: Cell, with_object: bool) -> Pinned:
    """Returns what moves among what: chain, capsules, pairs, shapes and bounds; see paths.c."""
    body = body_model(cell)
    around = cell.surroundings
    count = len(body.names)
    moves = np.isin(np.arange(count), body.moving)
    if not with_object:
        moves[body.object] = False
    meets_floor = moves.copy()
    meets_floor[body.moving[body.stays_level]] = False
    capsules = np.column_stack(
        [body.frames, body.ends.reshape(count, 6), body.radii, body.levers, meets_floor, moves]
    ).astype(np.float64)
    own = np.flatnonzero(with_object | (body.pairs != body.object).all(axis=1))
    pairs = body.pairs[own]
    least = body.radii[pairs].sum(axis=1) + SELF_CLEARANCE_M
    rows = around.keep_out_rows.reshape(-1, 20)
    required = around.clearance_m + around.further_clearances
    lower, upper = around.box_within or (np.full(3, -np.inf), np.full(3, np.inf))
    rooms = [[*around.keep_in[i].row, around.keep_in_clearances[i]] for i in around.rooms]
    return Pinned(
        np.array([cell.X_WB, *fixed_transforms(cell.robot)]),
        capsules,
        np.column_stack([pairs.astype(np.float64), least, body.pair_levers[own]]),
        np.column_stack([rows, required]),
        np.array([around.floor_z_m + around.clearance_m, *lower, *upper]),
        body.may_touch.astype(np.float64),
        np.array(rooms).reshape(-1, 21),
    )


class _Trees:
    """Two trees: postures, each with the index of its parent, and how the search stands; see `grow_trees`."""

    def __init__(self, ends: Array, most: int, budget: int) -> None:
        self.q = np.zeros((2, most, 6))
        self.q[:, 0] = ends
        self.parent = np.full((2, most), -1, np.intp)
        self.state = np.array([1, 1, 0, -1, -1, budget], np.intp)

    @property
    def met(self) -> bool:
        """Whether they have met."""
        return bool(self.state[3] >= 0)

    @property
    def is_spent(self) -> bool:
        """Whether no more may be evaluated, or kept."""
        return bool(self.state[5] <= 0 or self.state[:2].max() >= self.q.shape[1])

    def path(self) -> Array:
        """Returns the postures (K, 6) from start to goal by way of where the trees met."""
        first, second = (self._branch(tree, self.state[3 + tree]) for tree in (0, 1))
        return self.q[[0] * len(first) + [1] * (len(second) - 1), [*first[::-1], *second[1:]]]

    def _branch(self, tree: int, index: int) -> list[int]:
        """Returns the postures from `index` back to the root of a tree."""
        branch = []
        while index >= 0:
            branch.append(index)
            index = int(self.parent[tree, index])
        return branch


def find_path(
    around: Obstacles, lower: Array, upper: Array, budget: int = POSTURES, deadline_s: float = math.inf
) -> Array | None:
    """Returns postures (K, 6) [rad] from start to goal with clear straight pieces; None if none are found.

    Args:
        around: what is in the way, and both ends.
        lower, upper: joint range (6,) [rad].
        budget: postures that may be evaluated.
        deadline_s: on `time.perf_counter`; a search that has not met by then ends.
    """
    ends = around.ends
    if around.clear(ends[:1], ends[1:])[0]:
        return ends
    if not around.clear(ends, ends).all():
        return None
    rng = np.random.default_rng(SEED)
    trees = _Trees(ends, MOST, budget)
    block = 0
    while not (trees.met or trees.is_spent):
        if time.perf_counter() >= deadline_s:
            return None
        first, last, beyond = REGIONS[block % len(REGIONS)]
        low = np.maximum(ends[first:last].min(axis=0) - beyond, lower)
        high = np.minimum(ends[first:last].max(axis=0) + beyond, upper)
        around.grow(trees, rng.uniform(low, high, (BLOCK, 6)))
        block += 1
    return _shortened(trees.path(), around, rng) if trees.met else None


def _shortened(path: Array, around: Obstacles, rng: np.random.Generator) -> Array:
    """Returns the path with shortcuts: each time the clear piece that saves most, of some between random places."""
    for _ in range(SHORTCUTS):
        if len(path) == 2:
            break
        length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))
        along = np.sort(rng.uniform(0.0, length[-1], (PIECES, 2)), axis=1)
        before = np.searchsorted(length, along, side="right") - 1
        a, b = (columns_at(x, length, path) for x in along.T)
        saved = along[:, 1] - along[:, 0] - np.linalg.norm(b - a, axis=1)
        most = np.argsort(-saved)[:CHECKED]
        clear = most[around.clear(a[most], b[most])]
        if len(clear) and saved[clear[0]] > LEAST_SAVED_RAD:
            best = clear[:1]
            i, j = before[best[0]]
            path = np.concatenate([path[: i + 1], a[best], b[best], path[j + 1 :]])
    return _without_corners(path, around)


def _without_corners(path: Array, around: Obstacles) -> Array:
    """Returns the path without the postures that can be skipped."""
    kept = [0]
    while kept[-1] < len(path) - 1:
        at = kept[-1]
        later = np.arange(len(path) - 1, at, -1)
        is_clear = around.clear(np.repeat(path[at : at + 1], len(later), axis=0), path[later])
        kept.append(int(later[is_clear][0]) if is_clear.any() else at + 1)
    return path[kept]
