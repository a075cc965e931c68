"""The routes, one module per resource. An endpoint parses its request, makes one call and returns."""

from api.routes import (
    batches,
    cell_history,
    cells,
    execution_events,
    executions,
    experiments,
    health,
    landings,
    maps,
    pages,
    plans,
    profiles,
    scene,
    timing,
)

__all__ = ["ROUTERS"]

ROUTERS = (
    plans.router,
    batches.router,
    executions.router,
    execution_events.router,
    landings.router,
    experiments.router,
    cells.router,
    cell_history.router,
    scene.router,
    timing.router,
    maps.router,
    profiles.router,
    health.router,
    pages.router,
)
