"""Health, readiness and metrics of the service."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse
from prometheus_client import CONTENT_TYPE_LATEST
from starlette.concurrency import run_in_threadpool

from api import fling_version
from api.dependencies import AnyCaller, Service, ServiceDep
from api.http import RESTART_S, SOON_S, ProblemDetails, json_answer, retry_after
from api.schemas import Health, Readiness

router = APIRouter(tags=["service"])


@router.get("/healthz", summary="Health")
async def read_health() -> Health:
    """Answers as long as the process lives, also while it plans. Needs no token."""
    return Health(status="ok", version=fling_version())


@router.get(
    "/readyz",
    summary="Readiness",
    responses=json_answer(200, Readiness, "Able to plan and to reach the store.", "not-ready"),
)
async def read_readiness(request: Request, service: ServiceDep) -> JSONResponse:
    """Returns whether the service can plan and reach its store, and which cells have an executor. Needs no token."""
    outage = await run_in_threadpool(service.probe.outage)
    cells = {} if outage else await run_in_threadpool(_executors, service)
    store = outage is None
    parts = {"store": store, "planner": service.pool.is_warm, "cells": cells}
    if request.app.state.is_draining:
        reason = "the service is shutting down"
        raise ProblemDetails("not-ready", reason, headers=retry_after(RESTART_S), ready=False, **parts)
    if not (store and service.pool.is_warm):
        reason = outage.advice if outage else "the planner processes are starting"
        parts["outage"] = outage and outage.kind
        raise ProblemDetails("not-ready", reason, headers=retry_after(SOON_S), ready=False, **parts)
    return JSONResponse({"ready": True, **parts})


@router.get(
    "/metrics",
    summary="Prometheus metrics",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}, "description": "Prometheus' format."}},
)
def read_metrics(service: ServiceDep, caller: AnyCaller) -> Response:
    """Returns planning requests and their durations, executions by outcome, executors alive."""
    service.metrics.waiting.set(service.pool.waiting)
    for cell, alive in _executors(service).items():
        service.metrics.executors.labels(cell).set(alive)
    return Response(service.metrics.text(), headers={"Content-Type": CONTENT_TYPE_LATEST})


def _executors(service: Service) -> dict[str, bool]:
    alive = {row.cell for row in service.store.cell_statuses() if row.is_alive}
    return {name: name in alive for name in service.cells.names()}
