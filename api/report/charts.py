"""Curves of the joints over time as plain SVG: what a report shows where its program does not run."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

WIDTH = 900
HEIGHT = 220
LEFT = 60
RIGHT = 110
EDGE = 22  # [px] of one chart and its margins
CHARTS = (
    ("positions", "Joint positions [rad]"),
    ("velocities", "Joint velocities [rad/s]"),
    ("accelerations", "Joint accelerations [rad/s²]"),
)
COLOURS = ("#0b6bcb", "#e07b00", "#1a7f37", "#c62828", "#7a4fbf", "#0097a7")


def joint_charts(plan: Mapping[str, Any]) -> str:
    """Returns charts of positions, velocities and accelerations of a plan's joints as HTML."""
    trajectory = plan["trajectory"]
    times = trajectory["time_from_start"]
    names = trajectory["joint_names"]
    passed = [(each["name"], each["time_s"]) for each in plan.get("passages", ())]
    lines = [each for each in plan.get("passages", ()) if each["end_index"] > each["index"]]
    passed += [(f"{each['name']} ends", each["end_index"] / plan["sample_rate_hz"]) for each in lines]
    marks = passed or [("release", plan["release_time_s"])]
    charts = (f"<h2>{title}</h2>{_chart(times, trajectory[name], names, marks)}" for name, title in CHARTS)
    return "".join(charts)


def _chart(
    times: Sequence[float], values: Sequence[Sequence[float]], names: Sequence[str], marks: Sequence[tuple[str, float]]
) -> str:
    """Returns a chart of all joints over time, with names at times [s] marked."""
    t = np.asarray(times)
    y = np.asarray(values)
    low = float(y.min())
    high = float(y.max())
    x_of = LEFT + (WIDTH - LEFT - RIGHT) * t / max(float(t[-1]), 1e-9)
    y_of = EDGE + (HEIGHT - 2 * EDGE) * (high - y) / max(high - low, 1e-9)
    lines = [_axis(low, high, float(t[-1]))]
    lines += [_mark(LEFT + (WIDTH - LEFT - RIGHT) * at_s / float(t[-1]), name) for name, at_s in marks]
    for joint, (name, colour) in enumerate(zip(names, COLOURS, strict=True)):
        points = " ".join(f"{px:.1f},{py:.1f}" for px, py in zip(x_of, y_of[:, joint], strict=True))
        lines.append(f'<polyline fill="none" stroke="{colour}" stroke-width="1.6" points="{points}"/>')
        at = f'x="{WIDTH - RIGHT + 8}" y="{EDGE + 16 * joint + 8}" font-size="12" fill="{colour}"'
        lines.append(f"<text {at}>{name.removesuffix('_joint')}</text>")
    return f'<svg class="picture" viewBox="0 0 {WIDTH} {HEIGHT}" role="img">{"".join(lines)}</svg>'


def _axis(low: float, high: float, end_s: float) -> str:
    bottom = HEIGHT - EDGE
    return (
        f'<rect x="{LEFT}" y="{EDGE}" width="{WIDTH - LEFT - RIGHT}" height="{bottom - EDGE}" class="frame"/>'
        f'<text class="label" x="4" y="{EDGE + 6}">{high:.3g}</text>'
        f'<text class="label" x="4" y="{bottom}">{low:.3g}</text>'
        f'<text class="label" x="{LEFT}" y="{HEIGHT - 4}">0 s</text>'
        f'<text class="label" x="{WIDTH - RIGHT - 40}" y="{HEIGHT - 4}">{end_s:.3f} s</text>'
    )


def _mark(x: float, name: str) -> str:
    return (
        f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{EDGE}" y2="{HEIGHT - EDGE}" stroke="#8888" stroke-dasharray="4 3"/>'
        f'<text class="label" x="{x + 4:.1f}" y="{EDGE - 6}">{html.escape(name)}</text>'
    )
