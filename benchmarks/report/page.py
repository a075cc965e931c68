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

METHOD = """A problem is drawn from a random joint state (within 1.5 rad of home, joints up to 80 % of their velocity,
tool at 0.8 m/s or more; floor, self-collision and singularity distance hold on its straight line ±50 ms) and requested
as a pose, a point, or the point where it would land. It counts as **feasible** if any back end or a slow
search (Ruckig at three speeds, through a dozen random stops, for launch and brake) found a motion that certifies;
shares are of these. Problems that nobody solved are *undecided* and counted separately. `hard` draws states
next to limits, singularities and the floor, or with every joint at 90 to 100 % of its velocity limit. All of these
start from home; the sets `…-anywhere` have the same releases and random starts. Times are wall time, warm, one process;
*cpu* is the processor time of the same calls, less affected by a busy machine. "To bound": release time over the
joint-wise lower bound with free acceleration at the release (poses only); "on ticks": the same bound rounded up to the
tick."""


PEERS_NOTE = "[ThrowBench](throwbench.md) has the table: its problems, its judge and other planners as entries."


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
    release_time = ["", "![Release times over Ruckig's](release-time.svg)"]
    bodies = {
        "Floors and goals": markdown_table(floors.HEAD, floors.floor_rows(lines, rows, audit)),
        "Time to the release": [METHOD, "", *sections.ratios(lines), *release_time],
        "Time to a plan": [*sections.times(lines), "", "![Time to a plan](solve-time.svg)"],
        "A gripper that opens early or late": [*sections.windows(lines), "", "![Landing errors](window.svg)"],
        "Infeasible requests": sections.refusals(rows),
        "The SDU table": sections.sdu(rows),
        "Other planners": [PEERS_NOTE],
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
