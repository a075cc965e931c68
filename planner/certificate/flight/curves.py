"""Curve of the flight: how far the object keeps from what it might meet."""

from __future__ import annotations

import math

import numpy as np

from planner.arrays import Array
from planner.cell import CONTACT_M
from planner.certificate.flight.flights import Flights, flights_of
from planner.certificate.shown import Curve, Series, ShownMotion

FLIGHT_STEP_S = 0.005  # [s] between the instants of a flight


def flight_curves(shown: ShownMotion) -> list[Curve]:
    """Returns the distance of the object's surface from what it might meet, of a release on time."""
    if not shown.problem.throws:
        return []
    flights = flights_of(shown.motion)
    if flights.end is None:
        return []
    begin = flights.released_s
    end = flights.end[1]
    t = np.linspace(begin, end, 1 + max(1, math.ceil((end - begin) / FLIGHT_STEP_S)))
    required = flights.clearance_m
    return [Curve("flight_clearance", "m", t, (Series("object", required + _least_gaps(flights, t), required),))]


def _least_gaps(flights: Flights, t: Array) -> Array:
    """Returns the least gaps (k,) [m] at `t` (k,), beyond the clearance.

    As in the check, what does not let go of the object at once is left out, and what it lands on, unless that is met.
    """
    count = len(flights.names) - (flights.opening is None)
    x = flights.positions(np.full(len(t), flights.released_s), t)
    gaps = flights.gaps_along(x, t)[:count]
    gripped = flights.gripped
    gaps[gripped[gaps[gripped, 0] < 0.0]] = np.inf
    gaps[flights.carriers[:count, None] & (gaps >= -CONTACT_M)] = np.inf
    return gaps.min(axis=0)
