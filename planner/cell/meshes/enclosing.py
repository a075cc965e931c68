"""The simple shape about a mesh: of sphere, capsule, cylinder and box the one of least volume.

The sphere is the smallest. About an axis, the smallest circle about the corners as they are seen along it gives a
cylinder and a capsule, and the smallest rectangle, which has a side along an edge of their outline, a box. Of axes
spread evenly, the file's and the moments' own and the normals of the largest faces, those with the least volume are
turned by ever smaller angles for as long as that makes the shape smaller. Axes are searched with the corners that
reach farthest; the shape is then sized to contain every corner. None is thinner than a thousandth of the longest side.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Index
from planner.cell.meshes.boxes import FLAT, fine_triangles
from planner.cell.shapes import Solid, shape_of
from planner.rotations import pose

KINDS = ("sphere", "capsule", "cylinder", "box")  # of two that are as large the one that is rounder
AS_LARGE = 0.01  # [-] of a volume: by so much a round part's facets make one shape larger than another
EVERY_WAY = 100  # [-] directions spread evenly, 0.25 rad apart
NORMALS = 50  # [-] of the largest faces: a part has some flat sides, and a round one as many as one likes
STARTS = 2  # [-] axes that are improved
TURN_RAD = 0.1  # [rad] of the first turn: they are somewhat farther apart, and it may go on
TURN_MIN_RAD = 1e-6  # [rad] of the last: the end of a part of a metre moves by a thousandth of a millimetre
ROUNDS = 100  # [-] of the search for a ball; most take five
SAME = 1e-12  # [-] rounding of a radius
PRODUCTS = 1_000_000  # [-] numbers that are kept at once: what a processor has at hand
AT_ONCE = 200  # [-] triangles of a mesh that are divided at once: a large one becomes some thousands
FINEST = 0.02  # [-] of the longest side: edges of the triangles of which the nearest is looked for
TOLD = 0.02  # [-] of the longest side to which the distance beyond a mesh is told


@dataclass(frozen=True, eq=False)
class EnclosingShape:
    """A shape that contains a mesh, in frame and unit of its file.

    Attributes:
        kind: sphere, capsule, cylinder or box.
        axes: its own, one a column (3, 3); a box is longest along z.
        centre: (3,).
        size: its extent along its own axes (3,).
        beyond: distance from the mesh that no point of its surface exceeds.
        volume: of the shape.
    """

    kind: str
    axes: Array
    centre: Array
    size: Array
    beyond: float
    volume: float


class _AxisFit(NamedTuple):
    """A shape about points: its volume, axes (3, 3), centre (3,) and extent along the axes (3,)."""

    volume: float
    axes: Array
    centre: Array
    size: Array


def enclosing(triangles: Array) -> EnclosingShape:
    """Returns the shape about a mesh.

    Args:
        triangles: corners of its faces (n, 3, 3), finite.
    """
    corners = np.unique(triangles.reshape(-1, 3), axis=0)
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    longest = float(np.ptp(corners, axis=0).max())
    x = (corners - middle) / longest
    few = x[_farthest(x)]
    axes = _axes(few, triangles)
    fits = {"sphere": _sphere(x)}
    for kind, fit in FITS.items():
        fits[kind] = fit(x, _best_axis(fit, few, axes))
    least = min(fit.volume for fit in fits.values())
    kind = next(kind for kind in KINDS if fits[kind].volume <= (1.0 + AS_LARGE) * least)
    volume, own, centre, size = fits[kind]
    solid = _solid(kind, own, centre, size)
    beyond = _beyond(solid, (triangles - middle) / longest)
    return EnclosingShape(kind, own, middle + longest * centre, longest * size, longest * beyond, longest**3 * volume)


def _directions(count: int) -> Array:
    """Returns unit vectors (count, 3) spread evenly over the half sphere about z: the spiral of Fibonacci."""
    i = np.arange(count)
    z = (i + 0.5) / count
    turn = i * math.pi * (3.0 - math.sqrt(5.0))
    out = np.sqrt(1.0 - z * z)
    return np.column_stack([out * np.cos(turn), out * np.sin(turn), z])


def _farthest(x: Array) -> Index:
    """Returns the numbers of the points (n, 3) that reach farthest in one of the directions."""
    found: list[int] = []
    ways = _directions(EVERY_WAY)
    for some in np.array_split(ways, min(EVERY_WAY, math.ceil(len(x) * EVERY_WAY / PRODUCTS))):
        reach = x @ some.T
        found += [*reach.argmax(axis=0).tolist(), *reach.argmin(axis=0).tolist()]
    return np.unique(found)


def _axes(x: Array, triangles: Array) -> Array:
    """Returns the axes (m, 3) that are tried first."""
    moments = np.linalg.eigh(np.cov(x.T, bias=True))[1].T
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(across, axis=1)
    largest = np.argsort(-areas, kind="stable")[:NORMALS]
    largest = largest[areas[largest] > 0.0]
    return np.concatenate([np.eye(3), moments, across[largest] / areas[largest, None], _directions(EVERY_WAY)])


def _best_axis(fit: Callable[[Array, Array], _AxisFit], x: Array, axes: Array) -> Array:
    """Returns the axis (3,) with the least volume of a fit to points (n, 3)."""
    volumes = np.array([fit(x, z).volume for z in axes])
    found = [_turned(fit, x, axes[i], float(volumes[i])) for i in np.argsort(volumes, kind="stable")[:STARTS]]
    return min(found, key=lambda each: each[0])[1]


def _turned(fit: Callable[[Array, Array], _AxisFit], x: Array, z: Array, volume: float) -> tuple[float, Array]:
    """Returns the volume of a fit, and its axis (3,), turned from `z` (3,) for as long as that makes it smaller."""
    step = TURN_RAD
    while step > TURN_MIN_RAD:
        side, up, _ = _frame(z).T
        tried = [z + step * (math.cos(a) * side + math.sin(a) * up) for a in np.arange(6) * math.pi / 3.0]
        tried = [each / np.linalg.norm(each) for each in tried]
        volumes = [fit(x, each).volume for each in tried]
        best = int(np.argmin(volumes))
        if volumes[best] < volume * (1.0 - SAME):
            volume, z = volumes[best], tried[best]
        else:
            step *= 0.5
    return volume, z


def _frame(z: Array) -> Array:
    """Returns right-handed axes (3, 3), one a column, of which the last is `z` (3,) or against it."""
    z = z * np.sign(z[np.abs(z).argmax()])
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _sphere(x: Array) -> _AxisFit:
    centre, radius = smallest_ball(x)
    return _AxisFit(4.0 / 3.0 * math.pi * radius**3, np.eye(3), centre, np.full(3, 2.0 * radius))


def _cylinder(x: Array, z: Array) -> _AxisFit:
    R = _frame(z)
    y = x @ R
    centre, radius = smallest_ball(y[:, :2])
    low, high = y[:, 2].min(), y[:, 2].max()
    length = float(high - low)
    size = np.maximum([2.0 * radius, 2.0 * radius, length], FLAT)
    return _AxisFit(0.25 * math.pi * float(size[0] ** 2 * size[2]), R, R @ [*centre, 0.5 * (low + high)], size)


def _capsule(x: Array, z: Array) -> _AxisFit:
    """The capsule as thick as the circle; where that needs no length, a sphere is as good, and it is none."""
    R = _frame(z)
    y = x @ R
    centre, radius = smallest_ball(y[:, :2])
    radius = max(radius, 0.5 * FLAT)
    lens = np.sqrt(np.maximum(radius**2 - ((y[:, :2] - centre) ** 2).sum(axis=1), 0.0))
    low, high = (y[:, 2] + lens).min(), (y[:, 2] - lens).max()
    length = float(high - low)
    volume = math.pi * radius**2 * (length + 4.0 / 3.0 * radius) if length > 0.0 else math.inf
    size = np.array([2.0 * radius, 2.0 * radius, length + 2.0 * radius])
    return _AxisFit(volume, R, R @ [*centre, 0.5 * (low + high)], size)


def _box(x: Array, z: Array) -> _AxisFit:
    R = _frame(z)
    across = x @ R[:, :2]
    side = _best_side(across, _outline(across))
    turn = np.array([[side[0], -side[1], 0.0], [side[1], side[0], 0.0], [0.0, 0.0, 1.0]])
    R = R @ turn
    y = x @ R
    low, high = y.min(axis=0), y.max(axis=0)
    order = np.argsort(high - low, kind="stable")
    own = R[:, order]
    own[:, :2] *= np.sign(own[np.abs(own).argmax(axis=0), range(3)])[:2]
    own[:, 2] = np.cross(own[:, 0], own[:, 1])
    size = np.maximum(high - low, FLAT)[order]
    return _AxisFit(float(size.prod()), own, R @ (0.5 * (low + high)), size)


FITS = {"capsule": _capsule, "cylinder": _cylinder, "box": _box}  # about points (n, 3) and an axis (3,)


def _outline(p: Array) -> Array:
    """Returns the corners of the convex hull of points (n, 2) in their order (m, 2): Andrew's monotone chain."""
    rows = np.unique(p, axis=0).tolist()
    ends = []
    for way in (rows, rows[::-1]):
        chain: list[list[float]] = []
        for c in way:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], c) <= 0.0:
                chain.pop()
            chain.append(c)
        ends += chain[:-1]
    return np.array(ends or rows)


