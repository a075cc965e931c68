"""Lower bounds on the object's distance from keep-out boxes: in the air, then on what it lands on.

From the touch of that to its place at the target, which its centre reaches where the flight passes the target's plane,
the object lies on it: the centre goes on over the same places, at one height.
"""

from __future__ import annotations

from functools import reduce

import numpy as np

from planner.arrays import Array, Mask
from planner.certificate.flight.flights import Flights
from planner.certificate.flight.separation import box_bound


def box_gaps(flights: Flights, corners: list[Array], boxes: tuple[Array, Array], bend: Array, falling: Mask) -> Array:
    """Returns lower bounds on the distances of patches from boxes (...) [m].

    Args:
        flights: the flights.
        corners: of the patches, each (3, ...) [m].
        boxes: their lower and upper corners (3, ...) [m].
        bend: deviation of the flights from what is between the corners (...) [m].
        falling: which patches surely fall (...).
    """
    lower, upper = boxes
    heights = [corner[2] for corner in corners]
    lowest = reduce(np.minimum, heights) - bend
    landed_at = flights.lowest_at(corners, bend)
    above = np.where(falling, np.maximum(lowest, landed_at), lowest) - upper[2]
    in_air = np.maximum(box_bound(corners, lower, upper) - bend, above)
    touching = falling & (lowest < flights.highest_end_at(corners, bend))
    if flights.lies_at_m is None or not touching.any():
        return in_air
    lying = box_bound([flights.lying_at(corner) for corner in corners], lower, upper) - bend
    lying = np.where(flights.motion.problem.is_met_lying(upper[2]), lying, np.inf)
    landed = falling & (reduce(np.maximum, heights) + bend < landed_at)
    return np.where(landed, lying, np.where(touching, np.minimum(in_air, lying), in_air))
