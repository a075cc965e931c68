"""Prometheus metrics. Every service has a registry of its own; nothing is global.

Names follow Prometheus' conventions: base units, `_total` for counters. Counters start at 0 with the process and never
fall, whatever retention deletes from the store.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import orjson
from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.metrics_core import GaugeMetricFamily, Metric

from store import ExecutionRow, Store, StoreUnavailable

DURATION_BUCKETS_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)
MARGIN_BUCKETS = (0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
TRACKING_BUCKETS_RAD = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05)  # a run ends at 0.05
LANDING_BUCKETS_M = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)


class Metrics:
    """Metrics of one service.

    Args:
        store: Its executions are followed from now on.

    Attributes:
        plans: Planning requests by result.
        plan_seconds: Time to answer a planning request [s].
        waiting: Requests being planned or queued.
        executors: Whether the executor of each cell is alive.
    """

    def __init__(self, store: Store) -> None:
        self._registry = CollectorRegistry()
        self._runs = ExecutionFollower(store)
        self.plans = self._new(Counter, "fling_plans", "Planning requests by result.", ["result"])
        self.plan_seconds = self._histogram("fling_plan_seconds", "Time to answer a planning request [s].")
        self.waiting = self._new(Gauge, "fling_plans_waiting", "Requests being planned or queued.")
        self.executors = self._new(Gauge, "fling_executor_alive", "Whether a cell's executor is alive.", ["cell"])
        self._solve = self._histogram("fling_solve_seconds", "Time of the planner for one plan [s].", ["backend"])
        self._margins = self._histogram(
            "fling_certificate_margin_ratio", "Margin of a check, as a share of its limit.", ["check"], MARGIN_BUCKETS
        )
        self._requests = self._new(
            Counter, "fling_http_requests", "HTTP requests by route and status.", ["method", "route", "status"]
        )
        self._request_seconds = self._histogram(
            "fling_http_request_seconds", "Time to answer an HTTP request [s].", ["method", "route"]
        )
        self._executions = self._new(Counter, "fling_executions", "Finished executions.", ["cell", "outcome"])
        self._ticks = self._new(Counter, "fling_execution_ticks", "Streamed controller ticks.", ["cell"])
        self._missed = self._new(Counter, "fling_execution_missed_ticks", "Lost controller ticks.", ["cell"])
        self._tracking = self._histogram(
            "fling_tracking_error_radians", "Largest tracking error of a run [rad].", ["cell"], TRACKING_BUCKETS_RAD
        )
        self._landing = self._histogram(
            "fling_landing_error_meters", "Landing less planned landing [m].", ["cell"], LANDING_BUCKETS_M
        )
        self._registry.register(OpenExecutions(self._runs.open_executions))

    def text(self) -> bytes:
        """Returns all metrics in Prometheus' text format."""
        for row in self._runs.finished():
            self._record_execution(row)
        return generate_latest(self._registry)

    def record_plan(self, summary: bytes) -> None:
        """Counts a plan, its solve time and the margins of its certificate."""
        document = orjson.loads(summary)
        self.plans.labels("planned").inc()
        self._solve.labels(document["backend"]).observe(document["solver"]["solve_time_s"])
        for check in document["certificate"]["checks"]:
            if check["margin"] is not None and check["limit"]:
                self._margins.labels(check["name"]).observe(check["margin"] / abs(check["limit"]))

    def record_request(self, method: str, route: str | None, status: int, duration_s: float) -> None:
        """Counts an answered HTTP request. Streams of events count when they end."""
        place = route or "none"  # never the path: anybody could make up new ones
        self._requests.labels(method if route else "any", place, str(status)).inc()
        self._request_seconds.labels(method if route else "any", place).observe(duration_s)

    def _record_execution(self, row: ExecutionRow) -> None:
        self._executions.labels(row.cell, row.outcome).inc()
        measured: Mapping[str, Any] = row.metrics or {}
        self._ticks.labels(row.cell).inc(measured.get("ticks") or 0)
        self._missed.labels(row.cell).inc(measured.get("missed_ticks") or 0)
        if (error := measured.get("tracking_error_max_rad")) is not None:
            self._tracking.labels(row.cell).observe(error)
        if (error := measured.get("landing_error_m")) is not None:
            self._landing.labels(row.cell).observe(error)

    def _new(self, kind: Callable[..., Any], name: str, text: str, labels: Iterable[str] = (), **options: Any) -> Any:
        return kind(name, text, list(labels), registry=self._registry, **options)

    def _histogram(
        self, name: str, text: str, labels: Iterable[str] = (), buckets: Iterable[float] = DURATION_BUCKETS_S
    ) -> Any:
        return self._new(Histogram, name, text, labels, buckets=tuple(buckets))


class ExecutionFollower:
    """Follows the executions of the store from those that are open now; each is reported once, when it has finished."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._last_id = store.latest_execution_id()
        self._open = {row.id: row for row in store.open_executions()}

    def finished(self) -> list[ExecutionRow]:
        """Returns the executions that have finished since the last call; none while the store does not answer."""
        with self._lock:
            try:
                self._open |= {row.id: row for row in self._store.executions_after(self._last_id)}
                rows = [self._store.execution(id) for id in self._open]
            except StoreUnavailable:
                return []
            self._last_id = max([self._last_id, *self._open])
            self._open = {row.id: row for row in rows if row is not None and row.state != "finished"}
            return [row for row in rows if row is not None and row.state == "finished"]

    def open_executions(self) -> dict[tuple[str, str], int]:
        """Returns the number of unfinished executions by cell and state."""
        counts: dict[tuple[str, str], int] = {}
        for row in list(self._open.values()):
            counts[row.cell, row.state] = counts.get((row.cell, row.state), 0) + 1
        return counts


class OpenExecutions:
    """Collector of the unfinished executions; their number falls again, so it is a gauge."""

    def __init__(self, counts: Callable[[], Mapping[tuple[str, str], int]]) -> None:
        self._counts = counts

    def collect(self) -> Iterable[Metric]:
        """Yields the gauge; called at every scrape."""
        family = GaugeMetricFamily("fling_executions_open", "Unfinished executions.", labels=["cell", "state"])
        for labels, number in self._counts().items():
            family.add_metric(list(labels), number)
        yield family
