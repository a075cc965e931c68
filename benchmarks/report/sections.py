"""Sections of the report: Markdown made from the rows."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.audit import AuditResult
from benchmarks.markdown import decimals, markdown_table, percent, thousandths
from benchmarks.problem_sets import IMPOSSIBLE_SETS, sdu_facts
from benchmarks.results import ResultRow
from benchmarks.statistics import SetSummary, quantiles


def ratios(lines: Sequence[SetSummary]) -> list[str]:
    """Returns the table of release times and certified shares."""
    head = [
        "set",
        "back end",
        "certified",
        "of feasible",
        "undecided",
        "to Ruckig p10 / p50 / p90",
        "to bound p50 / p90",
        "on ticks p50 / p90",
    ]
    body = [
        [
            s.group,
            s.backend,
            percent(s.share),
            f"{s.certified} / {s.feasible}",
            str(s.drawn - s.feasible),
            decimals(s.to_ruckig),
            decimals(s.to_bound, 4),
            decimals(s.to_bound_tick, 4),
        ]
        for s in lines
        if not s.group.startswith("sdu")
    ]
    return markdown_table(head, body)


def times(lines: Sequence[SetSummary]) -> list[str]:
    """Returns the table of planning and certification times."""
    head = ["set", "back end", "plan p50 / p90 / p99 ms", "cpu p50 / p90 / p99 ms", "certificate p50 / p90 ms"]
    body = [
        [s.group, s.backend, thousandths(s.solve_s), thousandths(s.cpu_s), thousandths(s.certificate_s)] for s in lines
    ]
    return markdown_table(head, body)


def windows(lines: Sequence[SetSummary]) -> list[str]:
    """Returns the table of landing errors for early and late releases."""
    head = ["set", "back end", "±10 ms p50 / p90 mm", "±20 ms p50 / p90 mm", "±30 ms p50 / p90 mm"]
    chosen = [
        s for s in lines if s.group.startswith(("target", "robust")) and s.backend in ("ruckig", "casadi", "auto")
    ]
    body = [[s.group, s.backend, *(thousandths(s.window_m[w], 1) for w in ("10", "20", "30"))] for s in chosen]
    note = "Largest landing error for releases early or late by up to this; `robust` requires 5 mm within ±20 ms."
    return [note, "", *markdown_table(head, body)]


def refusals(rows: Sequence[ResultRow]) -> list[str]:
    """Returns the table of answers to infeasible requests."""
    head = ["set", "refused", "answer p50 / p90 / max ms", "nearest certifies", "nearest wrong", "no nearest"]
    body = []
    for group in IMPOSSIBLE_SETS:
        own = [row for row in rows if row.group == group and row.backend == "auto"]
        refused = [row for row in own if row.outcome == "infeasible"]
        kinds = [sum(row.nearest == kind for row in refused) for kind in ("certified", "wrong", "none")]
        times = quantiles([row.solve_s for row in own], 50, 90, 100)
        body.append([group, f"{len(refused)} / {len(own)}", thousandths(times), *map(str, kinds)])
    return markdown_table(head, body)


def sdu(rows: Sequence[ResultRow]) -> list[str]:
    """Returns the table of certified targets and pairs, beside the project's own numbers."""
    head = ["part", "who", "targets", "pairs", "time p50 ms"]
    body = []
    for part in ("near", "far"):
        facts = sdu_facts()[part]
        own_targets = next(v for k, v in facts.items() if k.startswith("source_hits"))["5 rad/s2"]
        own_pairs = facts["source_clean_pairs_of_2800"]["5 rad/s2"]
        count = len(facts["targets"])
        body.append([part, "the project's report, 5 rad/s²", f"{own_targets} / {count}", f"{own_pairs} / 2800", ""])
        for backend in dict.fromkeys(row.backend for row in rows if row.group == f"sdu-{part}"):
            body.append([part, f"fling {backend}", *_sdu_shares(rows, part, backend)])
    note = (
        "Targets at 5 rad/s², elevation at 22.5° or more, jerk (500 rad/s³), torque, self-collision, singularity and "
        "box limits. Pairs fix the release point too; the quick run leaves them out."
    )
    return [note, "", *markdown_table(head, body)]


def _sdu_shares(rows: Sequence[ResultRow], part: str, backend: str) -> list[str]:
    targets = [row for row in rows if row.group == f"sdu-{part}" and row.backend == backend]
    pairs = [row for row in rows if row.group == f"sdu-{part}-pairs" and row.backend == backend]
    shown = f"{sum(r.certified for r in pairs)} / {len(pairs)}" if pairs else "–"
    time = thousandths(quantiles([row.solve_s for row in targets], 50))
    return [f"{sum(r.certified for r in targets)} / {len(targets)}", shown, time]


def audit(found: AuditResult) -> list[str]:
    """Returns the result of the independent audit."""
    text = (
        f"{found.audited:,} certified plans of other random problems were audited by other libraries: poses, points, "
        "targets and robust targets on four arms, and every kind of release in varied cells (bases turned, tilted and "
        "raised, long tools off the axis, heavy objects, keep-in and keep-out boxes); back end auto, every fourth by "
        f"ruckig; {found.refused:,} more were refused. Pinocchio checked kinematics, singularities and, with MuJoCo, "
        "torques (4 ms); coal the distances (8 ms); MuJoCo simulated the flight: "
        f"**{len(found.faulty)} faulty**."
    )
    return [text, *(f"- `{name}`: {fault}" for name, fault in found.faulty)]
