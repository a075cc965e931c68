"""The report of a plan as one self-contained HTML file: request, pictures, joints over time, certificate."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from api.report.picture import plan_svg
from planner.cell import Cell

STYLE = Path(__file__).with_name("style.css")
WIDTH, HEIGHT, LEFT, RIGHT, EDGE = 900, 220, 60, 110, 22  # [px] of one chart and its margins
CHARTS = (
    ("positions", "Joint positions [rad]"),
    ("velocities", "Joint velocities [rad/s]"),
    ("accelerations", "Joint accelerations [rad/s²]"),
)
COLOURS = ("#0b6bcb", "#e07b00", "#1a7f37", "#c62828", "#7a4fbf", "#0097a7")


def report_html(plan: Mapping[str, Any], cell: Cell | None) -> str:
    """Returns the report of a plan as HTML.

    Args:
        plan: The plan as JSON, as `GET /plans/{id}` answers it.
        cell: Its cell; without it, or if the file has changed since, the report has no picture of the arm.
    """
    if cell is not None and cell.sha256 == plan["cell_sha256"]:
        picture = plan_svg(plan, cell)
    else:
        picture = "<p>The plan's cell file is missing or has changed since planning: no picture of the arm.</p>"
    release = plan["release_time_s"]
    trajectory = plan["trajectory"]
    charts = "".join(
        f"<h2>{title}</h2>{_chart(trajectory['time_from_start'], trajectory[name], trajectory['joint_names'], release)}"
        for name, title in CHARTS
    )
    request = html.escape(json.dumps(plan["request"], indent=2))
    parts = (
        _facts(plan),
        f"<section>{picture}</section>",
        f"<section>{charts}</section>",
        _checks(plan["certificate"]),
        f"<section><h2>Request</h2><pre>{request}</pre></section>",
    )
    title = html.escape(f"Plan {plan['id']}")
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{STYLE.read_text()}</style></head><body><main><header><h1>{title}</h1></header>{''.join(parts)}"
        "</main></body></html>\n"
    )


def _facts(plan: Mapping[str, Any]) -> str:
    solver, flight = plan["solver"], plan["flight"]
    facts = [
        ("planned", plan["created_at"]),
        ("cell", f"{plan['cell']} (sha256 {plan['cell_sha256'][:12]}…)"),
        ("back end", f"{plan['backend']}, {1000 * solver['solve_time_s']:.1f} ms: {solver['status']}"),
        ("release", f"after {plan['release_time_s']:.3f} s of {plan['duration_s']:.3f} s"),
    ]
    if plan.get("way_home"):
        facts.append(("way home", f"{plan['way_home']['duration_s']:.1f} s from the plan's end"))
    if flight is not None:
        point = ", ".join(f"{value:.4f}" for value in flight["landing_point"])
        speed_and_time = f"{flight['speed_m_s']:.2f} m/s, {flight['time_of_flight_s']:.3f} s"
        facts.append(("flight", f"{speed_and_time}, lands at ({point}) m"))
        facts += _release_facts(flight)
    for attempt in solver["attempts"]:
        facts.append((f"tried {attempt['backend']}", f"{attempt['result']} ({1000 * attempt['duration_s']:.0f} ms)"))
    return f"<section><table>{_rows(facts)}</table></section>"


def _release_facts(flight: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Returns what the plan holds for a release that is not on time; plans of version 0.1 do not state it."""
    facts = []
    if flight.get("release_window_s"):
        window_ms, tolerance_mm = 1000 * flight["release_window_s"], 1000 * flight["landing_tolerance_m"]
        facts.append(("release window", f"± {window_ms:.3g} ms: lands within {tolerance_mm:.3g} mm"))
    for when, shift in flight.get("landing_shift_10ms_m", {}).items():
        moved = "it may never land" if shift is None else f"the landing moves by {1000 * shift:.0f} mm"
        facts.append((f"release 10 ms {when}", moved))
    return facts


def _checks(certificate: Mapping[str, Any]) -> str:
    columns = ("name", "value", "limit", "unit", "margin", "at_s")
    rows = [
        (*(_cell(check[column]) for column in columns), "ok" if check["ok"] else "VIOLATED")
        for check in certificate["checks"]
    ]
    head = "<tr><th>check</th><th>value</th><th>limit</th><th>unit</th><th>margin</th><th>at [s]</th><th></th></tr>"
    return f"<section><h2>Certificate</h2><table>{head}{_rows(rows)}</table></section>"


def _rows(rows: Sequence[Sequence[str]]) -> str:
    return "".join("<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)


def _cell(value: str | float | None) -> str:
    return value if isinstance(value, str) else "" if value is None else f"{value:.4g}"


def _chart(times: Sequence[float], values: Sequence[Sequence[float]], names: Sequence[str], release_s: float) -> str:
    """Returns a chart of all joints over time, with the release marked."""
    t, y = np.asarray(times), np.asarray(values)
    low, high = float(y.min()), float(y.max())
    x_of = LEFT + (WIDTH - LEFT - RIGHT) * t / max(float(t[-1]), 1e-9)
    y_of = EDGE + (HEIGHT - 2 * EDGE) * (high - y) / max(high - low, 1e-9)
    lines = [_axis(low, high, float(t[-1])), _release_line(LEFT + (WIDTH - LEFT - RIGHT) * release_s / float(t[-1]))]
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


def _release_line(x: float) -> str:
    return (
        f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{EDGE}" y2="{HEIGHT - EDGE}" stroke="#8888" stroke-dasharray="4 3"/>'
        f'<text class="label" x="{x + 4:.1f}" y="{EDGE - 6}">release</text>'
    )
