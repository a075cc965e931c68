"""Prometheus metrics. Every service has a registry of its own; nothing is global."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.core import CounterMetricFamily

PLAN_BUCKETS_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)


class Metrics:
    """Metrics of one service.

    Args:
        executions: Returns the number of executions by outcome.

    Attributes:
        plans: Planning requests by result.
        plan_seconds: Time to answer a planning request [s].
        waiting: Requests being planned or queued.
        executors: Whether the executor of each cell is alive.
    """

    def __init__(self, executions: Callable[[], dict[str, int]]) -> None:
        self._executions = executions
        self._registry = registry = CollectorRegistry()
        self.plans = Counter("fling_plans", "Planning requests by result.", ["result"], registry=registry)
        self.plan_seconds = Histogram(
            "fling_plan_seconds", "Time to answer a planning request [s].", buckets=PLAN_BUCKETS_S, registry=registry
        )
        self.waiting = Gauge("fling_plans_waiting", "Requests being planned or queued.", registry=registry)
        self.executors = Gauge(
            "fling_executor_alive", "Whether a cell's executor is alive.", ["cell"], registry=registry
        )
        registry.register(self)  # type: ignore[arg-type]  # structurally a collector

    def text(self) -> bytes:
        """Returns all metrics in Prometheus' text format."""
        return generate_latest(self._registry)

    def collect(self) -> Iterable[CounterMetricFamily]:
        """Counts the executions in the database; called at every scrape."""
        family = CounterMetricFamily("fling_executions", "By outcome; open ones by state.", labels=["outcome"])
        for outcome, number in self._executions().items():
            family.add_metric([outcome], number)
        yield family
