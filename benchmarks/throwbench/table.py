"""ThrowBench's table, as a page and as JSON."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.markdown import decimals, markdown_table, thousandths
from benchmarks.results import machine_words
from benchmarks.statistics import quantiles
from benchmarks.throwbench.problem_document import Problem
from benchmarks.throwbench.run import ThrowRow

COLUMNS = (
    "entry",
    "solved",
    "invalid",
    "refused",
    "cut, crashed",
    "release over best p50",
    "processor p50 / p90 s",
    "10 ms early / late mm",
    "broken rules",
)
NOTE = """Shares are of all problems. *Release over best*: its time over the soonest valid one of this run, median of
its valid answers. *10 ms early / late*: median distance from the target of the same motion released 10 ms off.
*Processor*: of each answer, refusals among them. Rules are counted once an answer. The JSON file beside this page has
the numbers by set; [Entries](../throwbench.md#entries) says what each was given."""


def summary(rows: Sequence[ThrowRow], best: dict[str, float]) -> dict[str, Any]:
    """Returns the numbers of one entry on one set.

    Args:
        rows: Its rows.
        best: Soonest valid release time of each problem [s].
    """
    good = [row for row in rows if row.solved]
    verdicts = [row.verdict for row in good]
    outcomes = Counter(row.outcome for row in rows)
    rules = Counter(rule for row in rows for rule in {fault["rule"] for fault in row.verdict["faults"]})
    return {
        "entry": rows[0].entry,
        "set": rows[0].set,
        "problems": len(rows),
        "outcomes": dict(outcomes),
        "release_over_best_p50": quantiles([row.verdict["release_time_s"] / best[row.problem] for row in good], 50)[0],
        "release_time_p50_s": quantiles([v["release_time_s"] for v in verdicts], 50)[0],
        "wall_s": quantiles([row.wall_s for row in rows], 50, 90),
        "processor_s": quantiles([row.processor_s for row in rows], 50, 90),
        "landing_error_p50_m": quantiles([v["landing_error_m"] for v in verdicts], 50)[0],
        "early_error_p50_m": quantiles([v["early_error_m"] for v in verdicts], 50)[0],
        "late_error_p50_m": quantiles([v["late_error_m"] for v in verdicts], 50)[0],
        "rules": dict(rules.most_common()),
    }


def soonest(rows: Iterable[ThrowRow]) -> dict[str, float]:
    """Returns the soonest valid release time of each problem that anyone solved [s]."""
    best: dict[str, float] = {}
    for row in rows:
        if row.solved:
            best[row.problem] = min(best.get(row.problem, math.inf), row.verdict["release_time_s"])
    return best


def write_table(
    page: Path,
    about: dict[str, str],
    rows: Sequence[ThrowRow],
    problems: dict[str, list[Problem]],
    missing: dict[str, str],
) -> None:
    """Writes the page, and beside it a JSON file with the same numbers and every row.

    Args:
        page: The page.
        about: Conditions of the run.
        rows: Rows of the run.
        problems: Problems asked, by set.
        missing: Entries that could not be loaded, with the reason.
    """
    best = soonest(rows)
    entries = list(dict.fromkeys(row.entry for row in rows))
    parts = {name: [_of(rows, entry, name) for entry in entries] for name in problems}
    summaries = [summary(own, best) for part in parts.values() for own in part if own]
    lines = _head(about, missing)
    lines += [*markdown_table(COLUMNS, [_cells(summary(_by(rows, entry), best)) for entry in entries]), ""]
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text("\n".join(lines), encoding="utf-8")
    document = {"about": about, "missing": missing, "summaries": summaries, "rows": [asdict(row) for row in rows]}
    text = json.dumps(_finite(document), separators=(",", ":"))
    page.with_suffix(".json").write_text(text + "\n", encoding="utf-8")


def _head(about: dict[str, str], missing: dict[str, str]) -> list[str]:
    lines = [
        "# ThrowBench: table",
        "",
        f"{machine_words(about)} One run of `{about['command']}`; numbers are of this run alone.",
        "",
        *NOTE.splitlines(),
        "",
    ]
    return lines + [line for name, reason in missing.items() for line in (f"Left out: `{name}` ({reason}).", "")]


def _cells(s: dict[str, Any]) -> list[str]:
    outcomes = Counter(s["outcomes"])
    count = s["problems"]
    cut = outcomes["timed out"] + outcomes["crashed"]
    shares = [f"{100.0 * n / count:.0f} %" for n in (outcomes["solved"], outcomes["invalid"], outcomes["refused"], cut)]
    return [
        s["entry"],
        *shares,
        decimals([s["release_over_best_p50"]], 2),
        decimals(s["processor_s"], 2),
        thousandths([s[f"{side}_error_p50_m"] for side in ("early", "late")]),
        ", ".join(f"{rule} {n}" for rule, n in s["rules"].items()),
    ]


def _by(rows: Sequence[ThrowRow], entry: str) -> list[ThrowRow]:
    return [row for row in rows if row.entry == entry]


def _of(rows: Sequence[ThrowRow], entry: str, name: str) -> list[ThrowRow]:
    return [row for row in rows if row.entry == entry and row.set == name]


def _finite(value: Any) -> Any:
    """Returns a document with null for what is no number."""
    match value:
        case dict():
            return {key: _finite(item) for key, item in value.items()}
        case list() | tuple():
            return [_finite(item) for item in value]
        case float() if not math.isfinite(value):
            return None
    return value
