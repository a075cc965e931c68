"""One trace from a client's request through the plan to the executor, in the exporter that keeps spans in memory."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest
from opentelemetry import trace
from opentelemetry.sdk.trace import ReadableSpan, TracerProvider
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter

from api.settings import ServiceSettings
from executor.daemon import Daemon
from executor.records import ExecutionResult
from fling import tracing
from store import ExecutionRow
from tests.api.conftest import FakeExecutor, RunningService, running, wait_until_ready

PARENT = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"  # the example of W3C's recommendation
TRACE_ID = 0x0AF7651916CD43DD8448EB211C80319C


@pytest.fixture(scope="module")
def exporter() -> InMemorySpanExporter:
    """Keeps the spans of this process; a provider is set once in a process."""
    kept = InMemorySpanExporter()
    provider = TracerProvider()
    provider.add_span_processor(SimpleSpanProcessor(kept))
    trace.set_tracer_provider(provider)
    return kept


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, root: Path) -> Iterator[RunningService]:
    url = f"sqlite:///{tmp_path_factory.mktemp('data') / 'fling.db'}"
    with running(ServiceSettings(database_url=url, cells=root / "cells", planner_workers=1)) as found:
        wait_until_ready(found)
        yield found


class UnmovedDaemon(Daemon):
    """A daemon whose executions end as soon as they begin: what matters here is the span around them."""

    def __init__(self, service: RunningService) -> None:
        self.store = service.store
        self.cell = "ur5e-sim"
        self._store_paused_until = 0.0

    def _run_execution(self, row: ExecutionRow, ended: object, span: tracing.TracedSpan) -> None:
        span.event("preparing")
        span.set(fling__outcome=ExecutionResult(row.id, "completed", "", None).outcome)


def ancestors(exporter: InMemorySpanExporter) -> Callable[[ReadableSpan], set[int]]:
    """Returns a function that returns the ids of the spans around one."""
    parents = {span.context.span_id: span.parent for span in exporter.get_finished_spans()}

    def around(span: ReadableSpan) -> set[int]:
        found = set()
        parent = span.parent
        while parent is not None:
            found.add(parent.span_id)
            parent = parents.get(parent.span_id)
        return found

    return around


def test_a_trace_goes_from_the_client_to_the_executor(service: RunningService, exporter: InMemorySpanExporter):
    exporter.clear()
    sent = {"traceparent": PARENT, "X-Request-ID": "mine-7"}
    request = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}, "backend": "ruckig"}
    plan = service.client.post("/plan", json=request, headers=sent).json()
    fake = FakeExecutor(service.store).start()
    try:
        service.client.post("/execute", json={"plan_id": plan["id"]}, headers=sent).raise_for_status()
    finally:
        fake.stop()
    row = service.store.claim_execution("ur5e-sim", "fake")
    UnmovedDaemon(service)._execute(row, None)

    spans = {span.name: span for span in exporter.get_finished_spans() if span.context.trace_id == TRACE_ID}
    assert spans.keys() >= {"POST /plan", "plan", "POST /execute", "execution"}  # and the framework's own
    within = ancestors(exporter)
    assert spans["POST /plan"].context.span_id in within(spans["plan"])
    assert spans["POST /execute"].context.span_id in within(spans["execution"])
    assert spans["POST /plan"].attributes["http.response.status_code"] == 201
    assert spans["POST /plan"].attributes["fling.request_id"] == "mine-7"
    assert spans["plan"].attributes["fling.plan_id"] == plan["id"]
    assert [event.name for event in spans["plan"].events] == ["ruckig"] * len(spans["plan"].events)
    assert spans["execution"].attributes["fling.plan"] == plan["id"]
    assert spans["execution"].attributes["fling.outcome"] == "completed"


def test_a_refused_plan_is_told_in_its_span(service: RunningService, exporter: InMemorySpanExporter):
    exporter.clear()
    far = {"release": {"kind": "target", "position": [90.0, 0.0, 0.0]}, "backend": "ruckig"}
    assert service.client.post("/plan", json=far).status_code == 422
    spans = {span.name: span for span in exporter.get_finished_spans()}
    assert spans["plan"].attributes["fling.problem"] == "infeasible"
    assert spans["POST /plan"].status.is_unset  # a refusal is no error of the server


def test_it_is_off_by_default_and_follows_the_standard_variables(monkeypatch: pytest.MonkeyPatch):
    for name in ("OTEL_TRACES_EXPORTER", "OTEL_SDK_DISABLED", *tracing.ENDPOINTS):
        monkeypatch.delenv(name, raising=False)
    assert tracing._exporter_name() == "none"
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", "http://collector:4318")
    assert tracing._exporter_name() == "otlp"
    monkeypatch.setenv("OTEL_TRACES_EXPORTER", "paper")
    assert "'paper' is none of otlp, console, none" in str(tracing.configure_tracing("x"))
    monkeypatch.setenv("OTEL_SDK_DISABLED", "true")
    assert tracing.configure_tracing("x") is None


def test_without_the_extra_nothing_happens(monkeypatch: pytest.MonkeyPatch):
    for name in [name for name in sys.modules if name.startswith("opentelemetry")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "opentelemetry", None)  # an import of it fails
    monkeypatch.setattr(tracing, "_api", cache(tracing._api.__wrapped__))  # which knows nothing yet
    with tracing.traced("x", parent={"traceparent": PARENT}) as span:
        span.set(a=1)
        span.event("b")
        span.fail("c")
        assert tracing.trace_context() == {}
    monkeypatch.setenv("OTEL_TRACES_EXPORTER", "otlp")
    assert tracing.configure_tracing("x") == tracing.NOT_INSTALLED
