"""The object's flight after the release: what it comes close to whenever the gripper may open, and what it meets."""

from planner.certificate.flight.clearance import flight_clearance
from planner.certificate.flight.curves import flight_curves
from planner.certificate.flight.flights import Flights, flights_of

__all__ = ["Flights", "flight_clearance", "flight_curves", "flights_of"]
