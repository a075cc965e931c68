"""Where a body that is no ball lands: the one definition of the end of its flight.

A body flies until its turned shape first touches the height of what it is to land on: falling, which begins at the
apex of its flight, its lowest point comes down to the floor, the level top of a shape or the bottom of a bin. It must
then be over that surface with all of its hull, or within the bin's wall, and must have met nothing before, neither the
floor nor the sides of what it lands on. The place of the landing is that of its centre at this instant, plumb on the
target's height; axis and release window are judged at the same instant. Nothing counts after it: how a body tips over
and slides, nobody knows. A target that the largest ball within the body does not touch first, as there is nothing below
it, is in the air: there the centre passes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Index, Mask
from planner.cell import ThrownBody
from planner.flight import landing_states, positions_after
from planner.spin import Rotation, fastest_turn

TOUCH_M = 1e-7  # [m] height that counts as a touch; a thousandth of what a landing is judged to
STEPS_MAX = 400  # [-] of the way to a touch; most take ten. What grazes a height for longer has none that is known
AIRBORNE_MAX_S = 5.0  # [s] of a flight that is followed: an arm throws for two at most, to the floor of a hall


class Leaving(NamedTuple):
    """How n bodies leave the tool.

    Attributes:
        p: positions of their centres (n, 3) [m].
        v: their velocities (n, 3) [m/s].
        R_WO: their axes in the world (n, 3, 3).
        w_W: their angular velocities (n, 3) [rad/s].
    """

    p: Array
    v: Array
    R_WO: Array
    w_W: Array


@dataclass(frozen=True, eq=False)
class Touchdowns:
    """The flights of n bodies down to a height.

    Attributes:
        thing: the body.
        leaving: how they leave the tool.
        height_m: of what they are to land on; of the target, where that is in the air [m].
        is_in_air: whether there is nothing to touch: the centre passes the height.
        gravity: [m/s^2].
        drag: k of `planner.flight.drag_constant` [1/m].
    """

    thing: ThrownBody
    leaving: Leaving
    height_m: float
    is_in_air: bool
    gravity: float
    drag: float

    @cached_property
    def rotation(self) -> Rotation:
        """How the bodies turn, until the last centre is as low as a body that lies there, and a little longer."""
        p, v, R_WO, w_W = self.leaving
        times = landing_states(p, v, self.height_m, self.gravity, self.drag).time_s
        until_s = min(float(np.nan_to_num(times).max(initial=0.0)) + 0.1, AIRBORNE_MAX_S)
        return Rotation(R_WO, w_W, self.thing.inertia_kg_m2, until_s)

    @cached_property
    def falling_s(self) -> Array:
        """Time after the release from which each falls (n,) [s]: the apex without drag, which is later than with it."""
        return np.maximum(self.leaving.v[:, 2], 0.0) / self.gravity

    def centres(self, which: Index, s: Array) -> Array:
        """Returns the centres (k, 3) [m] of flights (k,) at times (k,) [s] after their release."""
        p, v, *_ = self.leaving
        return positions_after(p[which], v[which], s, self.gravity, self.drag)

    def lowest(self, which: Index, s: Array) -> Array:
        """Returns the heights (k,) [m] of what is to touch: the lowest point of the body, in the air its centre."""
        return self.centres(which, s)[:, 2] if self.is_in_air else self.lowest_point(which, s)

    def lowest_point(self, which: Index, s: Array) -> Array:
        """Returns the heights (k,) [m] of the lowest point of the body, also of one that passes in the air."""
        return self.centres(which, s)[:, 2] - self.thing.below(self.rotation.axes(which, s))

    def first_below(self, height_m: Array, from_s: Array, of_body: bool = False) -> Array:
        """Returns until when the flights (n,) stay above heights (n,) [m] from times (n,) on [s].

        At once where one begins below, infinite where it does not come down while it is followed. Each step is no
        longer than the greatest speed takes to the height, so that none passes a touch; `has_touched` tells whether
        the steps sufficed.

        Args:
            height_m, from_s: as above.
            of_body: whether the lowest point counts in any case, instead of what `lowest` tells.
        """
        lowest = self.lowest_point if of_body else self.lowest
        turning = self._turning
        up = self.leaving.v[:, 2] if self.drag <= 0.0 else np.minimum(self.leaving.v[:, 2], 0.0)
        s = from_s.astype(np.float64)
        rows = np.arange(len(s))
        for _ in range(STEPS_MAX):
            gap = lowest(rows, s[rows]) - height_m[rows]
            rows, gap = rows[gap > TOUCH_M], gap[gap > TOUCH_M]
            if len(rows) == 0:
                break
            # Nothing comes down faster than b + g x after the time x; the step is the root of b x + g x^2 / 2 = gap.
            b = np.maximum(self.gravity * s[rows] - up[rows], 0.0) + turning[rows]
            s[rows] += 2.0 * gap / (b + np.sqrt(b * b + 2.0 * self.gravity * gap))
            over = s[rows] > AIRBORNE_MAX_S
            s[rows[over]] = np.inf
            rows = rows[~over]
        return s

    def has_touched(self, height_m: Array, s: Array) -> Mask:
        """Returns which flights (n,) are down at heights (n,) [m] at times (n,) [s]."""
        known = np.flatnonzero(np.isfinite(s))
        down = np.zeros(len(s), np.bool_)
        down[known] = self.lowest(known, s[known]) <= height_m[known] + TOUCH_M
        return down

    @cached_property
    def _turning(self) -> Array:
        """Speeds of the farthest point about the centre (n,), at most [m/s]."""
        w_W = self.leaving.w_W
        inertia = self.thing.inertia_kg_m2
        spin = [fastest_turn(inertia, w) for w in np.linalg.norm(w_W, axis=1).tolist()]
        return self.thing.outer_radius_m * np.array(spin)

    @cached_property
    def time_s(self) -> Array:
        """Times of flight (n,) [s]; NaN where a body never lands, or is not wholly above the height at its apex."""
        heights = np.full(len(self.falling_s), self.height_m)
        found = self.first_below(heights, self.falling_s)
        rows = np.arange(len(heights))
        begins_above = self.lowest(rows, self.falling_s) >= heights - TOUCH_M
        return np.where(begins_above & self.has_touched(heights, found), found, np.nan)

    def axes_at(self, s: Array) -> Array:
        """Returns the axes (n, 3, 3) in the world at times (n,) [s]; NaN where that is none."""
        found = self.rotation.axes(np.arange(len(s)), np.nan_to_num(s))
        found[np.isnan(s)] = np.nan
        return found

    def centres_at(self, s: Array) -> Array:
        """Returns the centres (n, 3) [m] at times (n,) [s]; NaN where that is none."""
        found = self.centres(np.arange(len(s)), np.nan_to_num(s))
        found[np.isnan(s)] = np.nan
        return found
