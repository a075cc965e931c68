"""Checks of the clearance of arm, tool and held object to the floor, to solids, and to one another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from planner.cell import Cell, Solid, Surroundings, shape_of
from verifier.aims import BEFORE_S, Aim
from verifier.arm import JOINTS, ArmPieces
from verifier.capsules import OBJECT, MovingCapsule, capsules_of
from verifier.elementary import Array, Mask
from verifier.finding import Finding, Rooms, prove
from verifier.held_objects import HeldObject
from verifier.motion_parts import MotionPart
from verifier.plan_document import Demands
from verifier.solids import (
    SELF_CLEARANCE_M,
    ArmEnds,
    apart_between,
    apart_from_solid,
    apart_in_middle,
    from_solid,
    judged_pairs,
    nearest_on_segments,
    out_of_solid,
    support,
    toward,
)
from verifier.taylor import dot

BOX_ROUNDING_M = 1e-12  # [m] of a difference of coordinates below 100 m: ten times what IEEE 754 rounds away
LENGTH_M = 1e-6  # [m] by which a clearance may be missed: a hundredth of what a hand can measure in a cell


class HeldCapsules:
    """Capsules of arm and tool, and of what its grippers hold, each as long as it may be held.

    Attributes:
        capsules: all of them, the objects last.
        pairs: indices of those that must stay apart.
    """

    def __init__(self, objects: Sequence[HeldObject]) -> None:
        """Takes what is held: one object at least."""
        self.capsules = capsules_of(objects[0].cell)[:-1]
        self.pairs: list[tuple[int, int]] = []
        self._held: dict[str, HeldObject] = {}
        arm = len(self.capsules)
        for each in objects:
            ball = replace(capsules_of(each.cell)[-1], name=each.called)
            pairs = [pair for pair in judged_pairs(each.cell) if not self._held or pair[1] == arm]
            self.pairs += [(i, len(self.capsules) if j == arm else j) for i, j in pairs]
            self.capsules.append(ball)
            self._held[ball.name] = each

    @property
    def moving(self) -> list[MovingCapsule]:
        """Those that the first joint moves."""
        return [c for c in self.capsules if c.frame > 0]

    def may_touch(self, around: Surroundings, capsule: MovingCapsule, name: str) -> bool:
        """Returns whether a capsule may touch a solid of a name; of every object that is so which one may touch."""
        return around.is_free_to_touch(OBJECT if capsule.name in self._held else capsule.name, name)

    def is_away(self, capsule: MovingCapsule, arm: ArmPieces) -> Mask:
        """Returns in which pieces (n,) a capsule is not there any more: its object has surely left."""
        held = self._held.get(capsule.name)
        return np.zeros(len(arm.pieces.tick), bool) if held is None else ~held.may_be_held(arm.pieces)


def clearance_findings(
    cell: Cell, parts: Sequence[MotionPart], objects: Sequence[HeldObject], arm: ArmPieces
) -> Iterator[Finding]:
    """Returns the findings about clearances."""
    held = HeldCapsules(objects)
    moving = held.moving
    yield prove("floor", arm, _floor(cell, held), [c.name for c in moving])
    if cell.surroundings.keep_in:
        names = [f"{name}{part.of}" for part in parts for name in cell.surroundings.keep_in_names for _ in range(3)]
        yield prove("keep_in", arm, _keep_in(cell.surroundings.keep_in, [part.p_FT for part in parts]), names)
    if solids := obstacles(cell, [part.demands for part in parts]):
        around = cell.surroundings
        pairs = [(c, *each) for each in solids for c in moving if not held.may_touch(around, c, each[2])]
        names = [f"{c.name}, {name}" for c, _, _, name in pairs]
        yield prove("keep_out", arm, _keep_out([pair[:3] for pair in pairs], held), names)
    names = [f"{held.capsules[i].name}, {held.capsules[j].name}" for i, j in held.pairs]
    yield prove("self_collision", arm, _self_collision(held), names)


def obstacles(cell: Cell, demands: Sequence[Demands]) -> list[tuple[Solid, float, str]]:
    """Returns the solids that nothing enters, the bins of a request full, with clearance [m] and name."""
    around = cell.surroundings
    found = [
        (solid, around.clearance_m if solid.clearance_m is None else solid.clearance_m, name)
        for solid, name in zip(around.keep_out, around.keep_out_names, strict=True)
    ]
    bins = [_bin(each.aim) for each in demands if each.aim is not None and each.aim.bin is not None]
    return [*found, *((solid, around.clearance_m, "bin") for solid in bins)]


def _bin(aim: Aim) -> Solid:
    """Returns a bin as a full cylinder; of one that moves, a box along its way while the arm keeps out of it."""
    assert aim.bin is not None
    radius, rim = aim.bin
    X_WC = np.eye(4)
    X_WC[:3, 3] = aim.stands + np.array([0.0, 0.0, 0.5 * rim])
    speed = float(np.linalg.norm(aim.v_W))
    if speed == 0.0:
        return shape_of("cylinder", X_WC, np.array([radius, rim]))
    along = aim.v_W / speed
    X_WC[:3, :3] = np.column_stack([along, [-along[1], along[0], 0.0], [0.0, 0.0, 1.0]])
    X_WC[:3, 3] += 0.5 * (aim.after_s - BEFORE_S) * aim.v_W
    length = speed * (BEFORE_S + aim.after_s) + 2.0 * (radius + aim.slack_m)
    return shape_of("box", X_WC, np.array([length, 2.0 * radius, rim]))


def _floor(cell: Cell, held: HeldCapsules) -> Rooms:
    least = cell.surroundings.floor_z_m + cell.surroundings.clearance_m - LENGTH_M
    capsules = held.moving

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        ends = ArmEnds(arm, capsules).models
        lower = [np.min([end[2].lower for end in pair], axis=0) for pair in ends]
        upper = [np.min([end[2].upper for end in pair], axis=0) for pair in ends]
        thick = np.array([c.radius_m for c in capsules])[:, None] + least
        out = np.array([held.is_away(c, arm) for c in capsules])
        return np.where(out, np.inf, np.array(lower) - thick), np.where(out, np.inf, np.array(upper) - thick)

    return rooms


def _keep_in(solids: Sequence[Solid], places: Sequence[Array]) -> Rooms:
    """Returns how deep points (3,) of the flange are in solids, three numbers each: in m, of what is round in m^2."""

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        lower: list[Array] = []
        upper: list[Array] = []
        points = [arm.point(JOINTS, place) for place in places]
        for p, solid in product(points, solids):
            y = [dot(solid.X_WC[:3, i, None], p - solid.X_WC[:3, 3, None]) for i in range(3)]
            walls = 0.5 * solid.extent - (solid.clearance_m or 0.0) + LENGTH_M
            flat = {"box": (0, 1, 2), "cylinder": (2,)}.get(solid.kind, ())
            for i in range(3):
                if i in flat:
                    lower.append(walls[i] - np.maximum(y[i].upper, -y[i].lower))
                    upper.append(walls[i] - np.maximum(np.maximum(y[i].lower, -y[i].upper), 0.0))
                else:
                    straight = 0.5 * (solid.extent[2] - solid.extent[0])
                    level = solid.kind == "cylinder"
                    z = y[2] * 0.0 if level else y[2] - np.clip(y[2].c0, -straight, straight)
                    off = y[0] * y[0] + y[1] * y[1] + z * z
                    room = walls[0] * abs(walls[0])  # where the clearance leaves none, nothing is inside
                    lower.append(room - off.upper)
                    upper.append(room - off.lower)
        return np.array(lower), np.array(upper)

    return rooms


def _keep_out(pairs: Sequence[tuple[MovingCapsule, Solid, float]], held: HeldCapsules) -> Rooms:
    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        ends = {}
        for capsule, _, _ in pairs:
            if capsule.name not in ends:
                ends[capsule.name] = ArmEnds(arm, [capsule])
        found = []
        for capsule, solid, clearance in pairs:
            lower, upper = _from_solid(ends[capsule.name], solid, capsule.radius_m + clearance - LENGTH_M)
            away = held.is_away(capsule, arm)
            found.append((np.where(away, np.inf, lower), np.where(away, np.inf, upper)))
        return np.array([lower for lower, _ in found]), np.array([upper for _, upper in found])

    return rooms


def _from_solid(ends: ArmEnds, solid: Solid, thick: float) -> tuple[Array, Array]:
    """Returns bounds (n,) on what a capsule's axis is farther from a solid than `thick` [m].

    First by the boxes along the axes about both. Where they do not decide, the direction from its middle does, and
    where that does not, the one from its nearest point.
    """
    models, middles = ends.models[0], ends.middles[0]
    lower = np.asarray(_between_boxes(ends, solid) - thick)
    upper = np.full_like(lower, np.inf)
    close = np.flatnonzero(~(lower >= 0.0))
    if len(close):
        near = [end[:, close] for end in models]
        lower[close] = (
            apart_from_solid(near, solid, toward(from_solid(middles[..., close].mean(axis=0), solid))) - thick
        )
        close = close[~(lower[close] >= 0.0)]
    if len(close):
        near = [end[:, close] for end in models]
        out = out_of_solid(middles[..., close], solid)
        lower[close] = apart_from_solid(near, solid, toward(out)) - thick
        upper[close] = apart_in_middle(out, near) - thick
    return lower, upper


def _between_boxes(ends: ArmEnds, solid: Solid) -> Array:
    """Returns the largest gaps (n,) [m] along an axis between boxes about a capsule's axis and a solid."""
    low, high = ends.boxes[0]
    axes = np.eye(3)
    above, below = support(solid, axes), -support(solid, -axes)
    return np.maximum(below[:, None] - high, low - above[:, None]).max(axis=0) - BOX_ROUNDING_M


def _self_collision(held: HeldCapsules) -> Rooms:
    capsules = held.capsules

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        ends = ArmEnds(arm, capsules)
        lower, upper = [], []
        for i, j in held.pairs:
            a, b = nearest_on_segments(ends.middles[i], ends.middles[j])
            thick = capsules[i].radius_m + capsules[j].radius_m + SELF_CLEARANCE_M - LENGTH_M
            out = held.is_away(capsules[j], arm)
            apart = apart_between(ends.models[i], ends.models[j], toward(a - b)) - thick
            most = apart_in_middle(a - b, [*ends.models[i], *ends.models[j]]) - thick
            lower.append(np.where(out, np.inf, apart))
            upper.append(np.where(out, np.inf, most))
        return np.array(lower), np.array(upper)

    return rooms
