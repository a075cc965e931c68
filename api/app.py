"""The service, put together. Nothing happens at import; `create_app` is called by `python -m api` and by tests."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from api import cells, executions, health, pages, plans, problems
from api.deps import Service
from api.gate import Gate
from api.metrics import Metrics
from api.schemas.executions import ProblemAnswer
from api.settings import Settings
from api.shelf import CellShelf
from api.solving import Job
from api.tokens import read_tokens
from api.version import fling_version
from api.workers import Workers
from store import Store

DESCRIPTION = (
    "Plan a throw (or any move that must pass a state at speed) for a Universal Robots arm, get it certified, stream "
    "it to the arm. SI units; world frame unless a request says `frame: base`. Every error is "
    "`application/problem+json`. **Software stop is not a safety function.**"
)
WARM_UP = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}}  # any throw: it loads and builds everything


class UnsafeSettings(ValueError):
    """The service refuses to start: it would be open to others."""


def create_app(settings: Settings) -> FastAPI:
    """Returns the service for these settings.

    Raises:
        UnsafeSettings: no tokens, and an address that others can reach.
        ValueError: the tokens file cannot be read.
    """
    tokens = read_tokens(settings.tokens_file)
    if not tokens and not settings.is_loopback:
        raise UnsafeSettings(
            f"{settings.host} can be reached by others: make a token ('fling token create') and set FLING_TOKENS_FILE"
        )

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        service = _service(settings, tokens)
        app.state.service = service
        warming = asyncio.create_task(service.workers.warm())
        try:
            yield
        finally:
            warming.cancel()
            service.workers.close()
            service.store.close()

    app = FastAPI(
        title="Fling", version=fling_version(), description=DESCRIPTION, lifespan=lifespan, docs_url=None,
        redoc_url=None, redirect_slashes=False,
    )  # fmt: skip
    app.add_middleware(Gate, local_only=not tokens)
    problems.install(app)
    for router in (plans.router, executions.router, cells.router, health.router, pages.router):
        app.include_router(router)
    app.openapi = lambda: _openapi(app)
    return app


def _service(settings: Settings, tokens: Any) -> Service:
    store = Store.open(settings.database_url)
    shelf = CellShelf(settings.cells)
    for name, reason in shelf.faults().items():
        logging.getLogger("fling").warning("cell %s is refused: %s", name, reason)
    workers = Workers(settings.planner_workers, settings.planner_queue, _warm_up(settings, shelf))
    return Service(settings, store, shelf, workers, tokens, Metrics(store.execution_counts))


def _warm_up(settings: Settings, shelf: CellShelf) -> Job | None:
    text = shelf.text(settings.default_cell)
    return None if text is None else Job("warm-up", "", settings.default_cell, text, WARM_UP)


def _openapi(app: FastAPI) -> dict[str, Any]:
    if app.openapi_schema is None:
        schema = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
        answer = ProblemAnswer.model_json_schema(ref_template="#/components/schemas/{model}")
        schema["components"]["schemas"] |= {**answer.pop("$defs", {}), "ProblemAnswer": answer}
        app.openapi_schema = schema
    return app.openapi_schema
