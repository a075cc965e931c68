"""Whether the arm may stand in a posture at all: floor, boxes and itself, for many postures at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.cell import Cell
from planner.errors import Violation
from planner.geometry import (
    SELF_CLEARANCE_M,
    Capsule,
    body_capsules,
    capsule_endpoints,
    segment_box_distance,
    segment_segment_distance,
    self_collision_pairs,
)
from planner.kinematics import forward

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Clearances:
    """How far n postures stay inside each bound (n,) [m]; negative where they break it."""

    floor: Vector
    keep_in: Vector
    keep_out: Vector
    self_collision: Vector

    @property
    def least(self) -> Vector:
        """The smallest of the four (n,)."""
        return np.min([self.floor, self.keep_in, self.keep_out, self.self_collision], axis=0)

    def violations(self, row: int, cell: Cell) -> list[Violation]:
        """Returns which bounds posture `row` breaks at the release."""
        required = {
            "floor": cell.surroundings.clearance_m,
            "keep_in": 0.0,
            "keep_out": cell.surroundings.clearance_m,
            "self_collision": SELF_CLEARANCE_M,
        }
        return [
            Violation(name, float(getattr(self, name)[row] + limit), limit, "m", detail="at the release")
            for name, limit in required.items()
            if getattr(self, name)[row] < 0.0
        ]


def clearances(cell: Cell, q: Vector) -> Clearances:
    """Returns the clearances of postures `q` (n, 6) [rad], the object in the tool."""
    around, p_FT = cell.surroundings, cell.tool.X_FT[:3, 3]
    capsules = [*body_capsules(cell.robot, cell.tool.capsules), Capsule(6, p_FT, p_FT, cell.object.radius_m, "object")]
    ends = capsule_endpoints(cell.robot, capsules, q, cell.X_WB)
    radius = np.array([c.radius_m for c in capsules])
    moving = np.array([c.frame > 0 for c in capsules])
    floor = (ends[..., 2].min(axis=-1) - radius)[:, moving].min(axis=1) - around.floor_z_m - around.clearance_m
    return Clearances(
        floor, _inside(cell, q), _outside(cell, ends[:, moving], radius[moving]), _apart(cell, ends, radius)
    )


def _inside(cell: Cell, q: Vector) -> Vector:
    p = (cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT))[:, :3, 3]
    least = np.full(len(q), np.inf)
    for box in cell.surroundings.keep_in:
        least = np.minimum(least, np.minimum(p - box.lower, box.upper - p).min(axis=1))
    return least


def _outside(cell: Cell, ends: Vector, radius: Vector) -> Vector:
    least = np.full(len(ends), np.inf)
    for box in cell.surroundings.keep_out:
        gap = segment_box_distance(ends[..., 0, :], ends[..., 1, :], box.lower, box.upper) - radius
        least = np.minimum(least, gap.min(axis=1) - cell.surroundings.clearance_m)
    return least


def _apart(cell: Cell, ends: Vector, radius: Vector) -> Vector:
    pairs = np.array(self_collision_pairs(cell.robot, cell.tool.capsules), dtype=int).reshape(-1, 2)
    if len(pairs) == 0:
        return np.full(len(ends), np.inf)
    one, other = ends[:, pairs[:, 0]], ends[:, pairs[:, 1]]
    gap = segment_segment_distance(one[..., 0, :], one[..., 1, :], other[..., 0, :], other[..., 1, :])
    return (gap - radius[pairs[:, 0]] - radius[pairs[:, 1]]).min(axis=1) - SELF_CLEARANCE_M
