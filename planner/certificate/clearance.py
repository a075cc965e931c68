"""Checks of the clearance to floor, shapes and the arm itself, for capsules around links, tool and held object."""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, Index
from planner.cell import Surroundings
from planner.certificate.bounds import (
    Proof,
    curvature_bound,
    point_bound,
    prove_above,
    slope_bound,
)
from planner.certificate.certificate import Check, NotChecked, at_least
from planner.certificate.samples import ArmSamples, MotionSamples
from planner.certificate.shown import Curve, Series, ShownMotion
from planner.geometry import SELF_CLEARANCE_M, pair_distances, shape_distances

FAR_M = 1e3  # [m] distance reported for an object that has been released, and for what may touch
TOGETHER = 16  # [-] instants whose bounding boxes are taken together first


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
    moving = body.moving
    thick = np.where(body.may_touch[:, moving], -FAR_M, body.radii[moving] + around.further_clearances[:, None])
    ends = motion.ends[moving][..., motion.sparse]
    rates = body.levers[moving] @ motion.sparse_speeds
    reach = float((rates * np.diff(t)).max())
    shape, capsule = _close_pairs(motion, t, ends, thick, reach)

    def distance(ends: Array, item: Index) -> Array:
        gap = shape_distances(ends[:, 0], ends[:, 1], shape[item], around.keep_out_rows)
        return gap - thick[shape[item], capsule[item]]

    def evaluate(t: Array, item: Index) -> Array:
        chosen = moving[capsule[item]]
        gap = distance(body.end_points_of(chosen, motion.poses_at(t)), item)
        return np.where((chosen == body.object) & (t > motion.held_until_s), FAR_M, gap)

    lower, upper = around.keep_out_bounds
    gaps = _box_distances(ends.min(axis=1)[capsule], ends.max(axis=1)[capsule], lower[shape], upper[shape])
    gaps -= thick[shape, capsule][:, None]
    gaps[np.ix_(moving[capsule] == body.object, t > motion.held_until_s)] = FAR_M
    # The distance of bounding boxes decides most; only what it leaves open, or may be closest, is evaluated exactly.
    item, row = (np.array([i]) for i in divmod(int(gaps.argmin()), len(t)))
    closest = float(distance(ends[capsule[item], :, :, row], item)[0])
    undecided = max(closest, around.clearance_m + reach)
    items, rows = np.nonzero(gaps <= undecided)
    gaps[items, rows] = distance(ends[capsule[items], :, :, rows], items)
    required = around.clearance_m
    proof = prove_above(evaluate, t, gaps, rates[capsule], required, slope_bound, motion.distance_accuracy)
    met = int(shape[proof.item])
    name = f"{body.names[moving[capsule[proof.item]]]}, {around.keep_out_names[met]}"
    further = float(around.further_clearances[met])
    return _distance_check("keep_out", proof._replace(value=proof.value + further), required + further, name)


def _close_pairs(motion: MotionSamples, t: Array, ends: Array, thick: Array, reach: float) -> tuple[Index, Index]:
    """Returns the pairs of a shape and a moving capsule (p,) each that can decide a motion's clearance.

    All others stay farther apart, between the instants too, than the clearance and than one pair is at some instant.
    The bounding boxes of `TOGETHER` instants at once tell that of most.

    Args:
        motion: the motion.
        t: instants (n,) [s].
        ends: of the moving capsules there (j, 2, 3, n) [m].
        thick: what the distance of each shape from each capsule's axis is beyond their gap (b, j) [m].
        reach: the most that a capsule moves from one instant to the next [m].
    """
    around = motion.body.cell.surroundings
    starts = np.arange(0, len(t), TOGETHER)
    lowest = np.minimum.reduceat(ends.min(axis=1), starts, axis=-1)
    highest = np.maximum.reduceat(ends.max(axis=1), starts, axis=-1)
    lower, upper = (corner[:, None] for corner in around.keep_out_bounds)
    gaps = _box_distances(lowest, highest, lower, upper) - thick[..., None]
    gaps[:, -1, t[starts] > motion.held_until_s] = FAR_M
    gaps = gaps.min(axis=-1)
    shape, capsule = divmod(int(gaps.argmin()), gaps.shape[1])
    p0, p1 = np.moveaxis(ends[capsule], -1, 1)
    here = shape_distances(p0, p1, np.full(len(t), shape), around.keep_out_rows) - thick[shape, capsule]
    if capsule == gaps.shape[1] - 1:
        here[t > motion.held_until_s] = FAR_M
    shapes, capsules = np.nonzero(~(gaps > max(float(here.min()), around.clearance_m) + reach))
    return shapes, capsules


