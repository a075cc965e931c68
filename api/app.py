"""The application: `create_app` assembles the service, `serve` runs it. Importing this module has no side effects."""

from __future__ import annotations

import asyncio
import logging
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial

from fastapi import Depends, FastAPI
from starlette.concurrency import run_in_threadpool
from starlette.middleware.gzip import GZipMiddleware

from api import fling_version
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
from api.logs import REQUESTS, configure_logs
from api.metrics import Metrics
from api.planning import BatchDrivers, MapRunners, PlannerPool
from api.routes import ROUTERS
from api.settings import ServiceSettings, is_loopback_host
from api.store_probe import StoreProbe
from batch.jobs import PlanningJob, warm_up_job
from fling import tracing
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


def create_app(settings: ServiceSettings) -> FastAPI:
    """Returns the service for these settings.

    Raises:
        UnsafeSettings: There are no tokens and the address can be reached from other machines.
        ValueError: The tokens file cannot be read, or names no token.
    """
    tokens = TokenRegistry(settings.tokens_file)
    if not tokens.is_guarded and not is_loopback_host(settings.host):
        raise UnsafeSettings(
            f"{settings.host} can be reached from other machines: create a token ('fling token create') and set "
            "FLING_TOKENS_FILE"
        )

    app = FastAPI(
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
    app.add_middleware(GZipMiddleware, minimum_size=COMPRESSED_BYTES, compresslevel=COMPRESSION)
    app.add_middleware(HeadMiddleware)
    app.add_middleware(DrainingMiddleware)
    app.add_middleware(SecurityMiddleware, local_only=not tokens.is_guarded)
    app.add_middleware(RequestLogMiddleware, record=partial(_record_request, app))
    app.add_middleware(TracingMiddleware)
    install_error_handlers(app)
    for router in ROUTERS:
        app.include_router(router)
    app.openapi = lambda: openapi_schema(app, tokens.is_guarded)
    return app


@asynccontextmanager
async def _lifespan(settings: ServiceSettings, tokens: TokenRegistry, app: FastAPI) -> AsyncIterator[None]:
    """Opens the service's parts, and closes them when the application ends."""
    service = _service(settings, tokens)
    app.state.service = service
    works = [_warm_up, _retain]
    if settings.batch_workers != 0:
        works += [_drive_batches, _make_maps]
    tasks = [asyncio.create_task(work(service)) for work in works]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        service.pool.close()
        service.store.close()


def serve(settings: ServiceSettings) -> int:
    """Serves until SIGINT or SIGTERM, then drains. Returns the exit status of the process."""
    from api.server import DrainingServer, server_config

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
    config = server_config(app, settings.host, settings.port)
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
            await run_in_threadpool(service.store.add_audit, line)
        except StoreError as error:
            logging.getLogger("fling").error("an audit line is lost: %s", error, extra={"fields": vars(line)})


async def _drain(app: FastAPI) -> None:
    """Refuses new work and returns once what was begun is answered; ends the event streams."""
    app.state.is_draining = True
    await app.state.service.pool.drain()
    app.state.service.feeds.close()


def _service(settings: ServiceSettings, tokens: TokenRegistry) -> Service:
    store = Store.open(settings.database_url)
    cells = CellRepository(settings.cells)
    for name, reason in cells.faults().items():
        logging.getLogger("fling").warning("cell %s is refused: %s", name, reason)
    pool = PlannerPool(settings.planner_workers, settings.planner_queue, _warm_up_job(settings, cells))
    drivers = BatchDrivers(store, settings.database_url, settings.driver_workers, settings.ray_address)
    runners = MapRunners(store, settings.database_url, settings.driver_workers, settings.ray_address)
    metrics = Metrics(store)
    feeds = ExecutionFeeds(store)
    return Service(settings, store, cells, pool, drivers, runners, tokens, metrics, feeds, StoreProbe(store))


async def _warm_up(service: Service) -> None:
    """Starts the planner processes."""
    await service.pool.warm_up()


async def _drive_batches(service: Service) -> None:
    """Has batches planned, those first that were left when the service ended."""
    await service.batch_drivers.run()


async def _make_maps(service: Service) -> None:
    """Has maps made, those first that were left when the service ended."""
    await service.map_runners.run()


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


def _warm_up_job(settings: ServiceSettings, cells: CellRepository) -> PlanningJob | None:
    source = cells.source(settings.default_cell)
    return None if source is None else warm_up_job(source)
