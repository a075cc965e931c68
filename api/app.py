"""The application: `create_app` assembles the service, `serve` runs it. Importing this module has no side effects."""

from __future__ import annotations

import asyncio
import logging
import signal
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial
from typing import Any

from anyio import to_thread
from fastapi import Depends, FastAPI
from starlette.concurrency import run_in_threadpool
from starlette.middleware.gzip import GZipMiddleware
from starlette.types import ASGIApp

from api import fling_version
from api.allocator import give_memory_back
from api.cell_repository import CellRepository
from api.dependencies import Service, known_query
from api.execution_feed import ExecutionFeeds
from api.http import (
    DrainingMiddleware,
    HeadMiddleware,
    RequestLogMiddleware,
    RequestRecord,
    SecurityMiddleware,
    TokenRegistry,
    TracingMiddleware,
    install_error_handlers,
    openapi_schema,
    operation_id,
)
from api.lanes import Lanes, share_interpreter
from api.logs import REQUESTS, configure_logs
from api.metrics import Metrics
from api.planning import BatchDrivers, DriverCommand, MapDrivers, PlanningLine
from api.routes import ROUTERS
from api.settings import ServiceSettings
from api.shifts import JobDrivers
from api.stopping import Stopping
from api.store_probe import StoreProbe
from fling import this_machine, tracing
from jobs.pool import PLANNING, open_pool, warm_up_job
from store import Retention, Store, StoreError

DESCRIPTION = (
    "Plan a throw (or any move that must pass a state at speed) for a Universal Robots arm, get it certified, stream "
    "it to the arm. SI units; world frame unless a request says `frame: base`. Every error is "
    "`application/problem+json`. **Software stop is not a safety function.**"
)
COMPRESSED_BYTES = 1000  # answers from this size on are compressed for clients that can read it
COMPRESSION = 1  # of 9: a plan shrinks to less than half; 4 takes twice as long for 4 % less
RETENTION_PERIOD_S = 600.0  # [s] between two times that old plans and executions are deleted


class UnsafeSettings(ValueError):
    """The service refuses to start because other machines could use it without a token."""


class Application(FastAPI):
    """FastAPI whose log, metrics and headers cover its answers to bugs, too.

    The framework answers a bug in its outermost middleware, beyond all that are added to it; these are around that one.

    Args:
        guard: makes the middleware that refuses foreign hosts and pages.
        **options: of FastAPI.
    """

    def __init__(self, guard: Callable[[ASGIApp], ASGIApp], **options: Any) -> None:
        super().__init__(**options)
        self._guard = guard

    def build_middleware_stack(self) -> ASGIApp:
        """Returns the application with everything around it."""
        inside = self._guard(super().build_middleware_stack())
        return TracingMiddleware(RequestLogMiddleware(inside, partial(_record_request, self)))


def create_app(settings: ServiceSettings) -> FastAPI:
    """Returns the service for these settings.

    Raises:
        UnsafeSettings: There are no tokens and the address can be reached from other machines.
        ValueError: The tokens file cannot be read, or names no token.
    """
    tokens = TokenRegistry(settings.tokens_file)
    if not tokens.is_guarded and not this_machine.is_loopback_host(settings.host):
        raise UnsafeSettings(
            f"{settings.host} can be reached from other machines: create a token ('fling token create') and set "
            "FLING_TOKENS_FILE"
        )

    app = Application(
        partial(SecurityMiddleware, local_only=not tokens.is_guarded),
        title="Fling",
        version=fling_version(),
        description=DESCRIPTION,
        lifespan=partial(_lifespan, settings, tokens),
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
        generate_unique_id_function=operation_id,
        dependencies=[Depends(known_query)],
    )
    app.state.tokens = tokens
    app.state.is_draining = False
    app.state.lanes = Lanes()
    app.add_middleware(GZipMiddleware, minimum_size=COMPRESSED_BYTES, compresslevel=COMPRESSION)
    app.add_middleware(HeadMiddleware)
    app.add_middleware(DrainingMiddleware)
    install_error_handlers(app)
    for router in ROUTERS:
        app.include_router(router)
    app.openapi = lambda: openapi_schema(app, tokens.is_guarded)
    return app


