"""Statistics of the result rows: shares, ratios, percentiles."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.results import ResultRow


@dataclass(frozen=True)
class SetSummary:
    """Statistics of one back end on one set.

    Attributes:
        group: Name of the set.
        backend: Name of the back end.
        drawn: Number of problems.
        feasible: Number of problems known to be feasible.
        certified: Number of certified plans.
        to_ruckig: Release times over Ruckig's for the same task, both certified; percentiles 10, 50, 90.
        to_bound: Release times over the joint-wise bound; percentiles 50, 90.
        to_bound_tick: Release times over the bound rounded up to the tick; percentiles 50, 90.
        solve_s: Wall time of `plan()`; percentiles 50, 90, 99.
        cpu_s: Processor time of `plan()`; percentiles 50, 90, 99.
        certificate_s: Wall time of the certificate; percentiles 50, 90.
        window_m: Largest landing error within ±10, ±20, ±30 ms; percentiles 50, 90.
    """

    group: str
    backend: str
    drawn: int
    feasible: int
    certified: int
    to_ruckig: tuple[float, ...]
    to_bound: tuple[float, ...]
    to_bound_tick: tuple[float, ...]
    solve_s: tuple[float, ...]
    cpu_s: tuple[float, ...]
    certificate_s: tuple[float, ...]
    window_m: dict[str, tuple[float, ...]]

    @property
    def share(self) -> float:
        """Certified share of the feasible problems."""
        return self.certified / self.feasible if self.feasible else math.nan


def summarise(group: str, backend: str, rows: Sequence[ResultRow], feasible: set[str]) -> SetSummary:
    """Returns the statistics of one back end on one set.

    Args:
        group: Name of the set.
        backend: Name of the back end.
        rows: Rows of the set, of every back end.
        feasible: Names of the tasks known to be feasible.
    """
    own = [row for row in rows if row.backend == backend]
    good = [row for row in own if row.certified]
    ruckig = {row.task: row.release_time_s for row in rows if row.backend == "ruckig" and row.certified}
    bounds = [(row, row.bound_s) for row in good if row.bound_s]
    return SetSummary(
        group,
        backend,
        drawn=len(own),
        feasible=sum(row.task in feasible for row in own),
        certified=len(good),
        to_ruckig=quantiles([row.release_time_s / ruckig[row.task] for row in good if row.task in ruckig], 10, 50, 90),
        to_bound=quantiles([row.release_time_s / bound_s for row, bound_s in bounds], 50, 90),
        to_bound_tick=quantiles([row.release_time_s / on_tick(bound_s, row.tick_s) for row, bound_s in bounds], 50, 90),
        solve_s=quantiles([row.solve_s for row in own if row.task in feasible], 50, 90, 99),
        cpu_s=quantiles([row.cpu_s for row in own if row.task in feasible], 50, 90, 99),
        certificate_s=quantiles([row.certificate_s for row in good], 50, 90),
        window_m={w: quantiles([row.window_m[w] for row in good if row.window_m], 50, 90) for w in ("10", "20", "30")},
    )


def on_tick(bound_s: float, tick_s: float) -> float:
    """Returns the bound rounded up to the tick [s]: no release on a tick is earlier."""
    return math.ceil(bound_s / tick_s - 1e-6) * tick_s


def quantiles(values: Iterable[float | None], *percent: float) -> tuple[float, ...]:
    """Returns percentiles of the values; NaN without values."""
    given = np.array([v for v in values if v is not None], dtype=float)
    if len(given) == 0:
        return tuple(math.nan for _ in percent)
    return tuple(float(x) for x in np.percentile(given, percent, method="inverted_cdf"))


def paired_ratios(rows: Sequence[ResultRow], first: tuple[str, str], second: tuple[str, str]) -> list[float]:
    """Returns release times of (set, back end) `first` over those of `second`, for each task that both certify."""
    times = {(row.group, row.backend, row.task.split("/", 1)[1]): row.release_time_s for row in rows if row.certified}
    numbers = {key[2] for key in times if key[:2] == first} & {key[2] for key in times if key[:2] == second}
    return [times[(*first, n)] / times[(*second, n)] for n in sorted(numbers)]
