"""Boxes that cover a mesh, and what it encloses: found on a grid, and as few as a cell can afford.

The mesh lies within the union of the boxes, whether it is closed or not, and however its faces are wound. The grid's
cells that it may pass through are marked, and those that are cut off from the outside by them; a box about them all is
split in two again and again, where the boxes about both parts are smallest together, the one that reaches farthest
beyond the mesh first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Index, Mask

CELLS = 100  # [-] of the grid along the mesh's longest side
FINEST = 0.5  # [-] of a cell: longest edge of the triangles by which cells are marked
BOXES_MAX = 64  # [-] of one mesh: a cell has some meshes, and 200 shapes take a certificate 4 ms
SMALLER = 0.9  # [-] of the volume: the file's own axes are those that a person reads
FLAT = 1e-3  # [-] least thickness of the grid, of the longest side: a sheet has no other


@dataclass(frozen=True, eq=False)
class MeshCover:
    """Boxes that cover a mesh, in the unit of its file.

    Attributes:
        axes: in the frame of the file, along which the boxes lie (3, 3), one a column.
        lower, upper: their corners along these axes (k, 3).
        beyond: distance from the mesh that no point of them exceeds.
    """

    axes: Array
    lower: Array
    upper: Array
    beyond: float


class _Part(NamedTuple):
    """Cells of the grid from `lower` to before `upper` (3,) each, and how far the empty ones are from marked ones."""

    beyond: float
    lower: Index
    upper: Index


def cover(triangles: Array) -> MeshCover:
    """Returns boxes that cover a mesh.

    Args:
        triangles: corners of its faces (n, 3, 3), finite.
    """
    axes = _axes(triangles)
    triangles = triangles @ axes
    lower, upper = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    longest = float((upper - lower).max())
    lacking = np.maximum(FLAT * longest - (upper - lower), 0.0)
    lower = lower - 0.5 * lacking
    upper = upper + 0.5 * lacking
    counts = np.ceil((upper - lower) / (longest / CELLS) - FLAT).astype(int)
    planes = [np.linspace(*ends) for ends in zip(lower, upper, counts + 1, strict=True)]
    edges = (upper - lower) / counts
    finest = FINEST * longest / CELLS
    marked = _enclosed(_marked(triangles, planes, finest))
    parts = _parts(marked, _distances(marked, edges))
    # A marked cell meets the box about a triangle: no point of it is farther from the mesh than both are long.
    slack = float(np.linalg.norm(edges)) + np.sqrt(3.0) * finest
    boxes = np.array([[[planes[i][side[i]] for i in range(3)] for side in part[1:]] for part in parts])
    return MeshCover(axes, boxes[:, 0], boxes[:, 1], max(part.beyond for part in parts) + slack)


def _axes(triangles: Array) -> Array:
    """Returns the file's axes (3, 3), or those of the mesh's moments where a box about it is smaller along them."""
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(across, axis=1)[:, None, None]
    middles = triangles.mean(axis=1, keepdims=True)
    x = triangles - (areas * middles).sum(axis=0) / areas.sum()
    points = np.concatenate([x, 3.0 * x.mean(axis=1, keepdims=True)], axis=1)
    # source: second moments of a triangle: area / 12 (sum of v v' over its corners + 9 c c' of its middle)
    moments = np.linalg.eigh((areas * (points.swapaxes(1, 2) @ points)).sum(axis=0))[1]
    turned = moments * [1.0, 1.0, np.sign(np.linalg.det(moments))]
    volumes = [float(np.ptp((triangles @ axes).reshape(-1, 3), axis=0).prod()) for axes in (np.eye(3), turned)]
    return turned if volumes[1] < SMALLER * volumes[0] else np.eye(3)


def _marked(triangles: Array, planes: list[Array], finest: float) -> Mask:
    """Returns the cells that the boxes about a mesh's triangles meet, once those have no edge longer than `finest`."""
    marked = np.zeros([len(each) - 1 for each in planes], np.bool_)
    for fine in fine_triangles(triangles, finest):
        _mark(marked, fine, planes)
    return marked


def fine_triangles(triangles: Array, finest: float) -> Iterator[Array]:
    """Yields triangles (k, 3, 3) that a mesh's (n, 3, 3) are of together, none with an edge longer than `finest`."""
    while len(triangles):
        edges = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2)  # each from the corner before
        is_fine = edges.max(axis=1) <= finest
        yield triangles[is_fine]
        coarse = triangles[~is_fine]
        first = edges[~is_fine].argmax(axis=1)[:, None] + np.array([-1, 0, 1])  # the longest edge, then the rest
        a, b, c = np.moveaxis(np.take_along_axis(coarse, (first % 3)[..., None], axis=1), 1, 0)
        middle = 0.5 * (a + b)
        triangles = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


