"""Checks against floor, boxes and the arm itself, for capsules around every link, the tool and the held object."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from planner.cell import Box
from planner.certificate.bounds import (
    Proof,
    curvature_bound,
    levers,
    point_acceleration,
    point_speed,
    prove_above,
    slope_bound,
)
from planner.certificate.check import Check, at_least
from planner.certificate.motion import Motion
from planner.geometry import (
    SELF_CLEARANCE_M,
    Capsule,
    body_capsules,
    segment_box_distance,
    segment_segment_distance,
    self_collision_pairs,
)

Vector = NDArray[np.float64]
Index = NDArray[np.intp]

FAR_M = 1e3  # distance reported for an object that has already left


class Bodies:
    """Every moving capsule of a motion, the object in the tool last; ends are (k, 2, 3) in the world."""

    def __init__(self, motion: Motion) -> None:
        cell = motion.problem.cell
        p_FT = cell.tool.X_FT[:3, 3]
        thing = Capsule(frame=6, p0=p_FT, p1=p_FT, radius_m=cell.object.radius_m, name="object")
        arm_and_tool = [c for c in body_capsules(cell.robot, cell.tool.capsules) if c.frame > 0]
        self.capsules = [*arm_and_tool, thing]
        self.frame = np.array([c.frame for c in self.capsules])
        self.local = np.array([[c.p0, c.p1] for c in self.capsules])
        self.radius = np.array([c.radius_m for c in self.capsules])
        self.released_s = motion.trajectory.release_time_s
        if motion.problem.ends_at_rest:
            self.released_s = np.inf

    def ends(self, X_WL: Vector, item: Index) -> Vector:
        """Returns the end points (k, 2, 3) of capsules `item` (k,) for link poses (k, 7, 4, 4)."""
        X = X_WL[np.arange(len(item)), self.frame[item]]
        return np.einsum("kij,knj->kni", X[:, :3, :3], self.local[item]) + X[:, None, :3, 3]

    def ends_at_knots(self, motion: Motion) -> Vector:
        """Returns the end points (m, n, 2, 3) of all capsules at the knots."""
        X = motion.X_WL[:, self.frame]
        return np.einsum("mnij,nej->mnei", X[..., :3, :3], self.local) + X[..., None, :3, 3]

    def forget_released(self, t: Vector, item: Index, distance: Vector) -> Vector:
        """Returns `distance` with the object's made harmless after the release."""
        gone = (item == len(self.capsules) - 1) & (t > self.released_s)
        return np.where(gone, FAR_M, distance)

    def prove(
        self, motion: Motion, distance: Callable[[Vector, Index], Vector], required: float, smooth: bool
    ) -> Proof:
        """Proves distance(ends, item) >= `required` for every capsule at every instant."""
        count = len(self.capsules)

        def evaluate(t: Vector, item: Index) -> Vector:
            return self.forget_released(t, item, distance(self.ends(motion.poses_at(t), item), item))

        every = np.broadcast_to(np.arange(count), (len(motion.t), count)).ravel()
        at_knots = distance(self.ends_at_knots(motion).reshape(-1, 2, 3), every)
        values = self.forget_released(np.repeat(motion.t, count), every, at_knots).reshape(-1, count)
        rates = np.stack([self._rate(motion, i, smooth) for i in range(count)], axis=1)
        return prove_above(evaluate, motion.t, values, rates, required, curvature_bound if smooth else slope_bound)

    def _rate(self, motion: Motion, i: int, smooth: bool) -> Vector:
        reach = float(np.linalg.norm(self.local[i], axis=1).max())
        lever = levers(motion.problem.cell.robot, int(self.frame[i]), reach)
        bound = point_acceleration if smooth else point_speed
        return bound(lever, motion.rates)


def floor(motion: Motion, bodies: Bodies) -> Check:
    """Every capsule stays the clearance above the floor."""
    around = motion.problem.cell.surroundings

    def height(ends: Vector, item: Index) -> Vector:
        return ends[..., 2].min(axis=1) - bodies.radius[item] - around.floor_z_m

    # The lower end of a capsule is the lower of two smooth functions: the curvature bound holds for both.
    proof = bodies.prove(motion, height, around.clearance_m, smooth=True)
    return _distance_check("floor", proof, around.clearance_m, bodies.capsules[proof.item].name)


