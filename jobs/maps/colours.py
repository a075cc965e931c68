"""What a map looks like: release times in colour, refused landing cells in a grey for each reason."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jobs.maps.landing_cells import LandingState
from jobs.maps.table import MapTable
from planner.arrays import Array, Index

Pixels = NDArray[np.uint8]  # (..., 3), from 0 to 255

# Soon is bright, late is dark, and equal steps look equal, also in grey and to the colour-blind. Source: viridis by
# S. van der Walt and N. Smith (CC0), nine of its colours, reversed.
STOPS = np.array(
    [
        (253, 231, 37), (170, 220, 50), (93, 201, 99), (39, 173, 129), (33, 145, 140),
        (44, 114, 142), (59, 82, 139), (71, 45, 123), (68, 1, 84),
    ],
    dtype=float,
)  # fmt: skip
UNKNOWN = (255, 255, 255)
PROVEN_GREYS = (70, 120)
FOUND_GREYS = (160, 215)  # [0 to 255] darkest and brightest of the reasons
LATEST_SHARE = 99.0  # [percent] of the release times are within the scale; a few late ones would flatten it


@dataclass(frozen=True)
class GreyEntry:
    """One grey of the legend: which constraint, proven or not, of how many landing cells."""

    constraint: str
    is_proven: bool
    count: int
    grey: int

    @property
    def words(self) -> str:
        """The entry in words."""
        return f"{self.constraint}, {'proven' if self.is_proven else 'not found'}: {self.count}"


@dataclass(frozen=True, eq=False)
class MapColours:
    """A map's colours.

    Attributes:
        pixels: of the landing cells (planes, along y, along x, 3), from 0 to 255; coarse points as blocks.
        scale_s: release times of the first and the last colour [s]; None without plans.
        greys: legend of the refused ones, most frequent first.
    """

    pixels: Pixels
    scale_s: tuple[float, float] | None
    greys: tuple[GreyEntry, ...]


def map_colours(table: MapTable) -> MapColours:
    """Returns the colours of a map so far."""
    times = table.measures["release_time_s"]
    known = times[np.isfinite(times)]
    scale = (float(known.min()), float(np.percentile(known, LATEST_SHARE))) if len(known) else None
    pixels = np.empty((*table.state.shape, 3), dtype=np.uint8)
    pixels[:] = UNKNOWN
    if scale is not None:
        planned = table.state == LandingState.YES
        pixels[planned] = colours_of(times[planned], scale)
    greys = _greys(table)
    for entry in greys:
        pixels[_refused_by(table, entry.constraint, entry.is_proven)] = entry.grey
    return MapColours(_blocks(table, pixels), scale, greys)


def colours_of(times_s: Array, scale_s: tuple[float, float]) -> Pixels:
    """Returns the colours (n, 3) of release times (n,) [s]."""
    low, high = scale_s
    share = np.clip((times_s - low) / max(high - low, 1e-9), 0.0, 1.0) * (len(STOPS) - 1)
    channels = [np.interp(share, np.arange(len(STOPS)), STOPS[:, k]) for k in range(3)]
    return np.stack(channels, axis=-1).round().astype(np.uint8)


def _greys(table: MapTable) -> tuple[GreyEntry, ...]:
    """Returns a grey for each constraint, proven ones darker."""
    found = []
    for state, (dark, bright) in ((LandingState.PROVEN, PROVEN_GREYS), (LandingState.NOT_FOUND, FOUND_GREYS)):
        names = [table.reasons[index][0] for index in table.reason[table.state == state]]
        counts = sorted(Counter(names).items(), key=lambda item: (-item[1], item[0]))
        levels = np.linspace(dark, bright, max(len(counts), 2)).round().astype(int).tolist()
        for (name, count), grey in zip(counts, levels, strict=False):
            found.append(GreyEntry(name, state == LandingState.PROVEN, count, grey))
    return tuple(sorted(found, key=lambda entry: -entry.count))


def _refused_by(table: MapTable, constraint: str, is_proven: bool) -> np.ndarray:
    """Returns the mask of the landing cells that a constraint refuses."""
    named = np.array([name == constraint for name, _ in table.reasons] or [False])
    state = LandingState.PROVEN if is_proven else LandingState.NOT_FOUND
    return (table.state == state) & named[table.reason]


def _blocks(table: MapTable, pixels: Pixels) -> Pixels:
    """Returns the pixels with the points of the finest completed level painted as blocks where nothing finer is."""
    if table.level_m is None:
        return pixels
    stride = round(table.level_m / table.definition.resolution_m)
    nearest = [_nearest_point(n, stride) for n in table.state.shape]
    blocks = pixels[np.ix_(*nearest)]
    return np.where((table.state == LandingState.UNKNOWN)[..., None], blocks, pixels)


def _nearest_point(count: int, stride: int) -> Index:
    """Returns for each row the nearest one of every `stride`."""
    rows = np.arange(count)
    return np.minimum((rows + stride // 2) // stride, (count - 1) // stride) * stride
