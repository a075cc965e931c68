"""Lower bounds on the object's distance from keep-out shapes: in the air, then on what it lands on.

From the touch of that to its place at the target, which its centre reaches where the flight passes the target's plane,
the object lies on it: the centre goes on over the same places, at one height.
"""

from __future__ import annotations

from functools import reduce

import numpy as np

from planner.arrays import Array, Index, Mask
from planner.certificate.flight.flights import Flights
from planner.certificate.flight.separation import core_bound, mean


def core_gaps(
    flights: Flights, corners: list[Array], times: list[Array], item: Index, bend: Array, falling: Mask
) -> Array:
    """Returns lower bounds on the distances of patches from the cores of shapes (...) [m].

    Args:
        flights: the flights.
        corners: of the patches, each (3, ...) [m].
        times: of the corners, each (...) [s].
        item: numbers of the shapes (...).
        bend: deviation of the flights from what is between the corners (...) [m].
        falling: which patches surely fall (...).
    """
    shapes = flights.shapes[:, item]
    tops = flights.tops[item]
    heights = [corner[2] for corner in corners]
    lowest = reduce(np.minimum, heights) - bend
    landed_at = flights.lowest_at(corners, times, bend)
    above = np.where(falling, np.maximum(lowest, landed_at), lowest) - tops
    in_air = np.maximum(core_bound(corners, shapes) - bend, above)
    touching = falling & (lowest < flights.highest_end_at(corners, bend))
    if flights.lies_at_m is None or not touching.any():
        return in_air
    lying = core_bound([flights.lying_at(corner) for corner in corners], shapes) - bend
    lying = np.where(flights.motion.problem.is_met_lying(tops + shapes[-1]), lying, np.inf)
    landed = falling & (reduce(np.maximum, heights) + bend < landed_at)
    return np.where(landed, lying, np.where(touching, np.minimum(in_air, lying), in_air))


def least_gaps(flights: Flights, corners: list[Array], bend: Array) -> Array:
    """Returns gaps (b,) [m] that no bound of `core_gaps` on each shape is below, less what the two are thick.

    A bound on a patch is at least the distance of its middle, less how far its corners and the bend are from there.
    The middles of all releases at an instant are in one box, where the object flies and where it would lie.

    Args:
        flights: the flights.
        corners: of the patches, each (3, m, n) [m].
        bend: deviation of the flights from what is between the corners (m, n) [m].
    """
    places = [corners, *([] if flights.lies_at_m is None else [[flights.lying_at(corner) for corner in corners]])]
    gaps = []
    for each in places:
        middle = mean(each)
        around = np.max([np.sqrt(((corner - middle) ** 2).sum(axis=0)) for corner in each], axis=0) + bend
        lower, upper = (corner[..., None] for corner in flights.motion.problem.cell.surroundings.keep_out_bounds)
        apart = np.maximum(np.maximum(lower - middle.max(axis=1), middle.min(axis=1) - upper), 0.0)
        gaps.append((np.sqrt((apart**2).sum(axis=1)) - around.max(axis=0)).min(axis=-1))
    return np.asarray(np.min(gaps, axis=0) - flights.thickness[: flights.count])
