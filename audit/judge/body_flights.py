"""Flights of an object that is no ball, audited: where its turned shape first touches, and what it meets before."""

from __future__ import annotations

from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from audit.judge.bodies import axes_along, body_points, gaps, heights, shadow_m2
from audit.judge.distances import LENGTH_SLACK_M, coal_solid, shapes
from audit.judge.fault import AuditFault, over, under
from audit.judge.flights import (
    AIR_KG_M3,
    ANGLE_SLACK,
    GRIPPED_FRAMES,
    KEPT_OFF_FRAMES,
    LANDING_SLACK_M,
    STEP_S,
    MovingArm,
    height_below_target,
    integrate,
    is_over_top,
    since_clear,
    way_out,
    window_delays,
)
from audit.judge.pinocchio_arm import object_in_flange
from planner.cell import ThrownBody
from planner.problem import TargetRelease, ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

ADJOIN_M = 5e-4  # [m] beside a top: between two that are a millimetre apart, and so one surface, there is no edge
ROUND = 64  # [-] directions of a ball's outline as it is seen from above: off by 0.1 % of its radius
COARSE = 8  # [-] instants of which one is compared with arm and shapes: at 5 m/s the object moves by 4 cm in between


@dataclass(frozen=True, eq=False)
class BodyPath:
    """One flight of a body, a step apart from the release to a little beyond its landing.

    Attributes:
        x, R_WO: its centres (n, 3) [m] and axes (n, 3, 3).
        height: of its lowest points (n,) [m].
        count: number of instants before the landing.
        landed, axis: place of the centre (3,) [m] and z axis (3,) as it lands; NaN where it does not.
        outline: points (k, 3) [m] then, of which the balls about them of `body_points`' radius have it as their hull.
    """

    x: Vector
    R_WO: Vector
    height: Vector
    count: int
    landed: Vector
    axis: Vector
    outline: Vector


def body_flight_faults(problem: ThrowProblem, motion: Trajectory) -> list[AuditFault]:
    """Returns what is wrong with landing and flight of the first faulty release in the window."""
    arm = MovingArm(problem, motion)
    for delay in window_delays(problem):
        path = flown(problem, arm, float(delay))
        faults = [*_landing(problem, path, float(delay)), *_clearance(problem, arm, path, float(delay))]
        if faults:
            return faults
    return []


def flown(problem: ThrowProblem, arm: MovingArm, delay: float) -> BodyPath:
    """Returns the flight of a release `delay` [s] after the nominal one."""
    cell = problem.cell
    thing = cell.object
    assert isinstance(thing, ThrownBody)
    pose, v, w = arm.hand(arm.released_s + delay)
    factor = cell.gripper.release_speed_factor
    drag = AIR_KG_M3 * thing.drag_coefficient * shadow_m2(thing) / (2.0 * thing.mass_kg)
    held = pose * pin.SE3(object_in_flange(cell))
    paths = integrate(held.translation[None], factor * v[None], problem.plane_z - 0.05, 0.0, problem.gravity, drag)
    x = paths.x[:, 0]
    R_WO = axes_along(thing, held.rotation, w, np.arange(len(x), dtype=np.float64) * STEP_S)
    height = heights(thing, x, R_WO)
    in_bin = isinstance(problem.release, TargetRelease) and problem.release.opening is not None
    surface_z = problem.plane_z if in_bin else height_below_target(problem, 0.5 * float(thing.size_m.min()))
    level = x[:, 2] if surface_z is None else height
    down_to = problem.plane_z if surface_z is None else surface_z
    falls = np.arange(len(x) - 1) >= int(x[:, 2].argmax())
    met = np.flatnonzero(falls & (level[:-1] >= down_to) & (level[1:] < down_to))
    if len(met) == 0:
        nothing = np.full(3, np.nan)
        return BodyPath(x, R_WO, height, len(x), nothing, nothing, nothing[None])
    i = int(met[0])
    share = (level[i] - down_to) / (level[i] - level[i + 1])
    points, _ = body_points(thing)
    begin, end = (np.concatenate([x[k, None], points @ R_WO[k].T + x[k]]) for k in (i, i + 1))
    landed, *outline = begin + share * (end - begin)
    axis = R_WO[i, :, 2] + share * (R_WO[i + 1, :, 2] - R_WO[i, :, 2])
    return BodyPath(x, R_WO, height, i + 1, landed, axis / np.linalg.norm(axis), np.array(outline))


def body_landing_errors(problem: ThrowProblem, motion: Trajectory, delays: Vector) -> Vector:
    """Returns how far beside its target a body lands (m,) [m] for delays of the release (m,) [s]; NaN: it does not."""
    release = problem.release
    assert isinstance(release, TargetRelease)
    arm = MovingArm(problem, motion)
    landed = np.array([flown(problem, arm, float(delay)).landed for delay in delays])
    return np.linalg.norm((landed - release.p_W)[:, :2], axis=1)


