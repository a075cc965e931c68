"""The application: `create_app` assembles the service, `serve` runs it. Importing this module has no side effects."""

from __future__ import annotations

import asyncio
import logging
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial

from fastapi import FastAPI
from starlette.middleware.gzip import GZipMiddleware

from api import fling_version
from api.cell_repository import CellRepository
from api.dependencies import Service
from api.http import (
    KEEP_ALIVE_S,
    HeadMiddleware,
    ProblemProtocol,
    SecurityMiddleware,
    TokenRegistry,
    install_error_handlers,
    openapi_schema,
    operation_id,
)
from api.metrics import Metrics
from api.planning import PlannerPool, PlanningJob, compile_when_idle
from api.routes import ROUTERS
from api.settings import ServiceSettings, is_loopback_host
from store import Store, StoreError

DESCRIPTION = (
    "Plan a throw (or any move that must pass a state at speed) for a Universal Robots arm, get it certified, stream "
    "it to the arm. SI units; world frame unless a request says `frame: base`. Every error is "
    "`application/problem+json`. **Software stop is not a safety function.**"
)
WARM_UP_REQUEST = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}}  # any throw loads and builds everything
COMPRESSED_BYTES = 1000  # answers from this size on are compressed for clients that can read it
COMPRESSION = 4  # of 9: a plan shrinks to a third in milliseconds; more costs much and saves little
SHUTDOWN_S = 2  # [s] time for open event streams before they are cut


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
    )
    app.state.tokens = tokens
    app.add_middleware(GZipMiddleware, minimum_size=COMPRESSED_BYTES, compresslevel=COMPRESSION)
    app.add_middleware(HeadMiddleware)
    app.add_middleware(SecurityMiddleware, local_only=not tokens.is_guarded)
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
    warm_up = asyncio.create_task(_warm_up(service))
    try:
        yield
    finally:
        warm_up.cancel()
        await asyncio.gather(warm_up, return_exceptions=True)
        service.pool.close()
        service.store.close()


def serve(settings: ServiceSettings) -> int:
    """Serves until SIGINT or SIGTERM. Returns the exit status of the process."""
    import uvicorn

    try:
        Store.open(settings.database_url).close()
        app = create_app(settings)
    except (ValueError, RuntimeError, StoreError) as error:
        print(f"fling: {error}", file=sys.stderr)
        return 2
    if settings.tokens_file is not None:
        signal.signal(signal.SIGHUP, lambda *_: app.state.tokens.reload())
    uvicorn.run(
        app,
        host=settings.host,
        port=settings.port,
        log_level="warning",
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=SHUTDOWN_S,
        timeout_keep_alive=KEEP_ALIVE_S,
        http=ProblemProtocol,
        ws="none",
    )
    return 0


def _service(settings: ServiceSettings, tokens: TokenRegistry) -> Service:
    store = Store.open(settings.database_url)
    cells = CellRepository(settings.cells)
    for name, reason in cells.faults().items():
        logging.getLogger("fling").warning("cell %s is refused: %s", name, reason)
    pool = PlannerPool(settings.planner_workers, settings.planner_queue, _warm_up_job(settings, cells))
    return Service(settings, store, cells, pool, tokens, Metrics(store.execution_counts))


async def _warm_up(service: Service) -> None:
    """Starts the planner processes; compiles the solvers where that is not done, while nothing is executed."""
    await service.pool.warm_up()
    if not service.pool.is_compiled and await compile_when_idle(service.is_idle):
        await service.pool.renew()


def _warm_up_job(settings: ServiceSettings, cells: CellRepository) -> PlanningJob | None:
    source = cells.source(settings.default_cell)
    return None if source is None else PlanningJob("warm-up", "", source, WARM_UP_REQUEST)
