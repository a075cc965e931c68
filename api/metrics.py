"""Figures for Prometheus. Each service has its own registry: nothing is global."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.core import CounterMetricFamily

PLAN_BUCKETS_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)


class _Executions:
    """Executions by outcome, counted by the database at the moment of asking."""

    def __init__(self, count: Callable[[], dict[str, int]]) -> None:
        self._count = count

    def collect(self) -> Iterable[CounterMetricFamily]:
        family = CounterMetricFamily("fling_executions", "By outcome, open ones by state.", labels=["outcome"])
        for outcome, number in self._count().items():
            family.add_metric([outcome], number)
        yield family


class Metrics:
    """What `/metrics` shows."""

    def __init__(self, executions: Callable[[], dict[str, int]]) -> None:
        self._registry = CollectorRegistry()
        self.plans = Counter("fling_plans", "Planning requests by result.", ["result"], registry=self._registry)
        self.plan_seconds = Histogram(
            "fling_plan_seconds", "Time to answer a planning request [s].",
            buckets=PLAN_BUCKETS_S, registry=self._registry,
        )  # fmt: skip
        self.waiting = Gauge("fling_plans_waiting", "Requests being planned or in line.", registry=self._registry)
        self.executors = Gauge(
            "fling_executor_alive", "Whether a cell's executor was heard of.", ["cell"], registry=self._registry
        )
        self._registry.register(_Executions(executions))  # type: ignore[arg-type]  # a collector by shape

    def text(self) -> bytes:
        """Returns everything in Prometheus' text format."""
        return generate_latest(self._registry)
