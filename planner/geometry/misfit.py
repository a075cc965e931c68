"""Whether a thrown object fits where it is to land: not within the floor, a keep-out box or the arm's base."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.cell import CONTACT_M, Box, Cell
from planner.geometry.body import body_model
from planner.geometry.distances import point_segment_distance, segment_box_distance

WITHIN, UNDER, BESIDE = (
    "the target is within it",
    "the object does not fit under it",
    "the object does not fit beside it",
)
BASE = "the arm's base"


class Misfit(NamedTuple):
    """By how much an object does not fit [m], beside what, and in words how."""

    lacking_m: float
    name: str
    how: str


def misfit(cell: Cell, p: Array) -> Misfit | None:
    """Returns what leaves the cell's object the least room at a target `p` (3,), None where it fits.

    The object lies on the floor with its lowest point on the target; in the air it passes it with its centre. A box
    that ends at the target or below it may carry the object. Of the arm's base, which the capsules exceed, the target
    itself counts alone.
    """
    radius, floor = cell.object.radius_m, cell.surroundings.floor_z_m
    centre = p + np.array([0.0, 0.0, radius if p[2] <= floor + CONTACT_M else 0.0])
    lacking = [Misfit(floor - float(p[2]), "floor", WITHIN)]
    for name, box in zip(cell.surroundings.keep_out_names, cell.surroundings.keep_out, strict=True):
        lacking.append(_beside_box(box, name, p, centre, radius))
    for start, end, thickness in zip(*body_model(cell).base_shapes, strict=True):
        lacking.append(Misfit(float(thickness - point_segment_distance(p, start, end)), BASE, WITHIN))
    most = max(lacking, key=lambda each: each.lacking_m)
    return most if most.lacking_m > CONTACT_M else None


def _beside_box(box: Box, name: str, p: Array, centre: Array, radius: float) -> Misfit:
    """Returns how far a target is from where the object fits: from the box's sides and top, or from below it."""
    sideways, up = float(np.minimum(p - box.lower, box.upper - p)[:2].min()), float(box.upper[2] - p[2])
    below = float(box.lower[2] - p[2])
    is_under = below > CONTACT_M
    over = Misfit(min(sideways, 2.0 * radius - below if is_under else up), name, UNDER if is_under else WITHIN)
    if over.lacking_m > CONTACT_M or up <= CONTACT_M:
        return over
    gap = float(segment_box_distance(centre, centre, box.lower, box.upper)) - radius
    return Misfit(-gap, name, BESIDE)
