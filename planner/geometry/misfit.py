"""Whether a thrown object fits where it is to land: not within the floor, a keep-out shape or the arm's base."""

from __future__ import annotations

from typing import NamedTuple

from planner.arrays import Array
from planner.cell import CONTACT_M, Cell, Solid, ThrownBody
from planner.geometry.body import body_model
from planner.geometry.distances import point_segment_distance, segment_shape_distance
from planner.geometry.surfaces import footprint, landing_surfaces

WITHIN = "the target is within it"
UNDER = "the object does not fit under it"
BESIDE = "the object does not fit beside it"
BASE = "the arm's base"


class Misfit(NamedTuple):
    """By how much an object does not fit [m], beside what, and in words how."""

    lacking_m: float
    name: str
    how: str


def misfit(cell: Cell, p: Array) -> Misfit | None:
    """Returns what leaves the cell's object the least room at a target `p` (3,), None where it fits.

    The object comes to lie on what the target is on, see `landing_surfaces`; in the air it passes it with its centre.
    Of the arm's base, which the capsules exceed, the target itself counts alone where the object lies; of a body so
    does it everywhere, as it may lie in any way.
    """
    radius = 0.0 if isinstance(cell.object, ThrownBody) else cell.object.radius_m
    floor = cell.surroundings.floor_z_m
    surfaces = landing_surfaces(cell, p)
    centre = p.copy()
    lies = len(surfaces) > 0
    if lies:
        centre[2] = max(surface.height_m for surface in surfaces) + radius
    lacking = [Misfit(floor - float(p[2]), "floor", WITHIN)]
    for name, shape in zip(cell.surroundings.keep_out_names, cell.surroundings.keep_out, strict=True):
        beside = _beside_level_shape if shape.has_level_top else _beside_shape
        lacking.append(beside(shape, name, p, centre, radius))
    for start, end, thickness in zip(*body_model(cell).base_shapes, strict=True):
        within = float(thickness - point_segment_distance(p, start, end))
        lacking.append(Misfit(within, BASE, WITHIN))
        if not lies:
            lacking.append(Misfit(within + radius, BASE, BESIDE))
    most = max(lacking, key=lambda each: each.lacking_m)
    return most if most.lacking_m > CONTACT_M else None


def _beside_shape(shape: Solid, name: str, p: Array, centre: Array, radius: float) -> Misfit:
    """Returns how far a target is from where the object fits beside a shape that it cannot lie on; negative there."""
    within = float(shape.depth(p))
    if within >= 0.0:
        return Misfit(within + radius, name, WITHIN)
    return Misfit(radius - float(segment_shape_distance(centre, centre, shape)), name, BESIDE)


def _beside_level_shape(shape: Solid, name: str, p: Array, centre: Array, radius: float) -> Misfit:
    """Returns how far a target is from where the object fits: beside a shape, on top of it, or below it.

    Negative where it fits, as it does over a shape that ends at the target or below it.
    """
    sideways = float(footprint(shape).depth(p))
    up = float(shape.upper[2] - p[2])
    below = float(shape.lower[2] - p[2])
    if sideways >= 0.0 and up <= CONTACT_M:
        return Misfit(-radius, name, WITHIN)
    if sideways >= 0.0 and below <= CONTACT_M:
        return Misfit(min(sideways + radius, up), name, WITHIN)
    if sideways > 0.0:
        too_low = radius - float(shape.lower[2] - centre[2])
        return Misfit(min(sideways + radius, too_low), name, UNDER)
    lacking = radius - float(segment_shape_distance(centre, centre, shape))
    onto = -sideways if -radius < up <= CONTACT_M else lacking
    return Misfit(min(lacking, onto), name, BESIDE)
