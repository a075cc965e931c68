"""The table of what the planner must show: floor, goal, and what this run measured."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TypeVar

from tests.benchmarks.audit import Audit
from tests.benchmarks.sets import ANYWHERE
from tests.benchmarks.speed import certificate_time
from tests.benchmarks.statistics import Summary, paired, quantiles
from tests.benchmarks.task import Row

HEAD = ("what", "floor", "goal", "measured", "floor met")
SHARES = {"pose": 0.995, "point": 0.99, "target": 0.995}
TIMES_S = {"pose": (0.025, 0.250), "point": (0.030, 0.450), "target": (0.055, 0.300)}
TO_RUCKIG = {"pose": 1.0, "point": 0.88, "target": 0.58}
BOUND = (1.01, 1.05)
ROBUST_ERROR_M, ROBUST_SHARE, ROBUST_TIME = 0.010, 0.90, 1.2
REACH_S, OTHER_S = 0.3, 1.5
SAMPLES, CERTIFICATE_S = 750, 0.003

T = TypeVar("T")
Verdict = tuple[str, str, str, str, str]


def verdicts(lines: Sequence[Summary], rows: Sequence[Row], judged: Audit) -> list[Verdict]:
    """Returns the rows of the table for the sets that ran."""
    auto = {s.group: s for s in lines if s.backend == "auto"}
    found: list[Verdict] = []
    for where in ("", ANYWHERE):
        found += [*_shares(auto, where), *_times(auto, where), *_release_times(auto, rows, where)]
        found += [*_bounds(auto, where), *_robust(auto, rows, where)]
    found += [*_sdu(auto), *_refusals(rows), *_certificate(auto)]
    if judged.judged:
        wrong = len(judged.wrong)
        found.append(_verdict("wrong certificates", "0 in 10,000", "0", f"{wrong} in {judged.judged:,}", wrong == 0))
    return found


def _verdict(what: str, floor: str, goal: str, measured: str, met: bool) -> Verdict:
    return what, floor, goal, measured, "yes" if met else "**no**"


def _certificate(auto: dict[str, Summary]) -> Iterator[Verdict]:
    if "target" in auto or "robust" in auto:
        samples, seconds = certificate_time()
        share = seconds * SAMPLES / samples
        measured = f"{1000 * seconds:.1f} ms of processor time for {samples} samples, {1000 * share:.1f} for {SAMPLES}"
        yield _verdict("certificate, 1.5 s at 500 Hz", "3 ms", "", measured, share <= CERTIFICATE_S)


def _shares(auto: dict[str, Summary], where: str) -> Iterator[Verdict]:
    for group, floor in _of(SHARES, where):
        if group in auto:
            s = auto[group]
            measured = f"{100 * s.share:.1f} % ({s.certified} of {s.feasible})"
            yield _verdict(f"certified share, {group}", f"{100 * floor:g} %", "99.9 %", measured, s.share >= floor)


def _of(floors: dict[str, T], where: str) -> Iterator[tuple[str, T]]:
    return ((family + where, floor) for family, floor in floors.items())


def _times(auto: dict[str, Summary], where: str) -> Iterator[Verdict]:
    for group, (half, last) in _of(TIMES_S, where):
        if group in auto:
            p50, _, p99 = auto[group].solve_s
            measured = f"{1000 * p50:.0f} / {1000 * p99:.0f} ms"
            floor = f"{1000 * half:g} / {1000 * last:g} ms"
            yield _verdict(
                f"time to a plan p50 / p99, {group}", floor, "15 / 100 ms", measured, p50 <= half and p99 <= last
            )


def _release_times(auto: dict[str, Summary], rows: Sequence[Row], where: str) -> Iterator[Verdict]:
    for group, limit in _of(TO_RUCKIG, where):
        if group not in auto:
            continue
        ratios = [a / b for a, b in zip(*_both(rows, group), strict=True)]
        p50, p90, worst = quantiles(ratios, 50, 90, 100)
        met = p50 <= limit and worst <= 1.0 + 1e-9
        measured = f"{p50:.3f} (p90 {p90:.3f}, worst {worst:.3f})"
        yield _verdict(f"release time over Ruckig's, {group}", f"{limit:g}, never over 1", "at or under", measured, met)


def _both(rows: Sequence[Row], group: str) -> tuple[list[float], list[float]]:
    ruckig = {r.task: r.release_time_s for r in rows if r.group == group and r.backend == "ruckig" and r.certified}
    ours = [r for r in rows if r.group == group and r.backend == "auto" and r.certified and r.task in ruckig]
    return [r.release_time_s or math.nan for r in ours], [ruckig[r.task] or math.nan for r in ours]


def _bounds(auto: dict[str, Summary], where: str) -> Iterator[Verdict]:
    if group := auto.get("pose" + where):
        p50, p90 = group.to_bound
        t50, t90 = group.to_bound_tick
        measured = f"{p50:.4f} / {p90:.4f} (bound on ticks: {t50:.4f} / {t90:.4f})"
        met = p50 <= BOUND[0] and p90 <= BOUND[1]
        what = f"release time over the bound p50 / p90, {group.group}"
        yield _verdict(what, "1.01 / 1.05", "1.001 / 1.01", measured, met)


def _sdu(auto: dict[str, Summary]) -> Iterator[Verdict]:
    for group, count in (("sdu-near", 28), ("sdu-far", 35)):
        if group in auto:
            s = auto[group]
            yield _verdict(
                f"SDU table, {group[4:]}", f"{count} / {count}", "", f"{s.certified} / {s.drawn}", s.certified == count
            )
    for group in ("sdu-near-pairs", "sdu-far-pairs"):
        if group in auto:
            s = auto[group]
            goal = "over half" if "far" in group else ""
            yield _verdict(f"SDU table, {group[4:]}", "", goal, f"{s.certified} / {s.drawn}", True)


def _robust(auto: dict[str, Summary], rows: Sequence[Row], where: str) -> Iterator[Verdict]:
    for group, width in (("robust" + where, "20"), ("robust-30" + where, "30")):
        if group not in auto:
            continue
        own = [r for r in rows if r.group == group and r.backend == "auto"]
        good = sum(r.certified and r.window_m[width] <= ROBUST_ERROR_M for r in own)
        share = good / max(auto[group].feasible, 1)
        (longer,) = quantiles(paired(rows, (group, "auto"), ("target" + where, "auto")), 50)
        (of_ruckig,) = quantiles(paired(rows, (group, "auto"), ("target" + where, "ruckig")), 50)
        measured = f"{100 * share:.0f} % within 10 mm; {longer:.2f} × nominal, {of_ruckig:.2f} × Ruckig's nominal"
        floor = "90 %; 1.2 ×" if width == "20" else ""
        goal = "±30 ms, 95 %" if width == "20" else "95 %"
        met = share >= ROBUST_SHARE and longer <= ROBUST_TIME
        yield _verdict(f"{group}: window ±{width} ms, 5 mm", floor, goal, measured, met or width == "30")


def _refusals(rows: Sequence[Row]) -> Iterator[Verdict]:
    for group, limit in (("unreachable", REACH_S), ("too-fast", OTHER_S)):
        own = [r for r in rows if r.group == group and r.backend == "auto"]
        if own:
            slowest = max(r.solve_s for r in own)
            offered = sum(r.nearest == "certified" for r in own)
            measured = f"{slowest:.2f} s at most; {offered} of {len(own)} with a certified nearest"
            met = slowest < limit and offered == len(own)
            yield _verdict(f"infeasible answered, {group}", f"< {limit:g} s, with a nearest", "", measured, met)
