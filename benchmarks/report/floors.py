"""The table of floors, with the values measured in this run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

from benchmarks.audit import AuditResult
from benchmarks.problem_sets import ANYWHERE
from benchmarks.results import ResultRow
from benchmarks.runner import certificate_time
from benchmarks.statistics import SetSummary, paired_ratios, quantiles

HEAD = ("quantity", "floor", "measured", "met")
SHARES = {"pose": 0.995, "point": 0.99, "target": 0.995}  # [-] certified
TIMES_S = {"pose": (0.025, 0.250), "point": (0.030, 0.450), "target": (0.055, 0.300)}  # [s] p50, p99 of a plan
TO_RUCKIG = {"pose": 1.0, "point": 0.88, "target": 0.58}  # [-] p50 of the release time over Ruckig's
TO_BOUND = (1.01, 1.05)  # [-] p50, p90 of the release time over the joint-wise bound
ROBUST_ERROR_M = 0.010
ROBUST_SHARE = 0.90
ROBUST_TIME = 1.2  # [m], [-] of the plans, [-] of the nominal release time
REACH_S = 0.3
OTHER_S = 1.5  # [s] to refuse an unreachable release, and one that is too fast
SAMPLES = 750
CERTIFICATE_S = 0.003  # of a plan of 1.5 s at 500 Hz; [s] to certify it

T = TypeVar("T")
FloorRow = tuple[str, str, str, str]


def floor_rows(lines: Sequence[SetSummary], rows: Sequence[ResultRow], audit: AuditResult) -> list[FloorRow]:
    """Returns the rows of the table for the sets that ran.

    Args:
        lines: Statistics of the sets.
        rows: Rows of the run.
        audit: Result of the audit.
    """
    auto = {s.group: s for s in lines if s.backend == "auto"}
    found: list[FloorRow] = []
    for where in ("", ANYWHERE):
        found += [*_shares(auto, where), *_times(auto, where), *_release_times(auto, rows, where)]
        found += [*_bounds(auto, where), *_robust(auto, rows, where)]
    found += [*_sdu(auto), *_refusals(rows), *_certificate(auto)]
    if audit.audited:
        faulty = len(audit.faulty)
        found.append(_row("wrong certificates", "0 in 10,000", f"{faulty} in {audit.audited:,}", faulty == 0))
    return found


def _row(what: str, floor: str, measured: str, met: bool) -> FloorRow:
    return what, floor, measured, "yes" if met else "**no**"


def _certificate(auto: dict[str, SetSummary]) -> Iterator[FloorRow]:
    if "target" in auto or "robust" in auto:
        samples, seconds = certificate_time()
        share = seconds * SAMPLES / samples
        measured = f"{1000 * seconds:.1f} ms of processor time for {samples} samples, {1000 * share:.1f} for {SAMPLES}"
        yield _row("certificate, 1.5 s at 500 Hz", "3 ms", measured, share <= CERTIFICATE_S)


def _shares(auto: dict[str, SetSummary], where: str) -> Iterator[FloorRow]:
    for group, floor in _of(SHARES, where):
        if group in auto:
            s = auto[group]
            measured = f"{100 * s.share:.1f} % ({s.certified} of {s.feasible})"
            yield _row(f"certified share, {group}", f"{100 * floor:g} %", measured, s.share >= floor)


def _of(floors: dict[str, T], where: str) -> Iterator[tuple[str, T]]:
    return ((family + where, floor) for family, floor in floors.items())


def _times(auto: dict[str, SetSummary], where: str) -> Iterator[FloorRow]:
    for group, (half, last) in _of(TIMES_S, where):
        if group in auto:
            p50, _, p99 = auto[group].solve_s
            measured = f"{1000 * p50:.0f} / {1000 * p99:.0f} ms"
            floor = f"{1000 * half:g} / {1000 * last:g} ms"
            yield _row(f"time to a plan p50 / p99, {group}", floor, measured, p50 <= half and p99 <= last)


def _release_times(auto: dict[str, SetSummary], rows: Sequence[ResultRow], where: str) -> Iterator[FloorRow]:
    for group, limit in _of(TO_RUCKIG, where):
        if group not in auto:
            continue
        ratios = [a / b for a, b in zip(*_both(rows, group), strict=True)]
        p50, p90, worst = quantiles(ratios, 50, 90, 100)
        met = p50 <= limit and worst <= 1.0 + 1e-9
        measured = f"{p50:.3f} (p90 {p90:.3f}, worst {worst:.3f})"
        yield _row(f"release time over Ruckig's, {group}", f"{limit:g}, never over 1", measured, met)


def _both(rows: Sequence[ResultRow], group: str) -> tuple[list[float], list[float]]:
    ruckig = {r.task: r.release_time_s for r in rows if r.group == group and r.backend == "ruckig" and r.certified}
    ours = [r for r in rows if r.group == group and r.backend == "auto" and r.certified and r.task in ruckig]
    return [r.release_time_s for r in ours], [ruckig[r.task] for r in ours]


def _bounds(auto: dict[str, SetSummary], where: str) -> Iterator[FloorRow]:
    if group := auto.get("pose" + where):
        p50, p90 = group.to_bound
        t50, t90 = group.to_bound_tick
        measured = f"{p50:.4f} / {p90:.4f} (bound on ticks: {t50:.4f} / {t90:.4f})"
        met = p50 <= TO_BOUND[0] and p90 <= TO_BOUND[1]
        what = f"release time over the bound p50 / p90, {group.group}"
        yield _row(what, "1.01 / 1.05", measured, met)


def _sdu(auto: dict[str, SetSummary]) -> Iterator[FloorRow]:
    for group, count in (("sdu-near", 28), ("sdu-far", 35)):
        if group in auto:
            s = auto[group]
            yield _row(
                f"SDU table, {group[4:]}", f"{count} / {count}", f"{s.certified} / {s.drawn}", s.certified == count
            )
    for group in ("sdu-near-pairs", "sdu-far-pairs"):
        if group in auto:
            s = auto[group]
            yield _row(f"SDU table, {group[4:]}", "", f"{s.certified} / {s.drawn}", True)


def _robust(auto: dict[str, SetSummary], rows: Sequence[ResultRow], where: str) -> Iterator[FloorRow]:
    for group, width in (("robust" + where, "20"), ("robust-30" + where, "30")):
        if group not in auto:
            continue
        own = [r for r in rows if r.group == group and r.backend == "auto"]
        good = sum(r.certified and r.window_m[width] <= ROBUST_ERROR_M for r in own)
        share = good / max(auto[group].feasible, 1)
        (longer,) = quantiles(paired_ratios(rows, (group, "auto"), ("target" + where, "auto")), 50)
        (of_ruckig,) = quantiles(paired_ratios(rows, (group, "auto"), ("target" + where, "ruckig")), 50)
        measured = f"{100 * share:.0f} % within 10 mm; {longer:.2f} × nominal, {of_ruckig:.2f} × Ruckig's nominal"
        floor = "90 %; 1.2 ×" if width == "20" else ""
        met = share >= ROBUST_SHARE and longer <= ROBUST_TIME
        yield _row(f"{group}: window ±{width} ms, 5 mm", floor, measured, met or width == "30")


def _refusals(rows: Sequence[ResultRow]) -> Iterator[FloorRow]:
    for group, limit in (("unreachable", REACH_S), ("too-fast", OTHER_S)):
        own = [r for r in rows if r.group == group and r.backend == "auto"]
        if own:
            slowest = max(r.solve_s for r in own)
            offered = sum(r.nearest == "certified" for r in own)
            measured = f"{slowest:.2f} s at most; {offered} of {len(own)} with a certified nearest"
            met = slowest < limit and offered == len(own)
            yield _row(f"infeasible answered, {group}", f"< {limit:g} s, with a nearest", measured, met)
