"""Lower bounds on the object's distance from keep-out shapes: in the air, then on what it lands on.

From the touch of that to its place at the target, which its centre reaches where the flight passes the target's plane,
the object lies on it: the centre goes on over the same places, at one height.
"""

from __future__ import annotations

from functools import reduce
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Index, Mask
from planner.certificate.flight.flights import Flights
from planner.certificate.flight.separation import core_bound, mean


class BallPatches(NamedTuple):
    """Patches of flights, and of one ball of the object.

    Attributes:
        corners: of the patches of the centre, each (3, ...) [m].
        times: of these, each (...) [s].
        bend: deviation of the centre from what is between them (...) [m].
        places: corners of the patches of the ball, the same for an object that is one [m].
        ball_bend: deviation of the ball (...) [m].
        falling: which patches surely fall (...).
        lowest: height that no point of a body is below (...) [m]; None of an object that is a ball.
    """

    corners: list[Array]
    times: list[Array]
    bend: Array
    places: list[Array]
    ball_bend: Array
    falling: Mask
    lowest: Array | None = None

    def at(self, chosen: Mask) -> BallPatches:
        """Returns the `chosen` ones of patches (k,)."""
        times = [t[chosen] for t in self.times]
        corners, places = ([corner[:, chosen] for corner in each] for each in (self.corners, self.places))
        lowest = None if self.lowest is None else self.lowest[chosen]
        bends = self.bend[chosen], self.ball_bend[chosen]
        return BallPatches(corners, times, bends[0], places, bends[1], self.falling[chosen], lowest)


def core_gaps(flights: Flights, patches: BallPatches, item: Index) -> Array:
    """Returns lower bounds on the distances of patches from the cores of shapes (...) [m].

    Args:
        flights: the flights.
        patches: of a ball.
        item: numbers of the shapes (...).
    """
    (corners, times, bend, places, ball_bend, falling, of_body) = patches
    shapes = flights.shapes[:, item]
    tops = flights.tops[item]
    if of_body is not None:
        return np.maximum(core_bound(places, shapes) - ball_bend, of_body + flights.radius_m - tops)
    lowest = reduce(np.minimum, [place[2] for place in places]) - ball_bend
    landed_at = flights.lowest_at(corners, times, bend)
    above = np.where(falling, np.maximum(lowest, landed_at), lowest) - tops
    in_air = np.maximum(core_bound(places, shapes) - ball_bend, above)
    heights = [corner[2] for corner in corners]
    touching = falling & (reduce(np.minimum, heights) - bend < flights.highest_end_at(corners, bend))
    if flights.lies_at_m is None or not touching.any():
        return in_air
    lying = core_bound([flights.lying_at(corner) for corner in corners], shapes) - bend
    lying = np.where(flights.motion.problem.is_met_lying(tops + shapes[-1]), lying, np.inf)
    landed = falling & (reduce(np.maximum, heights) + bend < landed_at)
    return np.where(landed, lying, np.where(touching, np.minimum(in_air, lying), in_air))


def least_gaps(flights: Flights, patches: BallPatches) -> Array:
    """Returns gaps (b,) [m] that no bound of `core_gaps` on each shape is below, less what the two are thick.

    A bound on a patch is at least the distance of its middle, less how far its corners and the bend are from there.
    The middles of all releases at an instant are in one box, where the object flies and where it would lie.

    Args:
        flights: the flights.
        patches: of a ball (m, n).
    """
    everywhere = [(patches.places, patches.ball_bend)]
    if flights.lies_at_m is not None:
        lying = [flights.lying_at(corner) for corner in patches.corners]
        everywhere.append((lying, patches.bend))
    gaps = []
    for each, bend in everywhere:
        middle = mean(each)
        around = np.max([np.sqrt(((corner - middle) ** 2).sum(axis=0)) for corner in each], axis=0) + bend
        lower, upper = (corner[..., None] for corner in flights.motion.problem.cell.surroundings.keep_out_bounds)
        apart = np.maximum(np.maximum(lower - middle.max(axis=1), middle.min(axis=1) - upper), 0.0)
        gaps.append((np.sqrt((apart**2).sum(axis=1)) - around.max(axis=0)).min(axis=-1))
    return np.asarray(np.min(gaps, axis=0) - flights.thickness[: flights.count])
