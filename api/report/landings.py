"""Pictures of landings seen from above, as one SVG each: those of an experiment, those behind a profile."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from api.report.standalone import TEXT, standalone_svg

SIZE = 420
EDGE = 40  # [px] side of the square picture, and its margin
RANGE_MIN_M = 0.02  # [m] a picture never shows less than this about the target
RINGS = 2  # circles about the target, the outer one at the range
RING = 'class="ring" fill="none" stroke="#999"'
DOT = 'class="landing" r="5" fill="#c33" fill-opacity="0.6"'
DOT_AFTER = 'class="explained" r="5" fill="#36c" fill-opacity="0.6"'
CROSS = 'class="target" stroke="#333" stroke-width="2"'
Point = tuple[float, float]


def landings_svg(throws: Sequence[Mapping[str, Any]]) -> str:
    """Returns the landings less their targets as one SVG; x of the world to the right, y upwards."""
    errors = [
        (t["landing"][0] - t["target"][0], t["landing"][1] - t["target"][1]) for t in throws if t["error_m"] is not None
    ]
    return _picture([(DOT, errors)], f"{len(errors)} of {len(throws)} throws; x to the right, y upwards")


def explained_svg(landings: Sequence[Mapping[str, Any]]) -> str:
    """Returns the throws behind a profile as one SVG: observed less planned, and less what the profile expects."""
    before, after = ([_less(x["observed"], x[name]) for x in landings] for name in ("planned", "expected"))
    caption = f"{len(landings)} throws: off the plan (red), off what the profile expects (blue)"
    return _picture([(DOT, before), (DOT_AFTER, after)], caption)


def _less(a: Sequence[float], b: Sequence[float]) -> Point:
    return a[0] - b[0], a[1] - b[1]


def _picture(groups: Sequence[tuple[str, Sequence[Point]]], text: str) -> str:
    """Returns groups of points [m] about a cross, each with the style of its dots."""
    reach = max([RANGE_MIN_M, *(max(abs(x), abs(y)) for _, points in groups for x, y in points)])
    centre = SIZE / 2.0
    scale = (SIZE / 2.0 - EDGE) / reach
    rings = [_ring(centre, scale, reach * (i + 1) / RINGS) for i in range(RINGS)]
    dots = [
        f'<circle {style} cx="{centre + scale * x:.1f}" cy="{centre - scale * y:.1f}"/>'
        for style, points in groups
        for x, y in points
    ]
    cross = f'<path {CROSS} d="M{centre - 8} {centre}h16M{centre} {centre - 8}v16"/>'
    return standalone_svg(SIZE, SIZE, "Landings", [*rings, cross, *dots], text)


def _ring(centre: float, scale: float, radius_m: float) -> str:
    r = scale * radius_m
    circle = f'<circle {RING} cx="{centre}" cy="{centre}" r="{r:.1f}"/>'
    return f'{circle}<text {TEXT} x="{centre + 4}" y="{centre - r - 4:.1f}">{1000 * radius_m:.0f} mm</text>'
