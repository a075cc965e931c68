"""What the object lands on, and how near it may come to what is beside that (docs/conventions.md, Tool and object)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from planner.cell import Cell, Solid, ThrownBody
from verifier.elementary import Array, Mask
from verifier.plan_document import Demands
from verifier.solids import from_solid

UPRIGHT = 1.0 - 1e-8  # [-] cosine of the slope of a top that is level
CONTACT_M = 1e-6  # [m] rounding: a top that is higher than the target by less still carries it
LEVEL_M = 1e-3  # [m] tops that differ by less are one surface. source: docs/conventions.md
LEAST_CLEARANCE_M = 1e-3  # [m] source: docs/cells.md: a shape's own clearance is no less for what flies


@dataclass(frozen=True)
class LandingTop:
    """The level top of a solid: its height [m], a place in its middle, its sides, and half of these (2,) [m].

    Attributes:
        height_m: its height.
        centre: (2,) [m].
        sides: unit vectors along the sides (2, 2), one a row.
        half: half the sides, or twice the radius of a disc (2,) [m].
        is_round: whether it is a disc.
    """

    height_m: float
    centre: Array
    sides: Array
    half: Array
    is_round: bool

    def depth(self, x: Array) -> Array:
        """Returns how far within its outline points (2, ...) are (...) [m], to rounding; negative beside it."""
        y = np.tensordot(self.sides, x - self.centre.reshape(2, *[1] * (x.ndim - 1)), 1)
        if self.is_round:
            return self.half[0] - np.hypot(y[0], y[1])
        return np.min(self.half.reshape(2, *[1] * (x.ndim - 1)) - np.abs(y), axis=0)


def level_top(solid: Solid) -> LandingTop | None:
    """Returns the level top of a solid: of a box with a face above, or an upright cylinder; None without one."""
    R = solid.X_WC[:3, :3]
    half = 0.5 * solid.extent
    axis = int(np.abs(R[2]).argmax())
    if abs(R[2, axis]) < UPRIGHT or solid.kind in ("sphere", "capsule") or (solid.kind == "cylinder" and axis != 2):
        return None
    across = [i for i in range(3) if i != axis]
    height = float(solid.X_WC[2, 3] + half[axis])
    return LandingTop(height, solid.X_WC[:2, 3], R[:2, across].T, half[across], solid.kind == "cylinder")


@dataclass(frozen=True, eq=False)
class LandingPlace:
    """What a flight ends on.

    Attributes:
        plane_z: height at which the centre is at the target [m].
        height_m: of what the object lands on [m]; None in the air.
        tops: the tops that it may touch; none where that is the floor, or in the air.
        ends_z: height of the centre at which a flight is over [m]: its touch; in the air the plane.
        carries: which solids (b,) it lands on, or lie below those.
        clearances: what the object in flight keeps from each solid (b,) [m].
        fits: whether the object fits at the target.
        target: place of the centre as it lies at the target (3,) [m]; None without one.
        spare_m: of the room that it has there, what does not count: its radius and the landing tolerance [m].
        shift: what flights are aimed beside it (3,) [m]: the object lies as far from where they land.
    """

    plane_z: float
    height_m: float | None
    tops: tuple[LandingTop, ...]
    ends_z: float
    carries: Mask
    clearances: Array
    fits: bool
    target: Array | None = None
    spare_m: float = 0.0
    shift: Array = field(default_factory=lambda: np.zeros(3))


def landing_place(cell: Cell, demands: Demands) -> LandingPlace:
    """Returns what the object lands on: at its target, or without one on the floor."""
    around = cell.surroundings
    radius = cell.object.radius_m
    own = [around.flight_clearance_m if s.clearance_m is None else s.clearance_m for s in around.keep_out]
    own = [c if s.clearance_m is None else max(c, LEAST_CLEARANCE_M) for c, s in zip(own, around.keep_out, strict=True)]
    if demands.aim is None:
        floor = around.floor_z_m
        carried = np.array([_is_below(solid, floor) for solid in around.keep_out], bool)
        return LandingPlace(floor, floor, (), floor + radius, carried, np.where(carried, 0.0, own), fits=True)
    p = demands.aim.p_W
    stands = demands.aim.stands
    height, tops, carries = _carriers(cell, p)
    ends_z = float(p[2]) if height is None else height + cell.object.inner_radius_m
    centre = np.array([stands[0], stands[1], ends_z])
    rooms = np.array([_distance(centre, solid) for solid in around.keep_out])
    spare = cell.object.outer_radius_m + (demands.aim.tolerance_m if demands.aim.is_robust else 0.0)
    beside = np.minimum(0.5 * np.maximum(rooms - spare, 0.0), np.array(own))
    least = 0.0 if isinstance(cell.object, ThrownBody) else radius  # nobody knows how a body comes to lie
    fits = bool((carries | (rooms >= least - CONTACT_M)).all()) and float(p[2]) >= around.floor_z_m - CONTACT_M
    return LandingPlace(
        float(p[2]),
        height,
        tops,
        ends_z,
        carries,
        np.where(carries, 0.0, beside),
        fits,
        centre,
        spare,
        demands.aim.shift,
    )


def _distance(x: Array, solid: Solid) -> float:
    return float(np.linalg.norm(from_solid(x[:, None], solid)))


def _is_below(solid: Solid, height: float) -> bool:
    return bool(solid.upper[2] <= height + LEVEL_M)


def _carriers(cell: Cell, p: Array) -> tuple[float | None, tuple[LandingTop, ...], Mask]:
    """Returns height and tops of what a target (3,) is on, and which solids (b,) carry it, or lie below those."""
    around = cell.surroundings
    lowest = float(p[2]) - max(cell.object.inner_radius_m, CONTACT_M)
    tops = [level_top(solid) for solid in around.keep_out]
    under = [
        top
        for top in tops
        if top is not None and lowest < top.height_m <= p[2] + CONTACT_M and float(top.depth(p[:2])) >= 0.0
    ]
    height = max((top.height_m for top in under), default=None)
    none = np.zeros(len(tops), bool)
    if lowest < around.floor_z_m and (height is None or height <= around.floor_z_m + LEVEL_M):
        floor = min(around.floor_z_m, float(p[2]))
        return floor, (), np.array([_is_below(solid, floor) for solid in around.keep_out], bool)
    if height is None:
        return None, (), none
    touched = [top for top in under if top.height_m > height - LEVEL_M]
    near = [top for top in tops if top is not None and any(_adjoins(top, other, height) for other in touched)]
    carries = [
        (top is not None and any(top is other for other in near)) or _is_under(solid, near, height)
        for solid, top in zip(around.keep_out, tops, strict=True)
    ]
    return height, tuple(near), np.array(carries, bool)


def _corners(top: LandingTop) -> Array:
    """Returns the corners (2, 4) of the rectangle about a top [m]."""
    signs = np.array([[-1.0, -1.0, 1.0, 1.0], [-1.0, 1.0, -1.0, 1.0]])
    return top.centre[:, None] + top.sides.T @ (top.half[:, None] * signs)


def _adjoins(top: LandingTop, other: LandingTop, height: float) -> bool:
    """Returns whether a top is another one, or beside it and as high, both rectangles along the axes."""
    if top is other:
        return True
    is_straight = all(not t.is_round and bool((np.abs(t.sides).max(axis=1) > UPRIGHT).all()) for t in (top, other))
    if not is_straight or abs(top.height_m - height) > LEVEL_M:
        return False
    one, two = _corners(top), _corners(other)
    gap = np.maximum(one.min(axis=1) - two.max(axis=1), two.min(axis=1) - one.max(axis=1))
    return bool((gap <= CONTACT_M).all())


def _is_under(solid: Solid, tops: list[LandingTop], height: float) -> bool:
    """Returns whether a solid is lower than a top and within its outline."""
    corners = np.array(
        [[solid.lower[0], solid.lower[0], solid.upper[0], solid.upper[0]], [*solid.lower[[1]], *solid.upper[[1]]] * 2]
    )
    return _is_below(solid, height) and any(bool((top.depth(corners) >= -CONTACT_M).all()) for top in tops)
