"""Planning for the service: the line in front of its planner processes, and the drivers of its batches and maps."""

from api.planning.driver_processes import BatchDrivers, DriverCommand, MapDrivers
from api.planning.line import ClientGone, PlanningEnded, PlanningLine, PlanningQueueFull

__all__ = [
    "BatchDrivers",
    "ClientGone",
    "DriverCommand",
    "MapDrivers",
    "PlanningEnded",
    "PlanningLine",
    "PlanningQueueFull",
]