def _mark(marked: Mask, triangles: Array, planes: list[Array]) -> None:
    """Marks the cells that boxes about small triangles meet; of a plane between two cells the upper one."""
    ends = (triangles.min(axis=1), triangles.max(axis=1))
    low, high = (
        np.stack([np.searchsorted(planes[i], x[:, i], "right") - 1 for i in range(3)], axis=1).clip(
            0, np.array(marked.shape) - 1
        )
        for x in ends
    )
    for offset in np.ndindex(*((high - low).max(axis=0, initial=0) + 1)):
        marked[tuple(np.minimum(low + offset, high).T)] = True


def _enclosed(marked: Mask) -> Mask:
    """Returns the marked cells, and those that no way over unmarked sides leads to from beyond the grid."""
    free = np.pad(~marked, 1, constant_values=True)
    reached = np.zeros_like(free)
    reached[0] = True
    count = 0
    while count != (count := int(reached.sum())):
        for axis in range(3):
            rows = np.moveaxis(reached, axis, 0)
            open_rows = np.moveaxis(free, axis, 0)
            for i in range(1, len(rows)):
                rows[i] |= rows[i - 1] & open_rows[i]
            for i in range(len(rows) - 1, 0, -1):
                rows[i - 1] |= rows[i] & open_rows[i - 1]
    return ~reached[1:-1, 1:-1, 1:-1]


def _distances(marked: Mask, edges: Array) -> Array:
    """Returns the distance of each cell's middle from the nearest marked cell's (...), 0 of those."""
    squares = np.where(marked, 0.0, np.inf)
    for axis, edge in enumerate(edges):
        rows = np.moveaxis(squares, axis, 0)
        i = np.arange(len(rows))
        away = ((i[:, None] - i) * edge) ** 2
        squares = np.moveaxis(np.array([(rows + each[:, None, None]).min(axis=0) for each in away]), 0, axis)
    return np.sqrt(squares)


def _parts(marked: Mask, away: Array) -> list[_Part]:
    """Returns the parts of the grid that are covered, each within the marked cells' bounds."""
    parts = [_part(marked, away, np.zeros(3, int), np.array(marked.shape))]
    while len(parts) < BOXES_MAX:
        widest = max(parts, key=lambda part: part.beyond)
        if widest.beyond == 0.0:
            break
        parts.remove(widest)
        axis, at = _best_split(marked[_cells(widest)])
        before, after = widest.upper.copy(), widest.lower.copy()
        before[axis] = after[axis] = widest.lower[axis] + at
        parts += [_part(marked, away, widest.lower, before), _part(marked, away, after, widest.upper)]
    return parts


def _cells(part: _Part) -> tuple[slice, ...]:
    return tuple(slice(*ends) for ends in zip(part.lower, part.upper, strict=True))


def _part(marked: Mask, away: Array, lower: Index, upper: Index) -> _Part:
    """Returns the part about the marked cells between two corners of the grid."""
    inside = np.argwhere(marked[_cells(_Part(0.0, lower, upper))])
    part = _Part(0.0, lower + inside.min(axis=0), lower + inside.max(axis=0) + 1)
    return part._replace(beyond=float(away[_cells(part)].max()))


def _best_split(marked: Mask) -> tuple[int, int]:
    """Returns axis and place of the plane on whose sides the boxes about the marked cells are smallest together."""
    found = []
    for axis in range(3):
        rows = np.moveaxis(marked, axis, 0)
        if len(rows) > 1:
            volumes = _volumes(rows)[:-1] + _volumes(rows[::-1])[-2::-1]
            at = int(volumes.argmin())
            found.append((float(volumes[at]), axis, at + 1))
    _, axis, at = min(found)
    return axis, at


def _volumes(rows: Mask) -> Array:
    """Returns how many cells the box about the marked ones of the first row has, of the first two, and so on (n,)."""
    last = np.maximum.accumulate(np.where(rows.any(axis=(1, 2)), np.arange(len(rows)), 0))
    volumes = 1.0 + last
    for axis in (2, 1):
        so_far = np.logical_or.accumulate(np.asarray(rows.any(axis=axis)), axis=0)
        volumes = volumes * (so_far.shape[-1] - so_far.argmax(axis=1) - so_far[:, ::-1].argmax(axis=1))
    return volumes
