"""A picture of the lag that runs have shown, beside the one that plans assume, as one SVG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from api.report.standalone import TEXT, standalone_svg

WIDTH = 520
HEIGHT = 280
EDGE = 48  # [px] of the picture, and its margin
ROOM_S = 0.002  # [s] about the lags shown: a difference below a millisecond looks small, as it is
SIGMAS = 2.0  # [-] standard errors to each side of a run
RUN = 'class="run" stroke="#36c" stroke-width="2" fill="#36c"'
ASSUMED = 'class="assumed" stroke="#c33" stroke-dasharray="6 4" fill="none"'
POOLED = 'class="pooled" stroke="#36c" fill="none"'


def lags_svg(runs: Sequence[Mapping[str, Any]], pooled_s: float, assumed_s: float) -> str:
    """Returns the lags of runs, oldest on the left, with two standard errors.

    Args:
        runs: timings with `lag_s` and `lag_std_s`, oldest first.
        pooled_s: lag of all of them together [s].
        assumed_s: lag that plans assume [s].
    """
    ends = [run["lag_s"] + side * SIGMAS * run["lag_std_s"] for run in runs for side in (-1.0, 1.0)]
    low = min([*ends, assumed_s]) - ROOM_S
    high = max([*ends, assumed_s]) + ROOM_S

    def y(lag_s: float) -> float:
        return EDGE + (HEIGHT - 2 * EDGE) * (high - lag_s) / (high - low)

    lines = [_line(ASSUMED, y(assumed_s), f"assumed {1e3 * assumed_s:.1f} ms", above=assumed_s >= pooled_s),
             _line(POOLED, y(pooled_s), f"measured {1e3 * pooled_s:.1f} ms", above=assumed_s < pooled_s)]  # fmt: skip
    dots = []
    for i, run in enumerate(runs):
        x = EDGE + (WIDTH - 2 * EDGE) * (i + 0.5) / len(runs)
        spread = SIGMAS * run["lag_std_s"]
        dots.append(f'<path {RUN} d="M{x:.1f} {y(run["lag_s"] - spread):.1f}V{y(run["lag_s"] + spread):.1f}"/>')
        dots.append(f'<circle {RUN} cx="{x:.1f}" cy="{y(run["lag_s"]):.1f}" r="4"/>')
    words = f"lag of {len(runs)} motions, oldest on the left, two standard errors"
    return standalone_svg(WIDTH, HEIGHT, "Lags", [*lines, *dots], words)


def _line(style: str, y: float, text: str, above: bool) -> str:
    """Returns a level line with its words at the right end, above or below it."""
    line = f'<path {style} d="M{EDGE} {y:.1f}H{WIDTH - EDGE}"/>'
    return f'{line}<text {TEXT} x="{WIDTH - EDGE}" y="{y - 6 if above else y + 16:.1f}" text-anchor="end">{text}</text>'
