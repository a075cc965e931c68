"""The report: one Markdown page, three pictures, and the numbers as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from tests.benchmarks import floors, pictures, sections
from tests.benchmarks.audit import Audit
from tests.benchmarks.peers import PEERS
from tests.benchmarks.peers.sdu_method import Tally
from tests.benchmarks.sets import ANYWHERE
from tests.benchmarks.statistics import Summary, summarise
from tests.benchmarks.task import Row

REFERENCE = "known"
RULE = """A problem is drawn from a random joint state (within 1.5 rad of home, joints up to 80 % of their velocity,
tool at 0.8 m/s or more; floor, self-collision and singularity distance hold on its straight line ±50 ms) and asked
for as a pose, a point, or the place where it would land. It counts as **feasible** when any back end, any peer, or a
slow search (Ruckig at three speeds, through a dozen random stops, with brakes likewise) found a motion that
certifies; shares are of these. What nobody solved is counted as *undecided* and shown beside it. `hard` draws states
next to limits, singularities and the floor, or with every joint at 90 to 100 % of its velocity. All of these start from
home; the sets `…-anywhere` ask for the same releases from starts that are drawn like them. Times are wall time,
warm, one process; *cpu* is the processor time of the same calls, which a busy machine changes less. "To bound":
release time over the joint-wise lower bound with free acceleration at the release (poses only); "on ticks": the bound
rounded up to the tick, which no release on a tick can beat."""


def write(out: Path, about: dict[str, str], rows: Sequence[Row], judged: Audit, sdu: dict[str, Tally]) -> None:
    """Writes README.md, the pictures and results.json into `out`."""
    out.mkdir(parents=True, exist_ok=True)
    lines = summaries(rows)
    verdicts = floors.verdicts(lines, rows, judged)
    page = [
        "# Benchmarks",
        "",
        f"{about['date']}, {about['processor']}, {about['system']}; load {about['load']}; commit {about['commit']};",
        f"{about['versions']}. One run of `{about['command']}`; numbers are of this run alone.",
        "",
        "## What it must show",
        "",
        *sections.table_of(floors.HEAD, [list(v) for v in verdicts]),
        "",
        "## Time to the release",
        "",
        RULE,
        "",
        *sections.ratios(lines),
        "",
        "![Release times over Ruckig's](release-time.svg)",
        "",
        "## Time to a plan",
        "",
        *sections.times(lines),
        "",
        "![Time to a plan](solve-time.svg)",
        "",
        "## A gripper that opens early or late",
        "",
        *sections.windows(lines),
        "",
        "![Landing errors](window.svg)",
        "",
        "## What cannot be done",
        "",
        *sections.refusals(rows),
        "",
        "## The SDU table",
        "",
        *sections.sdu(rows, sdu),
        "",
        "## Peers",
        "",
        *sections.peers(rows),
        "",
        "## Wrong certificates",
        "",
        *sections.audit(judged),
        "",
    ]
    (out / "README.md").write_text("\n".join(page), encoding="utf-8")
    document = {"about": about, "summaries": [asdict(s) for s in lines], "audit": asdict(judged)}
    (out / "results.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    pictures.draw(out, rows)


def feasible(rows: Sequence[Row]) -> set[str]:
    """Returns the names of the tasks that anything certified; a robust one is where its nominal sister is."""
    known = {row.task for row in rows if row.certified}
    robust = {row.task for row in rows if row.group.startswith("robust") and nominal_sister(row.task) in known}
    return known | robust


def nominal_sister(task: str) -> str:
    """Returns the name of the `target` problem that a robust one is made from."""
    group, number = task.split("/", 1)
    return f"target{ANYWHERE if group.endswith(ANYWHERE) else ''}/{number}"


def summaries(rows: Sequence[Row]) -> list[Summary]:
    """Returns one summary a set and back end, in the order they ran."""
    known, lines = feasible(rows), []
    for group in dict.fromkeys(row.group for row in rows if row.group not in sections.REFUSED):
        own = [row for row in rows if row.group == group]
        for backend in dict.fromkeys(row.backend for row in own):
            if backend != REFERENCE and backend not in PEERS:
                lines.append(summarise(group, backend, own, known))
    return lines
