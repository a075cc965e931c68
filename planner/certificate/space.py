"""Checks against floor, boxes and the arm itself, for capsules around every link, the tool and the held object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.certificate.bounds import Proof, curvature_bound, point_acceleration, prove_above, slope_bound
from planner.certificate.check import Check, at_least
from planner.certificate.motion import Motion
from planner.certificate.shapes import shapes_of
from planner.geometry import SELF_CLEARANCE_M, segment_box_distance, segment_segment_distance

Vector = NDArray[np.float64]
Index = NDArray[np.intp]

FAR_M = 1e3  # distance reported for an object that has already left


def floor(motion: Motion) -> Check:
    """Every capsule stays the clearance above the floor."""
    around, shapes = motion.problem.cell.surroundings, shapes_of(motion.problem.cell)
    moving = shapes.moving

    def evaluate(t: Vector, item: Index) -> Vector:
        ends = shapes.end_in_world(motion.poses_at(t), moving[item])
        height = ends[..., 2].min(axis=-1) - shapes.radius[moving[item]] - around.floor_z_m
        return np.where((moving[item] == shapes.object) & (t > motion.released_s), FAR_M, height)

    # The lower end of a capsule is the lower of two smooth functions: the curvature bound holds for both.
    heights = shapes.heights(motion.look.X_WL) - around.floor_z_m
    heights[-1, motion.look.t > motion.released_s] = FAR_M
    rates = point_acceleration(shapes.lever[moving], motion.rates)
    proof = prove_above(evaluate, motion.look.t, heights, rates, around.clearance_m, curvature_bound)
    return distance_check("floor", proof, around.clearance_m, shapes.names[moving[proof.item]])


def keep_out(motion: Motion) -> Check | None:
    """No capsule comes nearer than the clearance to any forbidden box; None where the cell has none."""
    around, shapes = motion.problem.cell.surroundings, shapes_of(motion.problem.cell)
    if not around.keep_out:
        return None
    moving, count = shapes.moving, len(shapes.moving)
    lower, upper = (np.array([getattr(box, side) for box in around.keep_out]) for side in ("lower", "upper"))

    def distance(ends: Vector, item: Index) -> Vector:
        box, body = item // count, moving[item % count]
        return segment_box_distance(ends[:, 0], ends[:, 1], lower[box], upper[box]) - shapes.radius[body]

    def evaluate(t: Vector, item: Index) -> Vector:
        body = moving[item % count]
        gap = distance(shapes.end_in_world(motion.poses_at(t), body), item)
        return np.where((body == shapes.object) & (t > motion.released_s), FAR_M, gap)

    t = motion.look.t[motion.sparse]
    ends = shapes.ends_in_world(motion.look.X_WL[motion.sparse])[moving]
    gaps = _box_gaps(ends, lower, upper) - shapes.radius[moving, None]
    gaps[:, -1, t > motion.released_s] = FAR_M
    gaps = gaps.reshape(-1, len(t))
    rates = np.tile(shapes.lever[moving] @ motion.sparse_speeds, (len(lower), 1))
    # What is far by its bounding box is far enough; the rest, and what may be nearest, is measured.
    item, row = (np.array([i]) for i in divmod(int(gaps.argmin()), len(t)))
    nearest = float(distance(ends[item % count, :, :, row], item)[0])
    close = max(nearest, around.clearance_m + float((rates * np.diff(t)).max()))
    items, rows = np.nonzero(gaps <= close)
    gaps[items, rows] = distance(ends[items % count, :, :, rows], items)
    proof = prove_above(evaluate, t, gaps, rates, around.clearance_m, slope_bound)
    name = f"{shapes.names[moving[proof.item % count]]}, box {proof.item // count}"
    return distance_check("keep_out", proof, around.clearance_m, name)


def _box_gaps(ends: Vector, lower: Vector, upper: Vector) -> Vector:
    """Returns distances (b, k, n) of b boxes from the boxes around segments (k, 2, 3, n): none is farther than that."""
    lowest, highest = ends.min(axis=1), ends.max(axis=1)
    apart = np.maximum(lower[:, None, :, None] - highest, lowest - upper[:, None, :, None])
    return np.sqrt((np.maximum(apart, 0.0) ** 2).sum(axis=2))


def keep_in(motion: Motion) -> Check | None:
    """The tool centre point stays in every allowed box; None where the cell has none."""
    boxes = motion.problem.cell.surroundings.keep_in
    if not boxes:
        return None
    lower = np.max([box.lower for box in boxes], axis=0)[:, None]
    upper = np.min([box.upper for box in boxes], axis=0)[:, None]

    def inside(p_WT: Vector) -> Vector:
        return np.concatenate([p_WT - lower, upper - p_WT])

    def evaluate(t: Vector, item: Index) -> Vector:
        return inside(motion.look_at(t).p_WT)[item, np.arange(len(t))]

    rates = point_acceleration(shapes_of(motion.problem.cell).tool_lever, motion.rates)
    proof = prove_above(evaluate, motion.look.t, inside(motion.look.p_WT), rates, 0.0, curvature_bound)
    return distance_check("keep_in", proof, 0.0, f"{'xyz'[proof.item % 3]} {'lower' if proof.item < 3 else 'upper'}")


def self_collision(motion: Motion) -> Check | None:
    """No two capsules that can meet come nearer than the self clearance; None where none can."""
    shapes = shapes_of(motion.problem.cell)
    if len(shapes.pairs) == 0:
        return None
    first, second = shapes.pairs.T
    thickness = shapes.radius[first] + shapes.radius[second]

    def evaluate(t: Vector, item: Index) -> Vector:
        X_WL = motion.poses_at(t)
        one, other = (shapes.end_in_world(X_WL, side[item]) for side in (first, second))
        return segment_segment_distance(one[:, 0], one[:, 1], other[:, 0], other[:, 1]) - thickness[item]

    ends = shapes.ends_in_world(motion.look.X_WL[motion.sparse])
    one, other = ends[first], ends[second]
    gaps = segment_segment_distance(one[:, 0], one[:, 1], other[:, 0], other[:, 1], axis=1) - thickness[:, None]
    rates = shapes.pair_lever @ motion.sparse_speeds
    proof = prove_above(evaluate, motion.look.t[motion.sparse], gaps, rates, SELF_CLEARANCE_M, slope_bound)
    names = shapes.names[first[proof.item]], shapes.names[second[proof.item]]
    return distance_check("self_collision", proof, SELF_CLEARANCE_M, ", ".join(names))


def distance_check(name: str, proof: Proof, required: float, detail: str) -> Check:
    """Returns the check of a distance [m]: not ok where it is broken, nor where it could not be proven."""
    check = at_least(name, proof.value, required, "m", proof.at_s, detail)
    return check if proof.proven else replace(check, ok=False)
