"""The routes, one module per resource. An endpoint parses its request, makes one call and returns."""

from api.routes import (
    batches,
    cells,
    executions,
    experiments,
    health,
    jobs,
    landings,
    maps,
    pages,
    plans,
    profiles,
    retarget,
    robot,
    targets,
)

__all__ = ["ROUTERS"]

ROUTERS = (
    plans.router,
    batches.router,
    executions.router,
    landings.router,
    experiments.router,
    cells.router,
    robot.router,
    retarget.router,
    jobs.router,
    targets.router,
    maps.router,
    profiles.router,
    health.router,
    pages.router,
)
