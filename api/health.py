"""Alive, ready, and figures."""

from __future__ import annotations

from fastapi import APIRouter, Response
from fastapi.responses import JSONResponse
from prometheus_client import CONTENT_TYPE_LATEST
from starlette.concurrency import run_in_threadpool

from api.deps import ClientDep, Service, ServiceDep
from api.documented import json_answer, problems_of
from api.errors import Problem
from api.presence import is_alive
from api.schemas.executions import Readiness
from api.version import fling_version

router = APIRouter(tags=["service"])


@router.get("/healthz", summary="Alive?")
async def healthz() -> dict[str, str]:
    """Answers as long as the process lives, also while it plans. Needs no token."""
    return {"status": "ok", "version": fling_version()}


@router.get("/readyz", summary="Ready?", responses={
    **json_answer(200, Readiness, "Able to plan and to reach the store."), **problems_of("not-ready")})  # fmt: skip
async def readyz(service: ServiceDep) -> JSONResponse:
    """Whether it can plan and reach the store, and which cells have an executor. Needs no token."""
    store = await run_in_threadpool(service.store.is_reachable)
    cells = await run_in_threadpool(_executors, service) if store else {}
    parts = {"store": store, "planner": service.workers.is_warm, "cells": cells}
    if not (store and service.workers.is_warm):
        what = "the store cannot be reached" if not store else "the planner processes are starting"
        raise Problem("not-ready", what, headers={"Retry-After": "1"}, ready=False, **parts)
    return JSONResponse({"ready": True, **parts})


@router.get(
    "/metrics", summary="Figures for Prometheus",
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}, "description": "Prometheus' format."}},
)  # fmt: skip
def metrics(service: ServiceDep, client: ClientDep) -> Response:
    """Planning requests and their time, executions by outcome, executors alive."""
    service.metrics.waiting.set(service.workers.waiting)
    for cell, alive in _executors(service).items():
        service.metrics.executors.labels(cell).set(alive)
    return Response(service.metrics.text(), headers={"Content-Type": CONTENT_TYPE_LATEST})


def _executors(service: Service) -> dict[str, bool]:
    rows = {row.cell: row for row in service.store.cell_statuses()}
    return {name: is_alive(rows.get(name)) for name in service.shelf.names()}
