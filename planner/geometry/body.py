"""Tool pose and twist of a cell; its arm, tool and held object as capsules, and their clearance to everything."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Index, Mask
from planner.cell import Cell, ThrownBody
from planner.errors import Violation
from planner.geometry.capsules import Capsule, body_capsules, levers
from planner.geometry.distances import pair_distances
from planner.geometry.self_collision import SELF_CLEARANCE_M, object_pairs, pierced, self_collision_pairs
from planner.kinematics import forward, jacobian, link_poses
from planner.native import loops

CELLS_KEPT = 32  # cells whose models are cached
FAR_M = 1e3  # [m] distance told of what may touch
LEVEL_RAD = 1e-6  # [rad] rounding: the first axis of an upright arm is that near to vertical


class ToolState(NamedTuple):
    """Pose and twist of the tool centre point in the world.

    Attributes:
        X_WT: pose (..., 4, 4).
        V_WT: twist (..., 6), linear [m/s], then angular [rad/s].
    """

    X_WT: Array
    V_WT: Array

    @property
    def p_WT(self) -> Array:
        """Position (..., 3) [m]."""
        return self.X_WT[..., :3, 3]

    @property
    def v_WT(self) -> Array:
        """Linear velocity (..., 3) [m/s]."""
        return self.V_WT[..., :3]


def tool_pose(cell: Cell, q: Array) -> Array:
    """Returns the tool pose X_WT (..., 4, 4) at joint positions `q` (..., 6) [rad]."""
    return cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT)


def tool_state(cell: Cell, q: Array, qd: Array) -> ToolState:
    """Returns pose and twist of the tool at joint states `q` [rad], `qd` [rad/s], both (..., 6)."""
    V_BT = (jacobian(cell.robot, q, cell.tool.X_FT) @ qd[..., None])[..., 0]
    R_BW = cell.X_WB[:3, :3].T
    return ToolState(tool_pose(cell, q), np.concatenate([V_BT[..., :3] @ R_BW, V_BT[..., 3:] @ R_BW], axis=-1))


def twist_in_base(cell: Cell, V_WT: Array) -> Array:
    """Returns a twist (6,) of the world along the axes of the arm's base, as its Jacobian gives it."""
    R_BW = cell.X_WB[:3, :3].T
    return np.concatenate([R_BW @ V_WT[:3], R_BW @ V_WT[3:]])


@dataclass(frozen=True, eq=False)
class Clearances:
    """Margins of n postures to their bounds (n,) [m]; negative where a bound is violated."""

    floor: Array
    keep_in: Array
    keep_out: Array
    self_collision: Array

    @property
    def least(self) -> Array:
        """The smallest of the four (n,)."""
        return np.min([self.floor, self.keep_in, self.keep_out, self.self_collision], axis=0)


