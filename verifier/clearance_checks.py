"""Checks of the clearance of arm, tool and held object to the floor, to solids, and to one another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from planner.cell import Cell, Solid, shape_of
from verifier.aims import BEFORE_S, Aim
from verifier.arm import ArmPieces
from verifier.capsules import OBJECT, MovingCapsule, capsules_of
from verifier.elementary import Array
from verifier.finding import Finding, Rooms, prove
from verifier.load_checks import HeldObject
from verifier.plan_document import Demands, SampledMotion
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


def clearance_findings(cell: Cell, motion: SampledMotion, demands: Demands, arm: ArmPieces) -> Iterator[Finding]:
    """Returns the findings about clearances."""
    held = HeldObject(motion, demands)
    capsules = capsules_of(cell)
    moving = [c for c in capsules if c.frame > 0]
    yield prove("floor", arm, _floor(cell, moving, held), [c.name for c in moving])
    if cell.surroundings.keep_in:
        names = cell.surroundings.keep_in_names
        yield prove("keep_in", arm, _keep_in(cell.surroundings.keep_in), [name for name in names for _ in range(3)])
    if solids := obstacles(cell, demands):
        pairs = [(c, solid, clear) for solid, clear, name in solids for c in moving if not _may_touch(cell, c, name)]
        names = [f"{c.name}, {name}" for _, _, name in solids for c in moving if not _may_touch(cell, c, name)]
        yield prove("keep_out", arm, _keep_out(pairs, held), names)
    pairs = judged_pairs(cell)
    names = [f"{capsules[i].name}, {capsules[j].name}" for i, j in pairs]
    yield prove("self_collision", arm, _self_collision(capsules, pairs, held), names)


def _may_touch(cell: Cell, capsule: MovingCapsule, name: str) -> bool:
    return cell.surroundings.is_free_to_touch(capsule.name, name)


def obstacles(cell: Cell, demands: Demands) -> list[tuple[Solid, float, str]]:
    """Returns the solids that nothing enters, a request's bin full, with clearance [m] and name."""
    around = cell.surroundings
    found = [
        (solid, around.clearance_m if solid.clearance_m is None else solid.clearance_m, name)
        for solid, name in zip(around.keep_out, around.keep_out_names, strict=True)
    ]
    if demands.aim is not None and demands.aim.bin is not None:
        found.append((_bin(demands.aim), around.clearance_m, "bin"))
    return found


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


def _floor(cell: Cell, capsules: Sequence[MovingCapsule], held: HeldObject) -> Rooms:
    least = cell.surroundings.floor_z_m + cell.surroundings.clearance_m - LENGTH_M

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        ends = ArmEnds(arm, capsules).models
        away = ~held.may_be_held(arm.pieces)
        lower = [np.min([end[2].lower for end in pair], axis=0) for pair in ends]
        upper = [np.min([end[2].upper for end in pair], axis=0) for pair in ends]
        thick = np.array([c.radius_m for c in capsules])[:, None] + least
        out = np.array([c.name == OBJECT for c in capsules])[:, None] & away
        return np.where(out, np.inf, np.array(lower) - thick), np.where(out, np.inf, np.array(upper) - thick)

    return rooms


def _keep_in(solids: Sequence[Solid]) -> Rooms:
    """Returns how deep the tool centre point is in solids, three numbers each: in m, of what is round in m^2."""

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        lower: list[Array] = []
        upper: list[Array] = []
        for solid in solids:
            y = [dot(solid.X_WC[:3, i, None], arm.p_WT - solid.X_WC[:3, 3, None]) for i in range(3)]
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


def _keep_out(pairs: Sequence[tuple[MovingCapsule, Solid, float]], held: HeldObject) -> Rooms:
    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        ends = {}
        for capsule, _, _ in pairs:
            if capsule.name not in ends:
                ends[capsule.name] = ArmEnds(arm, [capsule])
        found = []
        for capsule, solid, clearance in pairs:
            lower, upper = _from_solid(ends[capsule.name], solid, capsule.radius_m + clearance - LENGTH_M)
            if capsule.name == OBJECT:
                away = ~held.may_be_held(arm.pieces)
                lower, upper = np.where(away, np.inf, lower), np.where(away, np.inf, upper)
            found.append((lower, upper))
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


def _self_collision(capsules: Sequence[MovingCapsule], pairs: Sequence[tuple[int, int]], held: HeldObject) -> Rooms:
    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        ends = ArmEnds(arm, capsules)
        lower, upper = [], []
        away = ~held.may_be_held(arm.pieces)
        for i, j in pairs:
            a, b = nearest_on_segments(ends.middles[i], ends.middles[j])
            thick = capsules[i].radius_m + capsules[j].radius_m + SELF_CLEARANCE_M - LENGTH_M
            out = away & (capsules[j].name == OBJECT)
            apart = apart_between(ends.models[i], ends.models[j], toward(a - b)) - thick
            most = apart_in_middle(a - b, [*ends.models[i], *ends.models[j]]) - thick
            lower.append(np.where(out, np.inf, apart))
            upper.append(np.where(out, np.inf, most))
        return np.array(lower), np.array(upper)

    return rooms
