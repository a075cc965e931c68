"""The flights of a body that is no ball: balls of its hull, which turn with it, until its own shape touches.

A body flies until, falling, its lowest point comes down to what it is to land on (docs/conventions.md, Tool and
object). Which instants may be its touch is bounded in patches of releases and times: where its lowest point may be as
low, and it had not surely touched before. What is demanded of the landing has to hold in all of these.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from planner.cell import ThrownBody
from verifier.elementary import Array, Mask
from verifier.flights import FlightPatches, Releases
from verifier.pieces import Index, Pieces
from verifier.spin import Spin, spin_of
from verifier.taylor import TaylorModel

UP = 1.0 + 1e-12


@dataclass(frozen=True, eq=False)
class BallReleases(Releases):
    """Releases of a body, and the flights of one ball of its hull.

    Attributes:
        centre: the same of its centre.
        place_m: of the ball, along the hull from the centre [m].
        height_m: of what the body lands on [m].
        is_in_air: whether that is nothing: its centre passes the height.
    """

    centre: Releases = None  # type: ignore[assignment]
    place_m: float = 0.0
    height_m: float = 0.0
    is_in_air: bool = False

    @property
    def thing(self) -> ThrownBody:
        """The body."""
        thing = self.cell.object
        assert isinstance(thing, ThrownBody)
        return thing

    @cached_property
    def spin(self) -> Spin:
        """How it turns."""
        return spin_of(self.cell, self.pieces)

    @cached_property
    def states(self) -> tuple[TaylorModel, TaylorModel]:
        """Places and velocities (3, n) of the centre as it leaves [m, m/s]."""
        return self.centre.states

    @property
    def bending(self) -> float:
        """Bound on the ball's acceleration [m/s^2]."""
        turns = float(np.max(self.spin.bending, initial=0.0))
        return (self.centre.bending + abs(self.place_m) * turns) * UP

    @property
    def slowing(self) -> float:
        """Bound on the rate at which an upward speed of the centre shrinks [m/s^2]."""
        return self.centre.slowing

    @property
    def bends_down(self) -> bool:
        """Whether the ball's path bends downwards at any time: nobody knows."""
        return False

    def of(self, pieces: Pieces) -> BallReleases:
        """Returns other pieces of the same."""
        return BallReleases(
            self.cell, pieces, self.finer, self.centre.of(pieces), self.place_m, self.height_m, self.is_in_air
        )

    def ball(self, place_m: float) -> BallReleases:
        """Returns the same of another ball."""
        found = replace(self, place_m=place_m)
        found.__dict__.update(spin=self.spin, _known=self._known)
        return found

    @cached_property
    def _known(self) -> dict[tuple[str, bytes, bytes], Any]:
        """What was asked of the centre and of the rotation, which all balls have in common."""
        return {}

    def _asked(self, what: str, rows: Index, s: Array, answer: Callable[[], Any]) -> Any:
        key = what, rows.tobytes(), s.tobytes()
        if key not in self._known:
            self._known[key] = answer()
        return self._known[key]

    def at(self, rows: Index, s: Array) -> TaylorModel:
        """Returns places (3, m) [m] of the ball."""
        x = self._asked("centre", rows, s, lambda: self.centre.at(rows, s))
        if self.place_m == 0.0:
            return x
        axis = int(np.abs(self.thing.hull_axis_O).argmax())
        u = self._asked("hull", rows, s, lambda: self.spin.axes(rows, s, (axis,))[0])
        return x + u * (self.place_m * float(self.thing.hull_axis_O[axis]))

    def lowest(self, rows: Index, s: Array, of_body: bool = False) -> tuple[Array, Array]:
        """Returns bounds (m,) [m] on the height of what touches: the body's lowest point, in the air its centre.

        Args:
            rows, s: as of `at`.
            of_body: whether the lowest point counts in any case.
        """
        if self.is_in_air and not of_body:
            z = self._asked("centre", rows, s, lambda: self.centre.at(rows, s))[2]
            return z.lower, z.upper
        return self._asked("lowest", rows, s, lambda: self._lowest_point(rows, s))

    def _lowest_point(self, rows: Index, s: Array) -> tuple[Array, Array]:
        z = self._asked("centre", rows, s, lambda: self.centre.at(rows, s))[2]
        least, most = self._below(rows, s)
        return z.lower - most * UP, z.upper - least / UP

    def _below(self, rows: Index, s: Array) -> tuple[Array, Array]:
        """Returns bounds (m,) [m] on how far it reaches below its centre: supports of box, cylinder and capsule."""
        half = 0.5 * self.thing.size_m
        which = (0, 1, 2) if self.thing.kind == "box" else (2,)
        up = [u[2] for u in self.spin.axes(rows, s, which)]
        least = [np.maximum(np.maximum(z.lower, -z.upper), 0.0) for z in up]
        most = [np.minimum(np.maximum(z.upper, -z.lower), 1.0) for z in up]
        if self.thing.kind == "box":
            both = (sum(h * z for h, z in zip(half, each, strict=True)) for each in (least, most))
        elif self.thing.kind == "capsule":
            both = ((half[2] - half[0]) * each + half[0] for each in (least[0], most[0]))
        else:
            across = [np.sqrt(np.maximum(1.0 - z * z, 0.0)) for z in (most[0], least[0])]
            both = (half[2] * z + half[0] * c for z, c in zip((least[0], most[0]), across, strict=True))
        low, high = both
        return np.asarray(low), np.asarray(high)

    def counts(self, patches: FlightPatches, ends_z: float) -> Mask:
        """Returns which patches (m,) count: of all others the body has surely touched before, falling."""
        return ~(patches.falls & (self.lowest(patches.rows, patches.s0)[1] < self.height_m))


def lowest_in(patches: FlightPatches, of_body: bool = False) -> Array:
    """Returns lower bounds (m,) [m] on the height of what touches, all along patches of a body.

    Every point of it bends by no more than it accelerates; of points above two heights none is below the lower one.
    """
    releases = patches.releases
    assert isinstance(releases, BallReleases)
    ends = [releases.lowest(patches.rows, s, of_body)[0] for s in (patches.s0, patches.s1)]
    h = patches.s1 - patches.s0
    turns = releases.thing.outer_radius_m * releases.spin.bending[patches.rows]
    return np.minimum(*ends) - (releases.centre.bending + turns) * h * h / 8.0 * UP


def may_touch(patches: FlightPatches) -> Mask:
    """Returns which patches (m,) may hold an instant at which the body first touches what it is to land on."""
    releases = patches.releases
    assert isinstance(releases, BallReleases)
    is_above = lowest_in(patches) > releases.height_m  # not a number is neither: it may touch
    return ~patches.rises & ~is_above & releases.counts(patches, 0.0)
