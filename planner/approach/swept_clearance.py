"""Whether ways through joint space keep clear of floor, boxes and the arm itself, between the looked-at positions too.

Between two positions a point strays from its chord by at most sup|p''| h^2 / 8, which the joints' turns and bends bound
(planner.certificate.bounds). A height then is at least the lower end less that; a distance d at least
(d0 + d1 - |p1 - p0|) / 2 less that; the gap of two links at least (d0 + d1 - L) / 2, with L the turns of the joints
between them times their levers. That is coarser than the certificate's proof, and never more permissive.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.cell import Cell
from planner.certificate.bounds import Rates, levers, point_acceleration
from planner.geometry import (
    SELF_CLEARANCE_M,
    Capsule,
    body_capsules,
    segment_box_distance,
    segment_segment_distance,
    self_collision_pairs,
)
from planner.kinematics import link_poses

ON_AXIS_M = 1e-9  # [m] rounding

Vector = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ends = tuple[Vector, Vector]
Bound = tuple[str, Vector, Vector, float]  # label, values (M, U) [m], least between (M, U-1) [m], required [m]


@dataclass(frozen=True, eq=False)
class Ways:
    """Ways (M) of positions (U).

    Attributes:
        q: (M, U, 6) [rad].
        turn: how far each joint turns from one position to the next at most (M, U-1, 6) [rad].
        bend: its acceleration there times the time between, squared (M, U-1, 6) [rad]; 0 on a straight way.
    """

    q: Vector
    turn: Vector
    bend: Vector

    @classmethod
    def straight(cls, q: Vector) -> Ways:
        """Returns ways that are straight, and evenly gone along, between their positions (M, U, 6)."""
        turn = np.abs(np.diff(q, axis=1))
        return cls(q, turn, np.zeros_like(turn))


class Space:
    """One cell's arm, tool, held object and surroundings."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        p_FT = cell.tool.X_FT[:3, 3]
        thing = Capsule(frame=6, p0=p_FT, p1=p_FT, radius_m=cell.object.radius_m, name="object")
        self.body = body_capsules(cell.robot, cell.tool.capsules)
        self.capsules = [*self.body, thing]
        self.pairs = self_collision_pairs(cell.robot, cell.tool.capsules)

    def judge(self, ways: Ways) -> tuple[Flags, str]:
        """Returns for every way whether it keeps clear (M,), and what the first that does not would hit."""
        clear, name = np.ones(len(ways.q), bool), ""
        for label, values, between, required in self._bounds(ways):
            kept = (between >= required).all(axis=1) & (values >= required).all(axis=1)
            name = name or ("" if kept.all() else label)
            clear &= kept
        return clear, name

    def _bounds(self, ways: Ways) -> Iterator[Bound]:
        X_WL = self.cell.X_WB @ link_poses(self.cell.robot, ways.q)
        ends = [_ends(X_WL, capsule) for capsule in self.capsules]
        for capsule, both in zip(self.capsules, ends, strict=True):
            if capsule.frame > 0:
                stray = self._stray(capsule, ways)
                yield self._above_floor(capsule, both, stray)
                yield from self._outside(capsule, both, stray)
        yield from self._inside(ends[-1][0], self._stray(self.capsules[-1], ways))
        for first, second in self.pairs:
            yield self._apart(self.body[first], self.body[second], (*ends[first], *ends[second]), ways)

    def _stray(self, capsule: Capsule, ways: Ways) -> Vector:
        """Returns how far the capsule's points stray from their chords at most (M, U-1) [m]."""
        turn, bend = ways.turn.reshape(-1, 6).T, ways.bend.reshape(-1, 6).T
        rates = Rates(turn, bend, np.zeros_like(turn))
        return point_acceleration(self._lever(capsule), rates).reshape(ways.turn.shape[:2]) / 8.0

    def _above_floor(self, capsule: Capsule, ends: Ends, stray: Vector) -> Bound:
        around = self.cell.surroundings
        height = np.minimum(ends[0][..., 2], ends[1][..., 2]) - capsule.radius_m - around.floor_z_m
        return f"{capsule.name} and the floor", height, _lower(height) - stray, around.clearance_m

    def _outside(self, capsule: Capsule, ends: Ends, stray: Vector) -> Iterator[Bound]:
        around = self.cell.surroundings
        if not around.keep_out:
            return
        moved = np.max([np.linalg.norm(np.diff(p, axis=1), axis=-1) for p in ends], axis=0)
        for i, box in enumerate(around.keep_out):
            gap = segment_box_distance(*ends, box.lower, box.upper) - capsule.radius_m
            between = (gap[:, :-1] + gap[:, 1:] - moved) / 2.0 - stray
            yield f"{capsule.name} and keep-out box {i}", gap, between, around.clearance_m

    def _inside(self, p: Vector, stray: Vector) -> Iterator[Bound]:
        for i, box in enumerate(self.cell.surroundings.keep_in):
            inside = np.minimum(p - box.lower, box.upper - p).min(axis=-1)
            yield f"the tool and the wall of keep-in box {i}", inside, _lower(inside) - stray, 0.0

    def _apart(self, one: Capsule, other: Capsule, ends: tuple[Vector, ...], ways: Ways) -> Bound:
        gap = segment_segment_distance(*ends) - one.radius_m - other.radius_m
        near, far = sorted((one, other), key=lambda c: c.frame)
        lever = self._lever(far)
        lever[: near.frame + _is_round(near)] = 0.0
        between = (gap[:, :-1] + gap[:, 1:] - (ways.turn + ways.bend) @ lever) / 2.0
        return f"{one.name} and {other.name}", gap, between, SELF_CLEARANCE_M

    def _lever(self, capsule: Capsule) -> Vector:
        reach = max(float(np.linalg.norm(capsule.p0)), float(np.linalg.norm(capsule.p1)))
        return levers(self.cell.robot, capsule.frame, reach)


def _ends(X_WL: Vector, capsule: Capsule) -> Ends:
    X = X_WL[..., capsule.frame, :, :]
    return X[..., :3, :3] @ capsule.p0 + X[..., :3, 3], X[..., :3, :3] @ capsule.p1 + X[..., :3, 3]


def _is_round(capsule: Capsule) -> bool:
    """Whether turning the next joint, about the capsule's own axis, leaves it as it is."""
    return max(np.hypot(*capsule.p0[:2]), np.hypot(*capsule.p1[:2])) < ON_AXIS_M


def _lower(values: Vector) -> Vector:
    """Returns the lower of each two neighbours (M, U-1)."""
    return np.minimum(values[:, :-1], values[:, 1:])
