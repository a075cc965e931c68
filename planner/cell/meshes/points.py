"""Boxes about points: the full cells of a grid, joined where several are a larger box."""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, Index, Mask
from planner.cell.meshes.boxes import MeshCover

CELLS_MAX = 50_000_000  # [-] of a grid: as many bytes of memory
FARTHEST = 1e9  # [-] of a cell's edge: numbers of cells are exact
EDGE = 1e-6  # [-] of a cell: points in the middles of cells, however they are rounded, stay in these


def full_cells(points: Array, edge: float) -> Index:
    """Returns the numbers (k, 3) of the cells of a grid of edge `edge` that points (n, 3) are in."""
    return np.unique(np.floor(points / edge + EDGE).astype(np.int64), axis=0)


def points_cover(points: Array, edge: float) -> MeshCover:
    """Returns boxes that cover points: cells of a grid, each full one in one box.

    Args:
        points: the points (n, 3), finite.
        edge: of a cell.

    Raises:
        ValueError: there are none, or the grid has more than `CELLS_MAX` cells.
    """
    if not len(points):
        raise ValueError("has no points")
    if np.ceil(np.ptp(points, axis=0) / edge + 1.0).prod() > CELLS_MAX or np.abs(points).max() > FARTHEST * edge:
        raise ValueError("has too many cells: larger ones, or another scale")
    cells = full_cells(points, edge)
    first = cells.min(axis=0)
    counts = cells.max(axis=0) - first + 1
    left = np.zeros(counts, np.bool_)
    left[tuple((cells - first).T)] = True
    lower = []
    upper = []
    for start in cells - first:
        if left[tuple(start)]:
            end = start + 1
            for axis in (2, 1, 0):
                end[axis] = _end_of_box(left, start, end, axis)
            left[tuple(slice(*ends) for ends in zip(start, end, strict=True))] = False
            lower.append(start)
            upper.append(end)
    low, high = (edge * (np.array(side) + first) for side in (lower, upper))
    return MeshCover(np.eye(3), low, high, edge * float(np.sqrt(3.0)))


def _end_of_box(left: Mask, start: Index, end: Index, axis: int) -> int:
    """Returns how far a box of full cells from `start` to before `end` (3,) can be drawn out along an axis."""
    beyond = [slice(*ends) for ends in zip(start, end, strict=True)]
    beyond[axis] = slice(int(end[axis]), None)
    across = tuple(i for i in range(3) if i != axis)
    gaps = np.flatnonzero(~left[tuple(beyond)].all(axis=across))
    return int(end[axis]) + (int(gaps[0]) if len(gaps) else left.shape[axis] - int(end[axis]))
