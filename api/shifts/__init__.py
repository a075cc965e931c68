"""Jobs of picks and throws, carried out by the service."""

from api.shifts.driver import JobDrivers

__all__ = ["JobDrivers"]
