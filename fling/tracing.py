"""Traces by OpenTelemetry, from a request through its plan to its execution: `pip install 'fling-robotics[otel]'`.

Off unless the standard variables ask for it: OTEL_TRACES_EXPORTER (`otlp`, `console`) or OTEL_EXPORTER_OTLP_ENDPOINT.
Sampler, resource, headers and the rest are OpenTelemetry's own variables. Where it is off, or not installed,
every function here does nothing. The context travels in W3C's `traceparent` (https://www.w3.org/TR/trace-context).
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any

ENDPOINTS = ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")
NOT_INSTALLED = "traces are asked for by OTEL_ variables, and need: pip install 'fling-robotics[otel]'"
UNKNOWN = "OTEL_TRACES_EXPORTER = {name!r} is none of otlp, console, none: there are no traces"

Value = str | int | float | bool


class TracedSpan:
    """One span, or nothing where there are no traces."""

    def __init__(self, span: Any = None) -> None:
        self._span = span

    def set(self, **attributes: Value | None) -> None:
        """Adds attributes; `__` in a name is a dot, None is left out."""
        if self._span is not None:
            self._span.set_attributes(_attributes(attributes))

    def rename(self, name: str) -> None:
        """Gives it a name that is known only now."""
        if self._span is not None:
            self._span.update_name(name)

    def event(self, name: str, **attributes: Value | None) -> None:
        """Notes that something happened now."""
        if self._span is not None:
            self._span.add_event(name, _attributes(attributes))

    def fail(self, why: str) -> None:
        """Marks it as failed."""
        if self._span is not None:
            from opentelemetry.trace import Status, StatusCode

            self._span.set_status(Status(StatusCode.ERROR, why))


def configure_tracing(service_name: str) -> str | None:
    """Sets up the traces of this process if they are asked for. Returns why there are none although they are.

    Args:
        service_name: name of this process in traces; OTEL_SERVICE_NAME has precedence.
    """
    name = _exporter_name()
    if name == "none":
        return None
    try:
        from opentelemetry import trace
        from opentelemetry.sdk.resources import Resource  # pyright: ignore[reportMissingImports]
        from opentelemetry.sdk.trace import TracerProvider  # pyright: ignore[reportMissingImports]
        from opentelemetry.sdk.trace.export import BatchSpanProcessor, ConsoleSpanExporter  # pyright: ignore[reportMissingImports]
    except ImportError:
        return NOT_INSTALLED
    if name == "otlp":
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter as Exporter  # pyright: ignore[reportMissingImports]
    elif name == "console":
        Exporter = ConsoleSpanExporter
    else:
        return UNKNOWN.format(name=name)
    named = {} if os.environ.get("OTEL_SERVICE_NAME") else {"service.name": service_name}
    provider = TracerProvider(resource=Resource.create(named))
    provider.add_span_processor(BatchSpanProcessor(Exporter()))
    trace.set_tracer_provider(provider)
    return None


@contextmanager
def traced(
    name: str, kind: str = "internal", parent: Mapping[str, str] | None = None, **attributes: Value | None
) -> Iterator[TracedSpan]:
    """Runs a block as a span.

    Args:
        name: of the span.
        kind: internal, server, client, producer or consumer.
        parent: headers or the like with the context that it belongs to; None: the block around it.
        attributes: as `TracedSpan.set` takes them.
    """
    found = _api()
    if found is None:
        yield TracedSpan()
        return
    propagate, trace = found
    context = None if parent is None else propagate.extract(parent)
    options: dict[str, Any] = {"kind": trace.SpanKind[kind.upper()], "attributes": _attributes(attributes)}
    with trace.get_tracer("fling").start_as_current_span(name, context, record_exception=False, **options) as span:
        yield TracedSpan(span)


def trace_context() -> dict[str, str]:
    """Returns the context of the current span as headers; empty without traces."""
    carrier: dict[str, str] = {}
    found = _api()
    if found is not None:
        found[0].inject(carrier)
    return carrier


@cache
def _api() -> tuple[Any, Any] | None:
    """Returns OpenTelemetry's `propagate` and `trace`; looked for once: an import that fails reads every folder."""
    try:
        from opentelemetry import propagate, trace
    except ImportError:
        return None
    return propagate, trace


def _exporter_name() -> str:
    """Returns what OTEL_TRACES_EXPORTER asks for; without it `otlp` if there is an endpoint, else `none`."""
    if os.environ.get("OTEL_SDK_DISABLED", "").lower() == "true":
        return "none"
    asked = os.environ.get("OTEL_TRACES_EXPORTER", "")
    return asked or ("otlp" if any(os.environ.get(name) for name in ENDPOINTS) else "none")


def _attributes(given: Mapping[str, Value | None]) -> dict[str, Value]:
    return {name.replace("__", "."): value for name, value in given.items() if value is not None}
