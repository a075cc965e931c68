"""The routes, one module per resource. An endpoint parses its request, makes one call and returns.

The driver of jobs plans and executes as they do.
"""

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
from api.routes.executions import check_executable
from api.routes.plans import PlanOrder, current_positions, stored_plan

__all__ = ["ROUTERS", "PlanOrder", "check_executable", "current_positions", "stored_plan"]

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
