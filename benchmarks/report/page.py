"""The page of the report: README.md with its sections, and results.json."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from benchmarks.audit import AuditResult
from benchmarks.feasibility_search import SEARCH
from benchmarks.markdown import markdown_table
from benchmarks.problem_sets import ANYWHERE, IMPOSSIBLE_SETS
from benchmarks.report import floors, pictures, sections
from benchmarks.results import ResultRow, machine_words
from benchmarks.statistics import SetSummary, summarise

METHOD = """A problem is drawn from a random joint state within 1.5 rad of home, joints up to 80 % of their velocity,
and requested as a pose, a point, or the point where it would land. Sets start from home, `…-anywhere` from random
postures. A cell of the table has the certified share of the feasible problems, and the median release time over
Ruckig's. Times are wall time; results.json has every number, ThrowBench other planners."""


def write_report(out: Path, about: dict[str, str], rows: Sequence[ResultRow], audit: AuditResult) -> None:
    """Writes README.md, the pictures and results.json.

    Args:
        out: Folder of the report.
        about: Conditions of the run, from `machine`, and its command.
        rows: Rows of the run.
        audit: Result of the audit.
    """
    out.mkdir(parents=True, exist_ok=True)
    lines = summaries(rows)
    page = _page(about, lines, rows, audit)
    (out / "README.md").write_text("\n".join(page), encoding="utf-8")
    document = {"about": about, "summaries": [asdict(s) for s in lines], "audit": asdict(audit)}
    (out / "results.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    pictures.draw(out, rows)


def _page(
    about: dict[str, str],
    lines: Sequence[SetSummary],
    rows: Sequence[ResultRow],
    audit: AuditResult,
) -> list[str]:
    head = [
        "# Benchmarks",
        "",
        f"{machine_words(about)} One run of `{about['command']}`; numbers are of this run alone.",
        "",
    ]
    shown = {"Release times over Ruckig's": "release-time", "Time to a plan": "solve-time", "Landing errors": "window"}
    pictures_of = [line for title, name in shown.items() for line in ("", f"![{title}]({name}.svg)")]
    bodies = {
        "Floors": markdown_table(floors.HEAD, floors.floor_rows(lines, rows, audit)),
        "By back end": [METHOD, "", *sections.by_backend(lines), *pictures_of],
        "Wrong certificates": sections.audit(audit),
    }
    return head + [line for title, body in bodies.items() for line in (f"## {title}", "", *body, "")]


def feasible(rows: Sequence[ResultRow]) -> set[str]:
    """Returns the names of the feasible tasks; a robust one counts as feasible if its nominal version is."""
    known = {row.task for row in rows if row.certified}
    robust = {row.task for row in rows if row.group.startswith("robust") and nominal_version(row.task) in known}
    return known | robust


def nominal_version(task: str) -> str:
    """Returns the name of the `target` task that a robust one is derived from."""
    group, number = task.split("/", 1)
    return f"target{ANYWHERE if group.endswith(ANYWHERE) else ''}/{number}"


def summaries(rows: Sequence[ResultRow]) -> list[SetSummary]:
    """Returns the statistics of every set and back end, in the order of the run."""
    known = feasible(rows)
    lines = []
    for group in dict.fromkeys(row.group for row in rows if row.group not in IMPOSSIBLE_SETS):
        own = [row for row in rows if row.group == group]
        for backend in dict.fromkeys(row.backend for row in own):
            if backend != SEARCH:
                lines.append(summarise(group, backend, own, known))
    return lines
