"""What the tables show, from rows: shares, ratios, percentiles."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from tests.benchmarks.task import Row


@dataclass(frozen=True)
class Summary:
    """One line of the table: a back end on a set. Ratios are to the same task's other answer.

    Attributes:
        drawn, feasible, certified: how many problems; of the last two, those known to be feasible.
        to_ruckig: release times over Ruckig's where both certify, quantiles 10, 50, 90.
        to_bound: over the joint-wise bound, quantiles 50, 90.
        to_bound_tick: over the bound rounded up to the tick, likewise.
        solve_s: quantiles 50, 90, 99 of the wall time; `cpu_s` of the processor time.
        certificate_s: quantiles 50, 90.
        window_m: median and quantile 90 of the worst landing error within ±10, ±20, ±30 ms.
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
        return self.certified / self.feasible if self.feasible else math.nan


def summarise(group: str, backend: str, rows: Sequence[Row], feasible: set[str]) -> Summary:
    """Returns the line of one back end on one set; `rows` are those of the set by every back end."""
    own = [row for row in rows if row.backend == backend]
    good = [row for row in own if row.certified]
    ruckig = {row.task: row.release_time_s for row in rows if row.backend == "ruckig" and row.certified}
    bounded = [row for row in good if row.bound_s]
    return Summary(
        group,
        backend,
        drawn=len(own),
        feasible=sum(row.task in feasible for row in own),
        certified=len(good),
        to_ruckig=quantiles([row.release_time_s / ruckig[row.task] for row in good if row.task in ruckig], 10, 50, 90),
        to_bound=quantiles([row.release_time_s / row.bound_s for row in bounded], 50, 90),
        to_bound_tick=quantiles([row.release_time_s / on_tick(row) for row in bounded], 50, 90),
        solve_s=quantiles([row.solve_s for row in own if row.task in feasible], 50, 90, 99),
        cpu_s=quantiles([row.cpu_s for row in own if row.task in feasible], 50, 90, 99),
        certificate_s=quantiles([row.certificate_s for row in good], 50, 90),
        window_m={w: quantiles([row.window_m[w] for row in good if row.window_m], 50, 90) for w in ("10", "20", "30")},
    )


def on_tick(row: Row) -> float:
    """Returns the bound rounded up to the tick [s]: no release on a tick is sooner."""
    assert row.bound_s is not None
    return math.ceil(row.bound_s / row.tick_s - 1e-6) * row.tick_s


def quantiles(values: Iterable[float | None], *percent: float) -> tuple[float, ...]:
    """Returns the percentiles, NaN where there are no values."""
    given = np.array([v for v in values if v is not None], dtype=float)
    if len(given) == 0:
        return tuple(math.nan for _ in percent)
    return tuple(float(x) for x in np.percentile(given, percent, method="inverted_cdf"))


def paired(rows: Sequence[Row], first: tuple[str, str], second: tuple[str, str]) -> list[float]:
    """Returns release times of (set, back end) `first` over those of `second`, task by task, where both certify."""
    times = {(row.group, row.backend, row.task.split("/", 1)[1]): row.release_time_s for row in rows if row.certified}
    numbers = {key[2] for key in times if key[:2] == first} & {key[2] for key in times if key[:2] == second}
    return [times[(*first, n)] / times[(*second, n)] for n in sorted(numbers)]