def keep_out(motion: Motion, bodies: Bodies) -> Check | None:
    """No capsule comes nearer than the clearance to any forbidden box; None where the cell has none."""
    around = motion.problem.cell.surroundings
    worst: Check | None = None
    for i, box in enumerate(around.keep_out):

        def distance(ends: Vector, item: Index, box: Box = box) -> Vector:
            return segment_box_distance(ends[:, 0], ends[:, 1], box.lower, box.upper) - bodies.radius[item]

        proof = bodies.prove(motion.sparse, distance, around.clearance_m, smooth=False)
        check = _distance_check("keep_out", proof, around.clearance_m, f"{bodies.capsules[proof.item].name}, box {i}")
        if worst is None or (check.ok, check.margin) < (worst.ok, worst.margin):
            worst = check
    return worst


def keep_in(motion: Motion) -> Check | None:
    """The tool centre point stays in every allowed box; None where the cell has none."""
    boxes = motion.problem.cell.surroundings.keep_in
    if not boxes:
        return None
    lower = np.max([box.lower for box in boxes], axis=0)
    upper = np.min([box.upper for box in boxes], axis=0)
    p_FT = motion.problem.cell.tool.X_FT[:3, 3]

    def inside(X_WL: Vector) -> Vector:
        p = X_WL[:, 6, :3, :3] @ p_FT + X_WL[:, 6, :3, 3]
        return np.concatenate([p - lower, upper - p], axis=1)

    def evaluate(t: Vector, item: Index) -> Vector:
        return inside(motion.poses_at(t))[np.arange(len(t)), item]

    lever = levers(motion.problem.cell.robot, 6, float(np.linalg.norm(p_FT)))
    rates = np.repeat(point_acceleration(lever, motion.rates)[:, None], 6, axis=1)
    proof = prove_above(evaluate, motion.t, inside(motion.X_WL), rates, 0.0, curvature_bound)
    return _distance_check("keep_in", proof, 0.0, f"{'xyz'[proof.item % 3]} {'lower' if proof.item < 3 else 'upper'}")


def self_collision(motion: Motion) -> Check | None:
    """No two capsules that can meet come nearer than the self clearance; None where none can."""
    motion, robot, tool = motion.sparse, motion.problem.cell.robot, motion.problem.cell.tool
    capsules = body_capsules(robot, tool.capsules)
    pairs = np.array(self_collision_pairs(robot, tool.capsules), dtype=int).reshape(-1, 2)
    if len(pairs) == 0:
        return None
    frame = np.array([c.frame for c in capsules])
    local = np.array([[c.p0, c.p1] for c in capsules])
    radius = np.array([c.radius_m for c in capsules])

    def ends(X: Vector, which: Index) -> Vector:
        return np.einsum("kij,knj->kni", X[:, :3, :3], local[which]) + X[:, None, :3, 3]

    def distance(X_WL: Vector, item: Index) -> Vector:
        first, second = pairs[item, 0], pairs[item, 1]
        row = np.arange(len(item))
        one, other = ends(X_WL[row, frame[first]], first), ends(X_WL[row, frame[second]], second)
        gap = segment_segment_distance(one[:, 0], one[:, 1], other[:, 0], other[:, 1])
        return gap - radius[first] - radius[second]

    knots, count = len(motion.t), len(pairs)
    values = distance(np.repeat(motion.X_WL, count, axis=0), np.tile(np.arange(count), knots)).reshape(-1, count)
    rates = np.stack([_closing_speed(motion, frame, local, pair) for pair in pairs], axis=1)
    proof = prove_above(lambda t, item: distance(motion.poses_at(t), item), motion.t, values, rates,
                        SELF_CLEARANCE_M, slope_bound)
    first, second = pairs[proof.item]
    return _distance_check("self_collision", proof, SELF_CLEARANCE_M, f"{capsules[first].name}, {capsules[second].name}")


def _closing_speed(motion: Motion, frame: Index, local: Vector, pair: Index) -> Vector:
    """Returns how fast two capsules approach at most in every tick [m/s]: only the joints between them count."""
    near, far = sorted(pair, key=lambda i: frame[i])
    lever = levers(motion.problem.cell.robot, int(frame[far]), float(np.linalg.norm(local[far], axis=1).max()))
    lever[: frame[near]] = 0.0
    return motion.rates.qd @ lever


def _distance_check(name: str, proof: Proof, required: float, detail: str) -> Check:
    check = at_least(name, proof.value, required, "m", proof.at_s, detail)
    return check if proof.proven else Check(**{**check.__dict__, "ok": False})