def _turn(a: list[float], b: list[float], c: list[float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _best_side(p: Array, outline: Array) -> Array:
    """Returns the direction (2,) of a side of the smallest rectangle about points (n, 2) with their outline (m, 2)."""
    edges = np.roll(outline, -1, axis=0) - outline
    lengths = np.linalg.norm(edges, axis=1)
    if not lengths.any():
        return np.array([1.0, 0.0])
    sides = edges[lengths > 0.0] / lengths[lengths > 0.0, None]
    across = sides @ [[0.0, 1.0], [-1.0, 0.0]]
    areas = np.ptp(outline @ sides.T, axis=0) * np.ptp(outline @ across.T, axis=0)
    return sides[int(areas.argmin())]


def smallest_ball(x: Array) -> tuple[Array, float]:
    """Returns centre (d,) and radius of the smallest ball about points (n, d), of a plane or of space.

    That about the points on it is made anew with the farthest of the others, until none is outside: it grows each time.
    """
    first = int(np.linalg.norm(x - x[0], axis=1).argmax())
    on_it = np.unique([first, int(np.linalg.norm(x - x[first], axis=1).argmax())])
    centre, radius, chosen = _ball_of_few(x[on_it])
    for _ in range(ROUNDS):
        away = np.linalg.norm(x - centre, axis=1)
        worst = int(away.argmax())
        if away[worst] <= radius * (1.0 + SAME) or worst in on_it:
            break
        on_it = np.append(on_it[chosen], worst)
        centre, radius, chosen = _ball_of_few(x[on_it])
    return centre, float(np.linalg.norm(x - centre, axis=1).max())


def _ball_of_few(x: Array) -> tuple[Array, float, Index]:
    """Returns centre and radius of the smallest ball about up to d + 2 points (k, d), and which of them are on it."""
    found = []
    for count in range(1, min(len(x), x.shape[1] + 1) + 1):
        chosen = np.array(list(combinations(range(len(x)), count)))
        apart = x[chosen[:, 1:]] - x[chosen[:, :1]]
        squares = (apart**2).sum(axis=2, keepdims=True)
        centres = x[chosen[:, 0]] + 0.5 * (np.linalg.pinv(apart) @ squares)[..., 0] if count > 1 else x
        away = np.linalg.norm(x - centres[:, None], axis=2)
        radii = away.max(axis=1)
        best = int(radii.argmin())
        found.append((float(radii[best]), count, centres[best], chosen[best]))
    radius, _, centre, chosen = min(found, key=lambda each: each[0])
    return centre, radius, chosen


def _solid(kind: str, axes: Array, centre: Array, size: Array) -> Solid:
    """Returns a shape as one that stands in the frame of the file."""
    radius = 0.5 * float(size[0])
    length = float(size[2]) - (2.0 * radius if kind in ("sphere", "capsule") else 0.0)
    return shape_of(kind, pose(centre, axes), size if kind == "box" else np.array([radius, max(length, 0.0)]))


def _beyond(shape: Solid, triangles: Array) -> float:
    """Returns a bound on the distance of a shape's surface from the mesh in it, both of a size of about 1.

    The surface is what the sides of the box about the shape become if each point goes to the nearest one of the shape,
    which moves no two apart. Squares on these sides are quartered where the distance may be more than the largest
    known.
    """
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    fine = np.empty((0, 3, 3))
    for some in np.array_split(triangles[across.any(axis=1)], max(1, len(triangles) // AT_ONCE)):
        for parts in fine_triangles(some, FINEST):  # of many a cell at most one stays
            fine = _one_a_cell(np.concatenate([fine, parts]))
    half = 0.5 * shape.extent
    side = float(half.max())
    steps = np.array([[i, j] for i in (-1.0, 1.0) for j in (-1.0, 1.0)])
    faces = [(axis, end) for axis in range(3) for end in (-1.0, 1.0)]
    squares = np.array([np.insert([0.0, 0.0], axis, end * 1.0) for axis, end in faces])
    axes = np.array([axis for axis, _ in faces])
    most = 0.0
    reach = 1.0
    while len(squares):
        away = _distances(_onto(shape, squares * half), fine)
        most = max(most, float(away.max()))
        left = away + math.sqrt(2.0) * reach * side > most + TOLD
        reach *= 0.5
        squares, axes = squares[left], axes[left]
        moves = np.array([np.insert(reach * steps, axis, 0.0, axis=1) for axis in axes]).reshape(-1, 4, 3)
        squares, axes = (squares[:, None] + moves).reshape(-1, 3), np.repeat(axes, 4)
    return most + TOLD


def _one_a_cell(triangles: Array) -> Array:
    """Returns one triangle (k, 3, 3) of those whose middles are in the same cell of a grid of `FINEST`."""
    return triangles[np.unique(np.floor(triangles.mean(axis=1) / FINEST), axis=0, return_index=True)[1]]


def _onto(shape: Solid, p: Array) -> Array:
    """Returns the points of a shape (n, 3) nearest to points (n, 3) about it, in its own axes from its centre."""
    X = shape.X_WC
    there = p @ X[:3, :3].T + X[:3, 3]
    near = shape.nearest(there.T).T
    out = there - near
    length = np.linalg.norm(out, axis=1, keepdims=True)
    return near + out * np.minimum(1.0, shape.radius_m / np.maximum(length, SAME))


def _distances(p: Array, triangles: Array) -> Array:
    """Returns bounds on the distances (n,) of points (n, 3) from triangles (m, 3, 3): to the nearest middle's."""
    import trimesh

    middles = triangles.mean(axis=1).astype(np.float32)
    squares = (middles**2).sum(axis=1)
    parts = np.array_split(p.astype(np.float32), max(1, math.ceil(len(p) * len(middles) / PRODUCTS)))
    nearest = np.concatenate([(squares - 2.0 * some @ middles.T).argmin(axis=1) for some in parts])
    return np.linalg.norm(trimesh.triangles.closest_point(triangles[nearest], p) - p, axis=1)
