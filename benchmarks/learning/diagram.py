"""The reliability diagram: hits against predicted probability, with the band of an honest forecast, as SVG."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.learning.reliability import Bin

SIZE = 360
EDGE = 46  # [px]


def reliability_svg(bins: Sequence[Bin], title: str) -> str:
    """Returns the diagram of these bins."""
    box = f'viewBox="0 0 {SIZE + 2 * EDGE} {SIZE + 2 * EDGE}" font-family="sans-serif" font-size="13"'
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" {box} text-anchor="middle">']
    parts.append(f'<rect width="100%" height="100%" fill="white"/><text x="{EDGE + SIZE / 2}" y="24">{title}</text>')
    for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
        parts.append(f'<path d="M{_x(tick)} {_y(0)}V{_y(1)}M{_x(0)} {_y(tick)}H{_x(1)}" stroke="#ddd"/>')
        parts.append(f'<text x="{_x(tick)}" y="{_y(0) + 18}">{tick:g}</text>')
        parts.append(f'<text x="{_x(0) - 20}" y="{_y(tick) + 4}">{tick:g}</text>')
    parts.append(f'<path d="M{_x(0)} {_y(0)}L{_x(1)} {_y(1)}" stroke="#888" stroke-dasharray="4 4"/>')
    for b in bins:
        x, low, high = _x(b.predicted), *map(_y, b.band)
        parts.append(f'<path d="M{x} {low}V{high}" stroke="#9bb8d3" stroke-width="12" opacity="0.7"/>')
        parts.append(f'<circle cx="{x}" cy="{_y(b.hit)}" r="4.5" fill="{"#1b4f72" if b.is_inside else "#c0392b"}"/>')
    parts.append(
        f'<text x="{EDGE + SIZE / 2}" y="{SIZE + 2 * EDGE - 8}">predicted probability of a hit within 5 cm</text>'
    )
    parts.append(f'<text transform="translate(14 {EDGE + SIZE / 2}) rotate(-90)">share of hits</text></svg>')
    return "\n".join(parts) + "\n"


def _x(value: float) -> float:
    return round(EDGE + SIZE * value, 1)


def _y(value: float) -> float:
    return round(EDGE + SIZE * (1.0 - min(max(value, 0.0), 1.0)), 1)
