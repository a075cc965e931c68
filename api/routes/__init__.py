"""The routes, one module per resource. An endpoint parses its request, makes one call and returns."""

from api.routes import cells, execution_events, executions, health, pages, plans, timing

__all__ = ["ROUTERS"]

ROUTERS = (
    plans.router,
    executions.router,
    execution_events.router,
    cells.router,
    timing.router,
    health.router,
    pages.router,
)
