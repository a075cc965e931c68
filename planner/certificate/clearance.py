"""Checks of the clearance to floor, shapes and the arm itself, for capsules around links, tool and held object."""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, Index
from planner.certificate.bounds import (
    Proof,
    curvature_bound,
    point_bound,
    prove_above,
    slope_bound,
)
from planner.certificate.certificate import Check, NotChecked, at_least
from planner.certificate.samples import MotionSamples
from planner.geometry import SELF_CLEARANCE_M, pair_distances, shape_distances

FAR_M = 1e3  # [m] distance reported for an object that has been released


def floor(motion: MotionSamples) -> Check:
    """Checks that every capsule stays the clearance above the floor."""
    around = motion.problem.cell.surroundings
    body = motion.body
    t = motion.at_knots.t
    moving = body.moving

    def evaluate(t: Array, item: Index) -> Array:
        capsule = moving[item]
        ends = body.end_points_of(capsule, motion.poses_at(t))
        height = ends[..., 2].min(axis=-1) - body.radii[capsule] - around.floor_z_m
        return np.where((capsule == body.object) & (t > motion.held_until_s), FAR_M, height)

    # The lower end of a capsule is the lower of two smooth functions: the curvature bound holds for both.
    heights = moving_heights(motion, t, motion.ends)
    rates = point_bound(body.levers[moving], motion.rates, 2)
    proof = prove_above(evaluate, t, heights, rates, around.clearance_m, curvature_bound, motion.distance_accuracy)
    return _distance_check("floor", proof, around.clearance_m, body.names[moving[proof.item]])


def keep_out(motion: MotionSamples) -> Check | None:
    """Checks that every capsule keeps its clearance from every keep-out shape and a bin; None where there is neither.

    The value is the distance from the shape that leaves least beyond its clearance, and the limit that clearance.
    """
    around = motion.body.cell.surroundings
    body = motion.body
    t = motion.at_knots.t[motion.sparse]
    if not around.keep_out:
        return None
    moving, count = body.moving, len(body.moving)
    lower, upper = (np.array([getattr(shape, side) for shape in around.keep_out]) for side in ("lower", "upper"))
    further = around.further_clearances

    def distance(ends: Array, item: Index) -> Array:
        shape = item // count
        thick = body.radii[moving[item % count]] + further[shape]
        return shape_distances(ends[:, 0], ends[:, 1], shape, around.keep_out_rows) - thick

    def evaluate(t: Array, item: Index) -> Array:
        capsule = moving[item % count]
        gap = distance(body.end_points_of(capsule, motion.poses_at(t)), item)
        return np.where((capsule == body.object) & (t > motion.held_until_s), FAR_M, gap)

    ends = motion.ends[moving][..., motion.sparse]
    gaps = _bounding_box_distances(ends, lower, upper) - (body.radii[moving] + further[:, None])[..., None]
    gaps[:, -1, t > motion.held_until_s] = FAR_M
    gaps = gaps.reshape(-1, len(t))
    rates = np.tile(body.levers[moving] @ motion.sparse_speeds, (len(lower), 1))
    # The distance of bounding boxes decides most; only what it leaves open, or may be closest, is evaluated exactly.
    item, row = (np.array([i]) for i in divmod(int(gaps.argmin()), len(t)))
    closest = float(distance(ends[item % count, :, :, row], item)[0])
    undecided = max(closest, around.clearance_m + float((rates * np.diff(t)).max()))
    items, rows = np.nonzero(gaps <= undecided)
    gaps[items, rows] = distance(ends[items % count, :, :, rows], items)
    proof = prove_above(evaluate, t, gaps, rates, around.clearance_m, slope_bound, motion.distance_accuracy)
    shape = proof.item // count
    name = f"{body.names[moving[proof.item % count]]}, {around.keep_out_names[shape]}"
    proof = proof._replace(value=proof.value + float(further[shape]))
    return _distance_check("keep_out", proof, around.clearance_m + float(further[shape]), name)


def _bounding_box_distances(ends: Array, lower: Array, upper: Array) -> Array:
    """Returns the distances (b, k, n) of b boxes from the bounding boxes of segments with ends (k, 2, 3, n).

    They are lower bounds on the distances of the segments.
    """
    lowest = ends.min(axis=1)
    highest = ends.max(axis=1)
    apart = np.maximum(lower[:, None, :, None] - highest, lowest - upper[:, None, :, None])
    return np.sqrt((np.maximum(apart, 0.0) ** 2).sum(axis=2))


