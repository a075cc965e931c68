"""Whether ways through joint space keep clear of floor, boxes and the arm itself.

A way is a row of positions; between two neighbours every joint is taken to stay between theirs. A distance f that
changes by at most L obeys f >= (f0 + f1 - L) / 2 in between, with L the sum of each joint's turn times how far the
body's points are from its axis. That is coarser than the certificate's proof, and never more permissive.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from planner.cell import Cell
from planner.certificate.bounds import levers
from planner.geometry import (
    SELF_CLEARANCE_M,
    Capsule,
    body_capsules,
    segment_box_distance,
    segment_segment_distance,
    self_collision_pairs,
)
from planner.kinematics import link_poses

Vector = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ends = tuple[Vector, Vector]
Distance = tuple[str, Vector, Vector, float]  # label, distance (M, U) [m], levers (6,) [m], required [m]


class Space:
    """One cell's arm, tool, held object and surroundings."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        p_FT = cell.tool.X_FT[:3, 3]
        thing = Capsule(frame=6, p0=p_FT, p1=p_FT, radius_m=cell.object.radius_m, name="object")
        self.body = body_capsules(cell.robot, cell.tool.capsules)
        self.capsules = [*self.body, thing]
        self.pairs = self_collision_pairs(cell.robot, cell.tool.capsules)

    def keeps_clear(self, ways: Vector) -> Flags:
        """Returns for ways (M, U, 6) [rad] whether each keeps every clearance (M,)."""
        return self.what_is_hit(ways)[0]

    def what_is_hit(self, ways: Vector) -> tuple[Flags, str]:
        """Returns for ways (M, U, 6) whether each keeps clear (M,), and the name of the first check that fails."""
        X_WL = self.cell.X_WB @ link_poses(self.cell.robot, ways)
        ends = [self._ends(X_WL, capsule) for capsule in self.capsules]
        turns = np.abs(np.diff(ways, axis=1))
        clear, name = np.ones(len(ways), bool), ""
        for label, distance, lever, required in self._distances(X_WL, ends):
            least = (distance[:, :-1] + distance[:, 1:] - turns @ lever) / 2.0
            kept = (least >= required).all(axis=1) & (distance >= required).all(axis=1)
            name = name or ("" if kept.all() else label)
            clear &= kept
        return clear, name

    def _distances(self, X_WL: Vector, ends: list[Ends]) -> Iterator[Distance]:
        """Yields label, distance (M, U) [m], lever of each joint (6,) [m] and what is required [m]."""
        around = self.cell.surroundings
        for capsule, (p0, p1) in zip(self.capsules, ends, strict=True):
            if capsule.frame == 0:
                continue
            lever = self._lever(capsule)
            height = np.minimum(p0[..., 2], p1[..., 2]) - capsule.radius_m - around.floor_z_m
            yield f"{capsule.name} and the floor", height, lever, around.clearance_m
            for i, box in enumerate(around.keep_out):
                gap = segment_box_distance(p0, p1, box.lower, box.upper) - capsule.radius_m
                yield f"{capsule.name} and keep-out box {i}", gap, lever, around.clearance_m
        yield from self._inside(ends[-1][0])
        for first, second in self.pairs:
            one, other = self.body[first], self.body[second]
            gap = segment_segment_distance(*ends[first], *ends[second]) - one.radius_m - other.radius_m
            lever = self._lever(one if one.frame > other.frame else other)
            lever[: min(one.frame, other.frame)] = 0.0
            yield f"{one.name} and {other.name}", gap, lever, SELF_CLEARANCE_M

    def _inside(self, p: Vector) -> Iterator[Distance]:
        lever = self._lever(self.capsules[-1])
        for i, box in enumerate(self.cell.surroundings.keep_in):
            inside = np.minimum(p - box.lower, box.upper - p).min(axis=-1)
            yield f"the tool and keep-in box {i}", inside, lever, 0.0

    def _lever(self, capsule: Capsule) -> Vector:
        reach = max(float(np.linalg.norm(capsule.p0)), float(np.linalg.norm(capsule.p1)))
        return levers(self.cell.robot, capsule.frame, reach)

    def _ends(self, X_WL: Vector, capsule: Capsule) -> Ends:
        X = X_WL[..., capsule.frame, :, :]
        R, p = X[..., :3, :3], X[..., :3, 3]
        return R @ capsule.p0 + p, R @ capsule.p1 + p
