"""Lower bounds on the object's distance from keep-out shapes: in the air, then on what it lands on.

From the touch of that to its place at the target, which its centre reaches where the flight passes the target's plane,
the object lies on it: the centre goes on over the same places, at one height.
"""

from __future__ import annotations

from functools import reduce

import numpy as np

from planner.arrays import Array, Index, Mask
from planner.certificate.flight.flights import Flights
from planner.certificate.flight.separation import core_bound


def core_gaps(flights: Flights, corners: list[Array], item: Index, bend: Array, falling: Mask) -> Array:
    """Returns lower bounds on the distances of patches from the cores of shapes (...) [m].

    Args:
        flights: the flights.
        corners: of the patches, each (3, ...) [m].
        item: numbers of the shapes (...).
        bend: deviation of the flights from what is between the corners (...) [m].
        falling: which patches surely fall (...).
    """
    shapes = flights.shapes[:, item]
    tops = flights.tops[item]
    heights = [corner[2] for corner in corners]
    lowest = reduce(np.minimum, heights) - bend
    landed_at = flights.lowest_at(corners, bend)
    above = np.where(falling, np.maximum(lowest, landed_at), lowest) - tops
    in_air = np.maximum(core_bound(corners, shapes) - bend, above)
    touching = falling & (lowest < flights.highest_end_at(corners, bend))
    if flights.lies_at_m is None or not touching.any():
        return in_air
    lying = core_bound([flights.lying_at(corner) for corner in corners], shapes) - bend
    lying = np.where(flights.motion.problem.is_met_lying(tops + shapes[-1]), lying, np.inf)
    landed = falling & (reduce(np.maximum, heights) + bend < landed_at)
    return np.where(landed, lying, np.where(touching, np.minimum(in_air, lying), in_air))