def keep_in(motion: MotionSamples) -> Check | None:
    """Checks that the tool centre point stays in every keep-in box; None where the cell has none."""
    boxes = motion.problem.cell.surroundings.keep_in
    if not boxes:
        return None
    lower = np.max([box.lower for box in boxes], axis=0)[:, None]
    upper = np.min([box.upper for box in boxes], axis=0)[:, None]

    def inside(p_WT: Array) -> Array:
        return np.concatenate([p_WT - lower, upper - p_WT])

    def evaluate(t: Array, item: Index) -> Array:
        return inside(motion.at(t).p_WT)[item, np.arange(len(t))]

    arm = motion.at_knots
    rates = point_bound(motion.body.tool_lever, motion.rates, 2)
    proof = prove_above(evaluate, arm.t, inside(arm.p_WT), rates, 0.0, curvature_bound, motion.distance_accuracy)
    return _distance_check("keep_in", proof, 0.0, f"{'xyz'[proof.item % 3]} {'lower' if proof.item < 3 else 'upper'}")


def self_collision(motion: MotionSamples) -> Check | None:
    """Checks that no two capsules that can collide come closer than the self clearance; None where none can."""
    body = motion.body
    t = motion.at_knots.t[motion.sparse]
    if len(body.pairs) == 0:
        return None
    first, second = body.pairs.T
    thickness = body.radii[first] + body.radii[second]

    def evaluate(t: Array, item: Index) -> Array:
        X_WL = motion.poses_at(t)
        ends = np.concatenate([body.end_points_of(side[item], X_WL) for side in (first, second)])
        both = np.arange(len(ends)).reshape(2, -1).T
        gap = pair_distances(ends[..., None], both)[:, 0] - thickness[item]
        return np.where((second[item] == body.object) & (t > motion.held_until_s), FAR_M, gap)

    gaps = pair_gaps(motion, t, motion.ends[..., motion.sparse])
    rates = body.pair_levers @ motion.sparse_speeds
    proof = prove_above(evaluate, t, gaps, rates, SELF_CLEARANCE_M, slope_bound, motion.distance_accuracy)
    names = body.names[first[proof.item]], body.names[second[proof.item]]
    return _distance_check("self_collision", proof, SELF_CLEARANCE_M, ", ".join(names))


def arm_shape(motion: MotionSamples) -> NotChecked | None:
    """Says that the arm's capsules are an estimate; None where they were measured on its meshes."""
    return NotChecked("arm_shape") if motion.problem.cell.robot.shape.is_estimate else None


def tool_shape(motion: MotionSamples) -> NotChecked | None:
    """Says that the tool's shape is assumed; None where the cell gives it, or the tool has none."""
    return NotChecked("tool_shape") if motion.problem.cell.tool.is_assumed else None


def clearance(motion: MotionSamples) -> NotChecked | None:
    """Says that the cell asks for no distance from floor and shapes; None where it does."""
    around = motion.problem.cell.surroundings
    least_m = around.clearance_m + min((0.0, *around.further_clearances))
    return None if least_m > 0.0 else NotChecked("clearance")


def moving_heights(motion: MotionSamples, t: Array, ends: Array) -> Array:
    """Returns heights of the j moving capsules above the floor (j, k) [m] for capsule ends (c, 2, 3, k) at `t` (k,)."""
    heights = motion.body.heights(ends)
    heights[-1, t > motion.held_until_s] = FAR_M
    return heights


def shape_gaps(motion: MotionSamples, t: Array, ends: Array) -> Array:
    """Returns distances of the j moving capsules from the b keep-out shapes (b, j, k) [m], otherwise alike."""
    gaps = motion.body.shape_distances(ends)
    gaps[:, -1, t > motion.held_until_s] = FAR_M
    return gaps


def pair_gaps(motion: MotionSamples, t: Array, ends: Array) -> Array:
    """Returns distances of the p pairs that can collide (p, k) [m], otherwise alike."""
    gaps = motion.body.pair_distances(ends)
    gaps[np.ix_(motion.body.pairs[:, 1] == motion.body.object, t > motion.held_until_s)] = FAR_M
    return gaps


def _distance_check(name: str, proof: Proof, required: float, detail: str) -> Check:
    return at_least(name, proof.value, required, "m", proof.at_s, detail).provided(proof.proven)
