"""The planner in processes of its own: a pool of workers behind a bounded queue."""

from api.planning.compilation import compile_when_idle
from api.planning.pool import PlannerPool, PlanningEnded, PlanningQueueFull
from api.planning.worker import Planned, PlanningJob, initialise, solve

__all__ = [
    "Planned",
    "PlannerPool",
    "PlanningEnded",
    "PlanningJob",
    "PlanningQueueFull",
    "compile_when_idle",
    "initialise",
    "solve",
]