def _box_distances(lowest: Array, highest: Array, lower: Array, upper: Array) -> Array:
    """Returns the distances (..., n) of boxes with corners (..., 3, n) from boxes with corners (..., 3).

    Those of bounding boxes are lower bounds on the distances of what they bound.
    """
    apart = np.maximum(lower[..., None] - highest, lowest - upper[..., None])
    return np.sqrt((np.maximum(apart, 0.0) ** 2).sum(axis=-2))


def keep_in(motion: MotionSamples) -> Check | None:
    """Checks that the tool centre point stays in every keep-in shape; None where the cell has none.

    The depth of a point in a convex shape is concave, and changes by no more than the point moves. On the chord between
    two instants it is at least the lesser of both ends, and the point is within sup|p''| h^2/8 of the chord: the bound
    on a coordinate with a bounded second derivative holds for the depth.

    The value is the depth that leaves least beyond its clearance, and the limit that clearance; detail is the face of
    the box that is common to plain ones, or the name of another shape.
    """
    around = motion.problem.cell.surroundings
    if not around.keep_in:
        return None
    faces = _box_faces(around)
    rooms = [around.keep_in[i] for i in around.rooms]
    required = np.append(np.zeros(len(faces)), around.keep_in_clearances[around.rooms])
    names = [*faces, *(f"tool centre point, {around.keep_in_names[i]}" for i in around.rooms)]

    def inside(arm: ArmSamples) -> Array:
        p_WT = arm.p_WT
        depths = [room.depth(p_WT.T) - room_m for room, room_m in zip(rooms, required[len(faces) :], strict=True)]
        if around.box_within is None:
            return np.array(depths)
        lower, upper = (corner[:, None] for corner in around.box_within)
        return np.concatenate([p_WT - lower, upper - p_WT, np.array(depths).reshape(-1, p_WT.shape[1])])

    rates = point_bound(motion.body.tool_lever, motion.rates, 2)
    proof = motion.prove(inside, rates, 0.0, curvature_bound, motion.distance_accuracy)
    limit = float(required[proof.item])
    return _distance_check("keep_in", proof._replace(value=proof.value + limit), limit, names[proof.item])


def _box_faces(around: Surroundings) -> list[str]:
    """Returns the names of the faces of the box that is common to plain keep-in boxes; none without such."""
    return [] if around.box_within is None else [f"{axis} {side}" for side in ("lower", "upper") for axis in "xyz"]


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


def may_touch(motion: MotionSamples) -> NotChecked | None:
    """Names the pairs that the cell lets touch; None where it has none."""
    pairs = [f"{contact.a} and {contact.b}" for contact in motion.problem.cell.surroundings.may_touch]
    return NotChecked(f"may_touch ({', '.join(pairs)})") if pairs else None


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


def curves(shown: ShownMotion) -> list[Curve]:
    """Returns the curves of the least distances from floor and arm, and of those from each shape."""
    motion = shown.motion
    t = shown.t
    ends = shown.ends
    around = motion.body.cell.surroundings  # with the bin of the request
    found = [shown.of_one("floor", "m", moving_heights(motion, t, ends).min(axis=0), lower=around.clearance_m)]
    if len(motion.body.pairs):
        found.append(
            shown.of_one("self_collision", "m", pair_gaps(motion, t, ends).min(axis=0), lower=SELF_CLEARANCE_M)
        )
    if around.keep_out:
        gaps = shape_gaps(motion, t, ends).min(axis=1)
        required = (around.clearance_m + around.further_clearances).tolist()
        rows = zip(around.keep_out_names, gaps, required, strict=True)
        found.append(Curve("keep_out", "m", t, tuple(Series(*row) for row in rows)))
    if around.keep_in:
        inside = motion.body.wall_distances(ends)
        rows = zip(around.keep_in_names, inside, around.keep_in_clearances.tolist(), strict=True)
        found.append(Curve("keep_in", "m", t, tuple(Series(*row) for row in rows)))
    return found
