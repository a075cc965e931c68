"""Checks against floor, boxes and the arm itself, for capsules around every link, the tool and the held object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.cell import Box
from planner.certificate.bounds import Proof, curvature_bound, levers, point_acceleration, prove_above, slope_bound
from planner.certificate.check import Check, at_least
from planner.certificate.motion import Motion
from planner.certificate.shapes import Shapes, shapes_of
from planner.geometry import SELF_CLEARANCE_M, segment_box_distance, segment_segment_distance

Vector = NDArray[np.float64]
Index = NDArray[np.intp]
Distance = Callable[[Vector, Index], Vector]  # of capsules `item` (n,) with ends (n, 2, 3)

FAR_M = 1e3  # distance reported for an object that has already left


def floor(motion: Motion) -> Check:
    """Every capsule stays the clearance above the floor."""
    around, shapes = motion.problem.cell.surroundings, shapes_of(motion.problem.cell)

    def height(ends: Vector, item: Index) -> Vector:
        return ends[..., 2].min(axis=-1) - shapes.radius[item] - around.floor_z_m

    # The lower end of a capsule is the lower of two smooth functions: the curvature bound holds for both.
    rates = point_acceleration(shapes.lever[shapes.moving], motion.rates)
    proof = _prove(motion, shapes, height, rates, around.clearance_m, smooth=True)
    return distance_check("floor", proof, around.clearance_m, shapes.names[shapes.moving[proof.item]])


def keep_out(motion: Motion) -> Check | None:
    """No capsule comes nearer than the clearance to any forbidden box; None where the cell has none."""
    around, shapes, sparse = motion.problem.cell.surroundings, shapes_of(motion.problem.cell), motion.sparse
    rates = sparse.rates.qd @ shapes.lever[shapes.moving].T
    worst: Check | None = None
    for i, box in enumerate(around.keep_out):

        def distance(ends: Vector, item: Index, box: Box = box) -> Vector:
            return segment_box_distance(ends[..., 0, :], ends[..., 1, :], box.lower, box.upper) - shapes.radius[item]

        proof = _prove(sparse, shapes, distance, rates, around.clearance_m, smooth=False)
        name = f"{shapes.names[shapes.moving[proof.item]]}, box {i}"
        check = distance_check("keep_out", proof, around.clearance_m, name)
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
    return distance_check("keep_in", proof, 0.0, f"{'xyz'[proof.item % 3]} {'lower' if proof.item < 3 else 'upper'}")


def self_collision(motion: Motion) -> Check | None:
    """No two capsules that can meet come nearer than the self clearance; None where none can."""
    shapes, sparse = shapes_of(motion.problem.cell), motion.sparse
    pairs = shapes.pairs
    if len(pairs) == 0:
        return None

    def gap(one: Vector, other: Vector, item: Index) -> Vector:
        apart = segment_segment_distance(one[..., 0, :], one[..., 1, :], other[..., 0, :], other[..., 1, :])
        return apart - shapes.radius[pairs[item, 0]] - shapes.radius[pairs[item, 1]]

    def evaluate(t: Vector, item: Index) -> Vector:
        X_WL = sparse.poses_at(t)
        one, other = (shapes.end_in_world(X_WL, pairs[item, side]) for side in (0, 1))
        return gap(one, other, item)

    ends = shapes.ends_in_world(sparse.X_WL, np.arange(len(shapes.names)))
    values = gap(ends[:, pairs[:, 0]], ends[:, pairs[:, 1]], np.arange(len(pairs)))
    rates = sparse.rates.qd @ shapes.pair_lever.T
    proof = prove_above(evaluate, sparse.t, values, rates, SELF_CLEARANCE_M, slope_bound)
    first, second = pairs[proof.item]
    return distance_check("self_collision", proof, SELF_CLEARANCE_M, f"{shapes.names[first]}, {shapes.names[second]}")


def distance_check(name: str, proof: Proof, required: float, detail: str) -> Check:
    """Returns the check of a distance [m]: not ok where it is broken, nor where it could not be proven."""
    check = at_least(name, proof.value, required, "m", proof.at_s, detail)
    return check if proof.proven else replace(check, ok=False)


def _prove(motion: Motion, shapes: Shapes, distance: Distance, rates: Vector, required: float, smooth: bool) -> Proof:
    """Proves distance >= `required` for every moving capsule at every instant, the object's until its release."""
    moving = shapes.moving
    released_s = np.inf if motion.problem.ends_at_rest else motion.trajectory.release_time_s

    def forget_released(t: Vector, item: Index, values: Vector) -> Vector:
        return np.where((moving[item] == shapes.object) & (t > released_s), FAR_M, values)

    def evaluate(t: Vector, item: Index) -> Vector:
        ends = shapes.end_in_world(motion.poses_at(t), moving[item])
        return forget_released(t, item, distance(ends, moving[item]))

    every = np.arange(len(moving))
    values = distance(shapes.ends_in_world(motion.X_WL, moving), moving)
    values = forget_released(motion.t[:, None], every, values)
    return prove_above(evaluate, motion.t, values, rates, required, curvature_bound if smooth else slope_bound)