class BodyModel:
    """Capsules of a cell's arm, tool and held object as arrays: k capsules, the object last.

    Arrays over n samples have the samples on their last axis.

    Attributes:
        cell: the cell.
        names: of the capsules (k,).
        frames: DH frame of each (k,).
        ends: ends of the segments in that frame (k, 2, 3) [m].
        radii: (k,) [m].
        levers: of each capsule's points about each joint (k, 6) [m]; see `levers`.
        moving: indices of the j capsules that the first joint moves (j,).
        pairs: indices of the p pairs of arm, tool and object that can collide (p, 2); the object's come last, with the
            links that a body always pierces. None that may touch.
        beside_object: indices of the capsules beside which the object is gripped (g,): the tool's, and those of links
            that are always close to it, or never.
        pair_levers: of the outer capsule of each pair about the joints between the two (p, 6) [m].
        tool_lever: of the tool centre point about each joint (6,) [m].
    """

    def __init__(self, cell: Cell) -> None:
        held = held_object(cell)
        capsules = (*body_capsules(cell.robot, cell.tool.capsules), held)
        self.cell = cell
        self.names = tuple(c.name for c in capsules)
        self.frames = np.array([c.frame for c in capsules])
        self.ends = np.array([[c.p0, c.p1] for c in capsules])
        self.radii = np.array([c.radius_m for c in capsules])
        self.levers = np.array([levers(cell.robot, c.frame, c.reach_m) for c in capsules])
        self.moving = np.flatnonzero(self.frames > 0)
        own = self_collision_pairs(cell.robot, cell.tool.capsules)
        with_object = object_pairs(cell.robot, cell.tool.capsules, held)
        self.beside_object = np.setdiff1d(np.arange(self.object), [i for i, _ in with_object])
        if isinstance(cell.object, ThrownBody):  # a ball in the hand is as near to the wrist as it is
            touched = {each.names[0] for each in pierced(cell.robot, held, cell.surroundings)}
            always = [(i, self.object) for i in self.beside_object.tolist() if self.names[i] in touched]
            with_object = [*with_object, *always]
        apart = cell.surroundings.is_free_to_touch
        pairs = [(i, j) for i, j in (*own, *with_object) if not apart(self.names[i], self.names[j])]
        self.pairs = np.array(pairs, dtype=np.intp).reshape(-1, 2)
        self.pair_levers = np.array([self._pair_lever(capsules, *pair) for pair in self.pairs]).reshape(-1, 6)
        self.tool_lever = self.levers[self.object]  # which is in the middle of it

    def _pair_lever(self, capsules: tuple[Capsule, ...], i: int, j: int) -> Array:
        near, far = sorted((i, j), key=lambda index: capsules[index].frame)
        # The first joint that moves one against the other.
        first = capsules[near].frame + capsules[near].is_round_about_z
        return np.where(np.arange(6) >= first, self.levers[far], 0.0)

    @property
    def object(self) -> int:
        """Index of the held object."""
        return len(self.names) - 1

    @cached_property
    def stays_level(self) -> Mask:
        """Which of the moving capsules (j,) the first joint alone moves, about a vertical axis."""
        return (self.frames[self.moving] == 1) & bool(np.abs(self.cell.X_WB[:2, 2]).max() < LEVEL_RAD)

    @cached_property
    def may_touch(self) -> Mask:
        """Which of the capsules (k,) may touch which of the keep-out shapes (b,): (b, k)."""
        around = self.cell.surroundings
        free = [[around.is_free_to_touch(name, shape) for name in self.names] for shape in around.keep_out_names]
        return np.array(free, np.bool_).reshape(-1, len(self.names))

    @cached_property
    def base_shapes(self) -> tuple[Array, Array, Array]:
        """Ends (k, 3) in the world and radii (k,) of the capsules that the base carries, which never move [m]."""
        fixed = np.flatnonzero(self.frames == 0)
        ends = self.end_points(self.link_poses(self.cell.home[None]))[fixed, :, :, 0]
        return ends[:, 0], ends[:, 1], self.radii[fixed]

    def link_poses(self, q: Array) -> Array:
        """Returns the poses X_WL (n, 7, 4, 4) of base and links at postures `q` (n, 6) [rad]."""
        return link_poses(self.cell.robot, q, self.cell.X_WB)

    def end_points(self, X_WL: Array) -> Array:
        """Returns the ends of all capsules in the world (k, 2, 3, n) [m] for link poses (n, 7, 4, 4)."""
        return loops.end_points(X_WL, self.frames, self.ends)

    def end_points_of(self, item: Index, X_WL: Array) -> Array:
        """Returns the ends of one capsule a sample: (n, 2, 3) [m] of capsule `item[i]` for `X_WL[i]` (4, 4)."""
        return loops.end_points_of(X_WL, self.frames[item], self.ends[item])

    def heights(self, ends: Array) -> Array:
        """Returns the heights above the floor (j, n) [m] of the moving capsules with `ends` (k, 2, 3, n)."""
        z = ends[self.moving, :, 2]
        return np.minimum(z[:, 0], z[:, 1]) - self.radii[self.moving, None] - self.cell.surroundings.floor_z_m

    def shape_distances(self, ends: Array) -> Array:
        """Returns the distances (b, j, n) [m] of moving capsules from keep-out shapes, `FAR_M` where they may touch."""
        p0, p1 = np.moveaxis(ends[self.moving], (1, 2), (0, -1))
        rows = self.cell.surroundings.keep_out_rows
        gaps = loops.all_shape_distances(p0.reshape(-1, 3), p1.reshape(-1, 3), rows)
        gaps = gaps.reshape(len(rows), *p0.shape[:2]) - self.radii[self.moving, None]
        gaps[self.may_touch[:, self.moving]] = FAR_M
        return gaps

    def pair_distances(self, ends: Array) -> Array:
        """Returns the distances (p, n) [m] of the pairs."""
        first, second = self.pairs.T
        return pair_distances(ends, self.pairs) - (self.radii[first] + self.radii[second])[:, None]

    def wall_distances(self, ends: Array) -> Array:
        """Returns how far inside each keep-in shape the tool centre point is (r, n) [m]."""
        p_WT = 0.5 * (ends[self.object, 0] + ends[self.object, 1]).T
        shapes = self.cell.surroundings.keep_in
        inside = [shape.depth(p_WT) for shape in shapes]
        return np.array(inside).reshape(len(shapes), len(p_WT))

    def clearances(self, q: Array, with_object: bool = True) -> Clearances:
        """Returns the clearances of postures `q` (n, 6) [rad], with the object in the tool or without.

        The shoulder of an upright arm is always as high above the floor, so that counts only where it is too low.
        """
        ends = self.end_points(self.link_poses(q))
        clearance = self.cell.surroundings.clearance_m
        bodies = slice(None) if with_object else slice(-1)  # the object is the last of them
        pairs = slice(None) if with_object else (self.pairs != self.object).all(axis=1)
        further = self.cell.surroundings.further_clearances[:, None, None]
        rooms = self.cell.surroundings.keep_in_clearances[:, None]
        above = self.heights(ends)[bodies] - clearance
        above[self.stays_level[bodies, None] & (above >= 0.0)] = np.inf
        return Clearances(
            floor=above.min(axis=0),
            keep_in=(self.wall_distances(ends) - rooms).min(axis=0, initial=np.inf),
            keep_out=(self.shape_distances(ends)[:, bodies] - further).min(axis=(0, 1), initial=np.inf) - clearance,
            self_collision=self.pair_distances(ends)[pairs].min(axis=0, initial=np.inf) - SELF_CLEARANCE_M,
        )

    def violations_at(self, q: Array, with_object: bool = True) -> list[Violation]:
        """Returns the bounds on clearance that a posture (6,) [rad] breaks as the release, with what is too close.

        The one that it comes closest to breaking where rounding alone decides. With the object in the tool or without.
        """
        ends = self.end_points(self.link_poses(q[None]))
        clearance = self.cell.surroundings.clearance_m
        bodies = slice(None) if with_object else slice(-1)  # the object is the last of them
        of_pairs = np.flatnonzero(with_object | (self.pairs != self.object).all(axis=1))
        moving = [self.names[i] for i in self.moving[bodies]]
        pairs = [f"{self.names[i]}, {self.names[j]}" for i, j in self.pairs[of_pairs]]
        at_shapes = [f"{each}, {shape}" for shape in self.cell.surroundings.keep_out_names for each in moving]
        around = self.cell.surroundings
        tool = [
            "tool centre point" + (f", {n}" if i in around.rooms else "") for i, n in enumerate(around.keep_in_names)
        ]
        further = np.repeat(self.cell.surroundings.further_clearances, len(moving))
        gaps = (
            ("floor", self.heights(ends)[bodies], moving, clearance, np.zeros(1)),
            ("keep_in", self.wall_distances(ends), tool, 0.0, around.keep_in_clearances),
            ("keep_out", self.shape_distances(ends)[:, bodies], at_shapes, clearance, further),
            ("self_collision", self.pair_distances(ends)[of_pairs], pairs, SELF_CLEARANCE_M, np.zeros(1)),
        )
        margins = []
        violations = []
        for name, distances, close, limit, beyond in gaps:
            if distances.size:
                left = distances.ravel() - beyond
                least = int(left.argmin())
                required = limit + float(np.broadcast_to(beyond, left.shape)[least])
                margins.append(float(left[least]) - limit)
                detail = f"{close[least]}, at the release"
                violations.append(Violation(name, float(distances.flat[least]), required, "m", detail=detail))
        broken = [violation for violation, margin in zip(violations, margins, strict=True) if margin < 0.0]
        return broken or [violations[int(np.argmin(margins))]]


def held_object(cell: Cell) -> Capsule:
    """Returns the capsule about the held object of a cell: its hull, at the tool centre point."""
    p_FT = cell.tool.X_FT[:3, 3]
    thing = cell.object
    along = thing.reach_m * (cell.tool.X_FT[:3, :3] @ thing.hull_axis)
    return Capsule(frame=6, p0=p_FT - along, p1=p_FT + along, radius_m=thing.radius_m, name="object")


@lru_cache(maxsize=CELLS_KEPT)
def body_model(cell: Cell) -> BodyModel:
    """Returns the body model of a cell, built once a cell."""
    return BodyModel(cell)
