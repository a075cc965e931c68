"""What a map is of: a cell as it is, planes of landing cells, and how each is planned. Its hash names the map."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, NamedTuple

import orjson

from planner.errors import FieldError, InvalidProblem

RESOLUTION_M = 0.05  # [m] by default; source: contract
RESOLUTION_RANGE_M = (0.005, 2.0)  # [m] catches typing errors; an object is not much smaller
EXTENT_MAX_M = 100.0  # [m] of any coordinate; catches typing errors
LANDING_CELLS_MAX = 200_000  # [-] in one map: seven hours at 8 a second, and 9 GB of plans
COARSE_CELLS_MAX = 100  # [-] in the first level: two cores plan them in less than ten seconds
DECIMALS = 6  # of coordinates [m]: a micrometre, so that a centre is the number that a person would write


class GridPlace(NamedTuple):
    """Row numbers of a landing cell: plane, then along y, then along x."""

    k: int
    j: int
    i: int


@dataclass(frozen=True)
class MapDefinition:
    """All that a map's answers depend on.

    Attributes:
        cell: name of the robot station.
        cell_sha256: hash of its files.
        profile: id of the profile that it uses; None: the cell file's numbers.
        planner_version: version of Fling.
        planes_z_m: heights of the planes, ascending [m].
        origin_m: centre of the landing cell with the least x and y [m].
        shape: landing cells of a plane along y, and along x.
        resolution_m: edge of a landing cell [m].
        robust: whether plans have a target's default release window; otherwise they release soonest.
    """

    cell: str
    cell_sha256: str
    profile: str | None
    planner_version: str
    planes_z_m: tuple[float, ...]
    origin_m: tuple[float, float]
    shape: tuple[int, int]
    resolution_m: float
    robust: bool

    @property
    def count(self) -> int:
        """Number of landing cells in all planes."""
        return len(self.planes_z_m) * self.shape[0] * self.shape[1]

    @cached_property
    def sha256(self) -> str:
        """Hash of the definition."""
        return hashlib.sha256(orjson.dumps(self.document(), option=orjson.OPT_SORT_KEYS)).hexdigest()

    @cached_property
    def strides(self) -> tuple[int, ...]:
        """Landing cells from one point of a level to the next, level by level: powers of two down to 1.

        The coarsest level has at most `COARSE_CELLS_MAX` points.
        """
        stride = 1
        while self._points(stride) > COARSE_CELLS_MAX:
            stride *= 2
        return tuple(2**n for n in range(stride.bit_length() - 1, -1, -1))

    def document(self) -> dict[str, Any]:
        """Returns the definition as JSON."""
        return asdict(self)

    def level(self, index: int) -> list[int]:
        """Returns the numbers of the landing cells that a level adds to those before it, ascending."""
        stride = self.strides[index]
        before = self.strides[index - 1] if index else 0
        return [
            self.number(GridPlace(k, j, i))
            for k, j, i in self._lattice(stride)
            if not before or k % before or j % before or i % before
        ]

    def number(self, place: GridPlace) -> int:
        """Returns the number of a landing cell, counted along x, then y, then the planes."""
        rows, columns = self.shape
        return (place.k * rows + place.j) * columns + place.i

    def place(self, number: int) -> GridPlace:
        """Returns where the landing cell of a number is."""
        rows, columns = self.shape
        return GridPlace(number // (rows * columns), number // columns % rows, number % columns)

    def neighbours(self, number: int) -> list[int]:
        """Returns the numbers of the landing cells around one, the nearest first: 8 in a plane, 26 in a volume."""
        here = self.place(number)
        found = []
        for dk, dj, di in _STEPS:
            there = GridPlace(here.k + dk, here.j + dj, here.i + di)
            if all(0 <= x < n for x, n in zip(there, (len(self.planes_z_m), *self.shape), strict=True)):
                found.append(self.number(there))
        return found

    def target(self, number: int) -> list[float]:
        """Returns the centre of a landing cell (3) [m], in the world."""
        k, j, i = self.place(number)
        x, y = (at + n * self.resolution_m for at, n in zip(self.origin_m, (i, j), strict=True))
        return [round(x, DECIMALS), round(y, DECIMALS), self.planes_z_m[k]]

    def request(self, number: int) -> dict[str, Any]:
        """Returns the request whose plan throws to a landing cell, as of `POST /plan`."""
        request = {"cell": self.cell, "release": {"kind": "target", "position": self.target(number)}}
        return request if self.robust else {**request, "release_window_s": 0.0}

    def _lattice(self, stride: int) -> Iterator[tuple[int, int, int]]:
        rows, columns = self.shape
        for k in range(0, len(self.planes_z_m), stride):
            for j in range(0, rows, stride):
                for i in range(0, columns, stride):
                    yield k, j, i

    def _points(self, stride: int) -> int:
        return math.prod(-(-n // stride) for n in (len(self.planes_z_m), *self.shape))


# Steps to the landing cells around one, the nearest first; equally near ones in a fixed order.
_STEPS = sorted(
    ((dk, dj, di) for dk in (-1, 0, 1) for dj in (-1, 0, 1) for di in (-1, 0, 1) if (dk, dj, di) != (0, 0, 0)),
    key=lambda step: (sum(abs(x) for x in step), step),
)


def definition_from(document: Mapping[str, Any]) -> MapDefinition:
    """Returns the definition of a document that `MapDefinition.document` made."""
    tuples = {name: tuple(document[name]) for name in ("planes_z_m", "origin_m", "shape")}
    return MapDefinition(**{**document, **tuples})


def landing_grid(
    extent_m: Sequence[float], resolution_m: float, volume_z_m: Sequence[float]
) -> tuple[tuple[float, ...], tuple[float, float], tuple[int, int]]:
    """Returns planes, origin and shape of the landing cells that cover an extent.

    Args:
        extent_m: least and largest x, least and largest y [m]; the last landing cells may reach beyond.
        resolution_m: edge of a landing cell, and distance of two planes [m].
        volume_z_m: height of the one plane, or of the lowest and the highest [m].

    Raises:
        InvalidProblem: every field that is out of its bounds.
    """
    _check(extent_m, resolution_m, volume_z_m)
    x0, x1, y0, y1 = extent_m
    low = volume_z_m[0]
    high = volume_z_m[-1]
    columns, rows = (_parts(length, resolution_m) for length in (x1 - x0, y1 - y0))
    levels = 1 if low == high else _parts(high - low, resolution_m) + 1
    count = levels * rows * columns
    if count > LANDING_CELLS_MAX:
        reason = f"{resolution_m:g} m makes {count} landing cells; a map may have {LANDING_CELLS_MAX}"
        raise InvalidProblem([FieldError("resolution_m", reason)])
    planes = tuple(round(low + k * resolution_m, DECIMALS) for k in range(levels))
    origin = (round(x0 + resolution_m / 2, DECIMALS), round(y0 + resolution_m / 2, DECIMALS))
    return planes, origin, (rows, columns)


def _check(extent_m: Sequence[float], resolution_m: float, volume_z_m: Sequence[float]) -> None:
    errors = []
    (least, most) = RESOLUTION_RANGE_M
    if not least <= resolution_m <= most:
        errors.append(FieldError("resolution_m", f"{resolution_m:g} m is not between {least:g} m and {most:g} m"))
    for name, low, high in (("x", *extent_m[:2]), ("y", *extent_m[2:])):
        if not -EXTENT_MAX_M <= low < high <= EXTENT_MAX_M:
            reason = f"{name} from {low:g} m to {high:g} m is not a range within {EXTENT_MAX_M:g} m"
            errors.append(FieldError("extent_m", reason))
    if not -EXTENT_MAX_M <= volume_z_m[0] <= volume_z_m[-1] <= EXTENT_MAX_M:
        reason = f"z from {volume_z_m[0]:g} m to {volume_z_m[-1]:g} m is not a range within {EXTENT_MAX_M:g} m"
        errors.append(FieldError("volume_m" if len(volume_z_m) > 1 else "plane_z_m", reason))
    if errors:
        raise InvalidProblem(errors)


def _parts(length_m: float, resolution_m: float) -> int:
    """Returns how many landing cells cover a length; rounding makes no further one."""
    return max(1, math.ceil(length_m / resolution_m - 1e-6))