def _landing(problem: ThrowProblem, path: BodyPath, delay: float) -> list[AuditFault]:
    """Returns whether the body lands off its target, or not along the axis asked for."""
    release = problem.release
    if not isinstance(release, TargetRelease):
        return []
    late = f"released {delay:+.4f} s late,"
    missed = float(np.linalg.norm((path.landed - release.p_W)[:2]))
    rule, allowed = ("landing", 0.0) if delay == 0.0 else ("landing_window", problem.landing_tolerance_m)
    found = over(rule, f"{late} lands at a distance", missed, allowed, LANDING_SLACK_M, "m")
    if release.orientation is not None:
        cosine = min(abs(float(path.axis @ release.orientation.axis_W)), 1.0)
        angle = float(np.arccos(cosine)) if np.isfinite(cosine) else np.inf
        limit = release.orientation.tolerance_rad
        found += over("landing_axis", f"{late} lands turned by", angle, limit, ANGLE_SLACK, "rad")
    return found


def _clearance(problem: ThrowProblem, arm: MovingArm, path: BodyPath, delay: float) -> list[AuditFault]:
    """Returns what the body touches before it lands, what it lands beside, and how it leaves the gripper."""
    cell = problem.cell
    thing = cell.object
    assert isinstance(thing, ThrownBody)
    around = cell.surroundings
    rows = np.unique(np.append(np.arange(0, path.count, COARSE), path.count - 1))
    x, R_WO = path.x[rows], path.R_WO[rows]
    found = [("the floor", float(path.height[: path.count].min()) - around.floor_z_m)]
    for name, shape in zip(around.keep_out_names, around.keep_out, strict=True):
        place = coal.Transform3s(shape.X_WC[:3, :3], shape.X_WC[:3, 3])
        found.append((name, float(gaps(thing, x, R_WO, coal_solid(shape), [place]).min())))
    moved = arm.at(arm.released_s + delay + STEP_S * rows)
    for shape in shapes(cell):
        places = zip(*moved.placed(shape.frame, shape.placement), strict=True)
        transforms = [coal.Transform3s(*place) for place in places]
        apart = gaps(thing, x, R_WO, shape.solid, transforms)
        counted = since_clear(apart, COARSE * STEP_S) if shape.frame in GRIPPED_FRAMES else np.ones(len(apart), bool)
        required = around.flight_clearance_m if shape.frame in KEPT_OFF_FRAMES else 0.0
        found.append((shape.name, float(apart[counted].min(initial=np.inf)) - required))
    late = f"released {delay:+.4f} s late, flight through"
    slack = LENGTH_SLACK_M
    faults = [f for name, gap in found for f in under("flight_clearance", f"{late} {name}", gap, 0.0, slack, "m")]
    faults += [*_beside(problem, path, late), *_through_wall(problem, path, late)]
    grip = [f for f in way_out(problem, arm, delay, path.x) if f.rule == "opening_direction"]
    return faults + grip


def _beside(problem: ThrowProblem, path: BodyPath, late: str) -> list[AuditFault]:
    """Returns whether a part of the body is beside what it is to land on as it touches the height of that."""
    release = problem.release
    around = problem.cell.surroundings
    if not isinstance(release, TargetRelease) or release.opening is not None or np.isnan(path.outline).any():
        return []
    thing = problem.cell.object
    assert isinstance(thing, ThrownBody)
    height = height_below_target(problem, 0.5 * float(thing.size_m.min()))
    if height is None or height <= around.floor_z_m:
        return []
    tops = [shape for shape in around.keep_out if abs(float(shape.upper[2]) - height) <= 1e-3]
    _, radius = body_points(thing)
    turn = np.linspace(0.0, 2.0 * np.pi, ROUND, endpoint=False)
    around_each = radius * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(ROUND)])
    points = (path.outline[:, None] + around_each).reshape(-1, 3)
    is_over = np.any([is_over_top(points, shape, ADJOIN_M) for shape in tops], axis=0)
    if is_over.all():
        return []
    share = float(np.mean(~is_over))
    return [AuditFault("flight_clearance", f"{late} what it is to land on: a share beside it", share, 0.0, "-")]


def _through_wall(problem: ThrowProblem, path: BodyPath, late: str) -> list[AuditFault]:
    """Returns whether the body meets a bin's wall before it touches the bottom."""
    release = problem.release
    if not isinstance(release, TargetRelease) or release.opening is None:
        return []
    thing = problem.cell.object
    assert isinstance(thing, ThrownBody)
    points, radius = body_points(thing)
    every = path.x[: path.count, None] + np.einsum("nij,pj->npi", path.R_WO[: path.count], points)
    off = np.linalg.norm(every[..., :2] - release.p_W[:2], axis=2)
    rim = release.p_W[2] + release.opening.rim_height_m
    beside = (every[..., 2] < rim) & (every[..., 2] >= release.p_W[2])
    inner = release.opening.radius_m
    meets = beside & (np.abs(off - inner) < radius - LENGTH_SLACK_M)
    meets |= beside.all(axis=1, keepdims=True) & (off > inner) & (off < inner).any(axis=1, keepdims=True)
    if not meets.any():
        return []
    return [AuditFault("flight_clearance", f"{late} the bin's wall", 0.0, 0.0, "m")]
