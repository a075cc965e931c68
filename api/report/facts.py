"""What a report says in words and numbers: tables of a plan, its certificate, its execution, an experiment."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

from api.report.landings import landings_svg
from planner.answer import passing_text

KEY_METRICS = (  # of an execution: key, label, factor, unit
    ("landing_error_m", "landing error", 1000.0, "mm"),
    ("release_velocity_error_rad_s", "joint velocity error at the release", 1.0, "rad/s"),
    ("missed_ticks", "missed ticks", 1.0, ""),
    ("ticks", "ticks", 1.0, ""),
)


def plan_section(plan: Mapping[str, Any]) -> str:
    """Returns when, how and with which release and flight the plan was made."""
    solver = plan["solver"]
    flight = plan["flight"]
    facts = [
        ("planned", plan["created_at"]),
        ("cell", f"{plan['cell']} (sha256 {plan['cell_sha256'][:12]}…)"),
        ("back end", f"{plan['backend']}, {1000 * solver['solve_time_s']:.1f} ms: {solver['status']}"),
        ("motion", passing_text(plan)),
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
        window_ms = 1000 * flight["release_window_s"]
        tolerance_mm = 1000 * flight["landing_tolerance_m"]
        facts.append(("release window", f"± {window_ms:.3g} ms: lands within {tolerance_mm:.3g} mm"))
    for when, shift in flight.get("landing_shift_10ms_m", {}).items():
        moved = "it may never land" if shift is None else f"the landing moves by {1000 * shift:.0f} mm"
        facts.append((f"release 10 ms {when}", moved))
    return facts


def certificate_section(certificate: Mapping[str, Any]) -> str:
    """Returns the certificate as a table with margin bars; an instant is a button that goes there."""
    head = "".join(f"<th>{name}</th>" for name in ("check", "value", "", "limit", "unit", "margin", "", "at [s]", ""))
    rows = "".join(map(_check_row, certificate["checks"]))
    missing = certificate.get("not_checked") or ()
    note = f"<p>Not checked: {html.escape('; '.join(missing))}</p>" if missing else ""
    return f"<section><h2>Certificate</h2><table><tr>{head}</tr>{rows}</table>{note}</section>"


def _check_row(check: Mapping[str, Any]) -> str:
    texts = [check["name"].replace("_", " "), _text(check["value"]), _relation(check), _text(check["limit"])]
    texts += [_text(check["unit"]), _text(check["margin"])]
    numbers = "".join(f"<td>{html.escape(text)}</td>" for text in texts)
    bar = f'<td class="bar"><span style="width:{100 * _share_left(check):.0f}%"></span></td>'
    at = (
        ""
        if check["at_s"] is None
        else f'<button type="button" data-time="{check["at_s"]:.6f}">{check["at_s"]:.3f}</button>'
    )
    verdict = '<td class="ok">ok</td>' if check["ok"] else '<td class="bad">VIOLATED</td>'
    return f"<tr>{numbers}{bar}<td>{at}</td>{verdict}</tr>"


def _relation(check: Mapping[str, Any]) -> str:
    """Returns how a value stands to its limit: a limit from below is told by the sign of its margin."""
    value, limit, margin = (check[name] for name in ("value", "limit", "margin"))
    if value is None or limit is None or margin is None:
        return ""
    is_lower = value != limit and (value > limit) == (margin > 0.0)
    if check["ok"]:
        return "≥" if is_lower else "≤"
    return "<" if is_lower else ">"


def _share_left(check: Mapping[str, Any]) -> float:
    """Returns the margin as a share of the limit, 0 to 1."""
    margin, limit, value = (check[name] for name in ("margin", "limit", "value"))
    scale = max(abs(limit or 0.0), abs(value or 0.0))
    return 0.0 if margin is None or scale == 0.0 else min(1.0, max(0.0, margin / scale))


def execution_section(execution: Mapping[str, Any], landings: Sequence[Mapping[str, Any]]) -> str:
    """Returns what became of an execution: outcome, the numbers that matter, observed landings, every metric."""
    metrics = execution.get("metrics") or {}
    rows = [
        ("execution", execution["id"]),
        ("outcome", _outcome_text(execution)),
        ("reason", execution.get("reason") or ""),
        *(
            (label, f"{factor * metrics[key]:.4g} {unit}")
            for key, label, factor, unit in KEY_METRICS
            if _is_number(metrics.get(key))
        ),
        *((f"landing by {landing['source']}", _landing_text(landing)) for landing in landings),
    ]
    everything = [(name, _text(value)) for name, value in sorted(metrics.items())]
    details = f"<details><summary>Every metric</summary><table>{_rows(everything)}</table></details>"
    return f"<section><h2>Execution</h2><table>{_rows([row for row in rows if row[1]])}</table>{details}</section>"


def _outcome_text(execution: Mapping[str, Any]) -> str:
    """Returns what came of an execution; a dry run is no move."""
    outcome = execution["outcome"] or execution["state"]
    return f"{outcome}, as a dry run: nothing moved" if execution.get("dry_run") else outcome


def experiment_section(experiment: Mapping[str, Any]) -> str:
    """Returns the statistics of a series of throws, its scatter, and a row for each throw."""
    statistics = experiment["statistics"]
    mean = statistics["mean_error_m"]
    facts = [
        ("experiment", experiment["name"] or experiment["id"]),
        ("outcomes", ", ".join(f"{count} {name}" for name, count in statistics["outcomes"].items())),
        ("mean error", "" if mean is None else f"({1000 * mean[0]:.1f}, {1000 * mean[1]:.1f}) mm along x and y"),
        *((f"{name} distance", _millimetres(statistics[f"{name}_distance_m"])) for name in ("median", "largest")),
    ]
    head = "<tr><th>throw</th><th>outcome</th><th>target [m]</th><th>landing [m]</th><th>distance</th></tr>"
    throws = [_throw_row(i, throw) for i, throw in enumerate(experiment["throws"], start=1)]
    table = f"<table>{_rows([row for row in facts if row[1]])}</table>"
    summary = f'<div class="split">{table}{landings_svg(experiment["throws"])}</div>'
    return f"<section><h2>Experiment</h2>{summary}<table>{head}{_rows(throws)}</table></section>"


def _throw_row(number: int, throw: Mapping[str, Any]) -> tuple[str, ...]:
    outcome = throw["outcome"] or throw["state"]
    return (str(number), outcome, _place(throw["target"]), _place(throw["landing"]), _millimetres(throw["error_m"]))


def _landing_text(landing: Mapping[str, Any]) -> str:
    if landing["position"] is None:
        return f"{landing['result']}, {_millimetres(landing['radius_m'])}"
    return f"({_place(landing['position'])}) m, ± {_millimetres(landing['std_m'])}"


def _place(point: Sequence[float] | None) -> str:
    return "" if point is None else ", ".join(f"{x:.4f}" for x in point)


def _millimetres(length_m: float | None) -> str:
    return "" if length_m is None else f"{1000 * length_m:.1f} mm"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _rows(rows: Sequence[Sequence[str]]) -> str:
    return "".join("<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)


def _text(value: Any) -> str:
    if _is_number(value):
        return f"{value:.4g}"
    return "" if value is None else str(value)
