"""The report as one self-contained HTML file: scene and curves that move, facts, certificate, request.

Facts and tables are plain HTML; scene and curves are drawn by the program of `web/src/report`, which the file holds
inline. Where it does not run, the file shows the pictures of `fling.picture` and `api.report.charts`.
"""

from __future__ import annotations

import csv
import html
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from api.report.charts import joint_charts
from api.report.facts import certificate_section, execution_section, experiment_section, plan_section
from planner.answer import passing_text

PROGRAM = Path(__file__).parents[1] / "web" / "report"
NO_PICTURE = "<p>The plan's cell file is missing or has changed since planning: no picture of the arm.</p>"
# A report asks no other machine for anything: the browser is told to refuse it.
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
JOINTS = ("Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 2", "Wrist 3")


@dataclass(frozen=True)
class ReportContent:
    """What a report is about; JSON documents as the service answers them.

    Attributes:
        plan: of `GET /plans/{id}`, with its trajectory.
        picture: the plan drawn as SVG; None where its cell is unknown now.
        model: of `GET /cells/{name}/model`; None where the plan's cell is unknown now.
        curves: of `GET /plans/{id}/curves`; None likewise.
        execution: of `GET /executions/{id}`, None for a plan.
        landings: of `GET /executions/{id}/landing`.
        recording: of `GET /executions/{id}/recording`, as CSV; empty without one.
        experiment: of `GET /experiments/{id}`, None for a plan or an execution.
    """

    plan: Mapping[str, Any]
    picture: str | None = None
    model: Mapping[str, Any] | None = None
    curves: Mapping[str, Any] | None = None
    execution: Mapping[str, Any] | None = None
    landings: Sequence[Mapping[str, Any]] = ()
    recording: str = ""
    experiment: Mapping[str, Any] | None = None


def report_html(content: ReportContent) -> str:
    """Returns the report as HTML."""
    plan = content.plan
    title = html.escape(_title(content))
    request = html.escape(json.dumps(plan["request"], indent=2))
    parts = (
        f"<header><h1>{title}</h1><p>{html.escape(_subtitle(plan))}</p></header>",
        _moving(content) if content.model is not None else f"<section>{NO_PICTURE}{joint_charts(plan)}</section>",
        experiment_section(content.experiment) if content.experiment is not None else "",
        execution_section(content.execution, content.landings) if content.execution is not None else "",
        plan_section(plan),
        certificate_section(plan["certificate"]),
        f"<section><h2>Request</h2><pre>{request}</pre></section>",
    )
    style = (PROGRAM / "report.css").read_text(encoding="utf-8")
    head = (
        '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}"><title>{title}</title><style>{style}</style>'
    )
    body = f"<main>{''.join(parts)}</main>{_program(content) if content.model is not None else ''}"
    return f'<!doctype html>\n<html lang="en"><head>{head}</head><body>{body}</body></html>\n'


def _title(content: ReportContent) -> str:
    if content.experiment is not None:
        return f"Experiment {content.experiment['name'] or content.experiment['id']}"
    if content.execution is not None:
        return f"Execution {content.execution['id']}"
    return f"Plan {content.plan['id']}"


def _subtitle(plan: Mapping[str, Any]) -> str:
    flight = plan["flight"]
    where = "" if flight is None else f", lands at ({', '.join(f'{x:.2f}' for x in flight['landing_point'])}) m"
    return f"{plan['cell']}: {passing_text(plan)}{where}"


def _moving(content: ReportContent) -> str:
    """Returns the places of scene and curves, and the still pictures for where the program does not run."""
    still = f"<noscript><section>{content.picture or NO_PICTURE}{joint_charts(content.plan)}</section></noscript>"
    curves = '<section aria-label="Curves"><h2>Curves and their limits</h2><div id="curves"></div></section>'
    return f'<section id="stage" aria-label="Scene"></section>{curves}{still}'


def _program(content: ReportContent) -> str:
    """Returns the data of scene and curves and the program that draws them."""
    data = {
        "plan": content.plan,
        "model": content.model,
        "curves": content.curves,
        "landings": _landing_marks(content),
        "ellipse": _ellipse(content.experiment),
        "tracking": _tracking(content.recording),
    }
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    program = (PROGRAM / "report.js").read_text(encoding="utf-8").replace("</script", "<\\/script")
    return f'<script type="application/json" id="report-data">{text}</script><script>{program}</script>'


def _landing_marks(content: ReportContent) -> list[dict[str, Any]]:
    """Returns where objects landed: one execution's observations, or an experiment's throws."""
    places = [landing["position"] for landing in content.landings]
    if content.experiment is not None:
        places = [throw["landing"] for throw in content.experiment["throws"] if throw["plan_id"] == content.plan["id"]]
    marks = [{"id": str(i), "position": place, "newest": False} for i, place in enumerate(places) if place is not None]
    return marks if content.experiment is not None or not marks else [*marks[:-1], {**marks[-1], "newest": True}]


def _ellipse(experiment: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Returns the ellipse of an experiment's landings about its target, where it has one target."""
    if experiment is None or len(experiment["targets"]) != 1:
        return None
    target = experiment["targets"][0]
    if target["target"] is None or target["covariance_m2"] is None:
        return None
    x, y, z = target["target"]
    mean = target["mean_error_m"]
    return {"center": [x + mean[0], y + mean[1]], "covariance_m2": target["covariance_m2"], "height_m": z}


def _tracking(recording: str) -> dict[str, Any] | None:
    """Returns the measured less the planned joint positions of a recording as a curve, None without one."""
    rows = list(csv.DictReader(io.StringIO(recording)))
    if not rows:
        return None
    errors = [
        [1000 * (float(row[f"q_{joint}_rad"]) - float(row[f"planned_q_{joint}_rad"])) for row in rows]
        for joint in range(6)
    ]
    return {
        "key": "tracking",
        "label": "Measured less planned",
        "unit": "mrad",
        "check": None,
        "times": [float(row["clock_s"]) for row in rows],
        "steps": False,
        "lines": [{"label": name, "values": values} for name, values in zip(JOINTS, errors, strict=True)],
        "limits": [],
    }
