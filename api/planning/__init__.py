"""The planner in processes of its own: the pool of workers behind a bounded queue."""

from api.planning.batch_drivers import BatchDrivers
from api.planning.map_runners import MapRunners
from api.planning.pool import ClientGone, PlannerPool, PlanningEnded, PlanningQueueFull

__all__ = [
    "BatchDrivers",
    "ClientGone",
    "MapRunners",
    "PlannerPool",
    "PlanningEnded",
    "PlanningQueueFull",
]