@asynccontextmanager
async def _lifespan(settings: ServiceSettings, tokens: TokenRegistry, app: FastAPI) -> AsyncIterator[None]:
    """Opens the service's parts, and closes them when the application ends."""
    share_interpreter()
    service = _service(settings, tokens, app.state.lanes)
    app.state.service = service
    works = [_retain(service)]
    if settings.batch_workers != 0:  # those first that were left when the service ended
        works += [service.batch_drivers.run(), service.map_drivers.run(), JobDrivers(service).run()]
    tasks = [asyncio.create_task(work) for work in works]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await service.replanning.close()
        service.line.close()
        service.store.close()


def serve(settings: ServiceSettings) -> int:
    """Serves until SIGINT or SIGTERM, then drains. Returns the exit status of the process."""
    from api.server import DrainingServer, server_config

    give_memory_back()
    try:
        Store.open(settings.database_url).close()
        app = create_app(settings)
    except (ValueError, RuntimeError, StoreError) as error:
        print(f"fling: {error}", file=sys.stderr)
        return 1
    if settings.tokens_file is not None:
        signal.signal(signal.SIGHUP, lambda *_: app.state.tokens.reload())
    configure_logs(settings.request_log)
    if (missing := tracing.configure_tracing("fling-service")) is not None:
        logging.getLogger("fling").warning(missing)
    config = server_config(app, settings.host, settings.port, settings.proxies)
    DrainingServer(config, partial(_drain, app)).run()
    return 0


async def _record_request(app: FastAPI, request: RequestRecord) -> None:
    """Logs and counts an answered request, and audits an act that was refused."""
    logging.getLogger(REQUESTS).info("request", extra={"fields": request.log_fields()})
    service: Service | None = getattr(app.state, "service", None)
    if service is None:
        return
    service.metrics.record_request(request.method, request.route, request.status, request.duration_s)
    if (line := request.refused_act()) is not None:
        try:
            await to_thread.run_sync(service.store.add_audit, line, limiter=app.state.lanes.records)
        except StoreError as error:
            logging.getLogger("fling").error("an audit line is lost: %s", error, extra={"fields": vars(line)})


async def _drain(app: FastAPI) -> None:
    """Refuses new work and returns once what was begun is answered; ends the event streams."""
    app.state.is_draining = True
    await app.state.service.line.drain()
    app.state.service.feeds.close()


def _service(settings: ServiceSettings, tokens: TokenRegistry, lanes: Lanes) -> Service:
    store = Store.open(settings.database_url)
    cells = CellRepository(settings.cells)
    for name, reason in cells.faults().items():
        logging.getLogger("fling").warning("cell %s is refused: %s", name, reason)
    source = cells.source(settings.default_cell)
    work = PLANNING if source is None else replace(PLANNING, warm_up=warm_up_job(source))
    command = DriverCommand(settings.database_url, settings.driver_workers, settings.ray_address)
    return Service(
        settings=settings,
        store=store,
        cells=cells,
        line=PlanningLine(open_pool(settings.planner_workers, work=work), settings.planner_queue),
        batch_drivers=BatchDrivers(store, command),
        map_drivers=MapDrivers(store, command),
        tokens=tokens,
        metrics=Metrics(store),
        feeds=ExecutionFeeds(store),
        stopping=Stopping(store, settings.data, lanes),
        probe=StoreProbe(store),
    )


async def _retain(service: Service) -> None:
    """Deletes from time to time what the settings give up."""
    while service.settings.retention != Retention():
        try:
            batches = await run_in_threadpool(service.store.retain_batches, service.settings.retention)
            plans, runs = await run_in_threadpool(service.store.retain, service.settings.retention)
            if plans or runs or batches:
                counts = plans, runs, batches
                logging.getLogger("fling").info("retention deleted %d plans, %d executions, %d batches", *counts)
        except StoreError:  # the store has logged it; tried again next time
            pass
        await asyncio.sleep(RETENTION_PERIOD_S)
