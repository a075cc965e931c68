"""What a flight meets, as half spaces in which a search can keep the object clear of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.arrays import Array, Index
from planner.certificate.flight.flights import TINY_M, Flights, is_falling
from planner.certificate.samples import MotionSamples
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

STEP_S = 0.002  # [s] between the instants that are looked at: 1 cm at 5 m/s


@dataclass(frozen=True, eq=False)
class FlightObstruction:
    """What the object meets in flight.

    With the object's centre at x(s), s after its release, the flight clears the obstacle at an instant where
    direction . x(s) >= offset. Other flights need it at other instants, so this is a guide for a search, no proof.

    Attributes:
        obstacle: such as "upper_arm", "box 0" or "rim".
        gap_m: least distance between the two surfaces [m]; negative where they overlap.
        delay_s: time of this release after the nominal one [s], within the release window.
        flight_time_s: first, deepest and last instant of the contact, after this release (3,) [s].
        direction: unit vectors in the world (3, 3), one a row, away from the obstacle.
        offset_m: (3,) [m], the radii of object and obstacle included.
    """

    obstacle: str
    gap_m: float
    delay_s: float
    flight_time_s: Array
    direction: Array
    offset_m: Array


def flight_obstruction(problem: ThrowProblem, trajectory: Trajectory) -> FlightObstruction | None:
    """Returns what the object comes closest to after its release, if it meets anything; None otherwise.

    The flights of the nominal release and of the window's ends are looked at every 2 ms.
    """
    if problem.ends_at_rest:
        return None
    flights = Flights(MotionSamples(problem, trajectory))
    if flights.end is None:
        return None
    delays = (-flights.window_s, 0.0, flights.window_s) if flights.window_s > 0.0 else (0.0,)
    found = [contact for delay in delays if (contact := _deepest_contact(flights, delay)) is not None]
    return min(found, key=lambda contact: contact.gap_m, default=None)


def _deepest_contact(flights: Flights, delay: float) -> FlightObstruction | None:
    """Returns what the flight of one release overlaps most, None where it overlaps nothing."""
    r = flights.released_s + delay
    s, x, gaps = _sampled_gaps(flights, r)
    if gaps.size == 0 or gaps.min() >= 0.0:
        return None
    item, deepest = divmod(int(gaps.argmin()), len(s))
    apart = np.flatnonzero(gaps[item] >= 0.0)
    first = int(apart[apart < deepest].max(initial=-1)) + 1
    last = int(apart[apart > deepest].min(initial=len(s))) - 1
    rows = np.array([first, deepest, last])
    x = flights.lying(x, is_falling(x)) if item < len(flights.boxes[0]) else x
    direction, offset = _half_spaces(flights, item, x[:, rows], r + s[rows])
    return FlightObstruction(flights.names[item], float(gaps.min()), delay, s[rows], direction, offset)


def _sampled_gaps(flights: Flights, r: float) -> tuple[Array, Array, Array]:
    """Returns times after the release at `r` (n,) [s], centres (3, n) and gaps to every obstacle (items, n) [m].

    They end with the flight; what the object has not left yet, and what lies below its landing, has an infinite gap.
    """
    assert flights.end is not None
    level, end = flights.end
    s = np.arange(0.0, end - flights.released_s + 2.0 * flights.window_s + STEP_S, STEP_S)
    x = flights.positions(np.full(len(s), r), r + s)
    rising = np.append(np.diff(x[2]) > 0.0, False)
    flying = rising | (x[2] >= level)
    s = s[flying]
    x = x[:, flying]
    gaps = flights.gaps_along(x, r + s)
    for item in flights.gripped:
        clear = np.logical_or.accumulate(gaps[item] >= 0.0)
        gaps[item] = np.where(clear, gaps[item], np.inf)
    return s, x, gaps


def _half_spaces(flights: Flights, item: int, x: Array, t: Array) -> tuple[Array, Array]:
    """Returns directions (k, 3) and offsets (k,) [m] of the half spaces that keep `x` (3, k) clear of an obstacle."""
    items = np.full(len(t), item, dtype=np.intp)
    near = flights.nearest(items, x, t)
    apart = x - near
    length = np.sqrt((apart * apart).sum(axis=0))
    direction = apart / np.maximum(length, TINY_M)
    for i in np.flatnonzero(length <= TINY_M):
        direction[:, i], near[:, i] = _way_out(flights, items[i : i + 1], x[:, i])
    return direction.T, (direction * near).sum(axis=0) + flights.thickness[item]


def _way_out(flights: Flights, item: Index, x: Array) -> tuple[Array, Array]:
    """Returns the outward direction of the nearest face of a box around `x` (3,), but the bottom, and a point of it.

    A point on the axis of a capsule leaves it upwards.
    """
    count = len(flights.boxes[0])
    if item[0] >= count:
        return np.array([0.0, 0.0, 1.0]), x
    lower, upper = (side[item[0]] for side in flights.boxes)
    depths = np.concatenate([x - lower, upper - x])
    depths[2] = np.inf  # a flight does not pass below
    face = int(depths.argmin())
    direction = np.zeros(3)
    direction[face % 3] = 1.0 if face >= 3 else -1.0
    return direction, x + depths[face] * direction
