"""The object's flight by the audit's own means: Runge-Kutta with drag, distances of a sphere to what it can meet."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from audit.judge.arm_path import ArmPath
from audit.judge.distances import LENGTH_SLACK_M, shapes
from audit.judge.fault import AuditFault, over, under
from audit.judge.pinocchio_arm import arm_model
from planner.cell import Solid
from planner.problem import TargetRelease, ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

STEP_S = 0.001  # [s] of the integration and of the distances: at 5 m/s the object moves by 5 mm
FLIGHT_MAX_S = 10.0  # [s]
AIR_KG_M3 = 1.204  # source: ISO 2533, dry air at 20 degC and 101,325 Pa
LANDING_SLACK_M = 6e-4  # [m] the certificate's 0.5 mm, and the chord at the end
DELAYS = 21  # releases of a window that are looked at
FREE_M = 0.001  # [m] the way out of the grip counts once the object has moved by this much
AT_ONCE = 32  # instants of the way out that the arm is asked for at once
OUT_M = 0.01  # [m] the object is out of the grip once it has moved by its radius, and by this much
ANGLE_SLACK = 1e-3  # [rad] of the way out: quarter turns rounded in the URDF
CLEAR_S = 0.01  # [s] for which the object must have been clear of what gripped it before that counts as an obstacle
CARRIES_M = 1e-6  # [m] a shape that rises above the plane by less may carry the target
LEVEL_COSINE = 1.0 - 1e-8  # [-] of the angle between a level top and the horizontal
LEVEL_M = 0.001  # [m] another shape that is as high may be part of the same table
KEPT_OFF_FRAMES = (1, 2, 3)  # from shoulder to wrist 1: what the object keeps the whole flight clearance from
GRIPPED_FRAMES = (4, 5, 6)  # wrist 2, wrist 3 and tool: the object may begin inside their capsules


@dataclass(frozen=True, eq=False)
class Paths:
    """Flights of m releases on one clock, that of the trajectory shifted to each release.

    Attributes:
        x: positions (n, m, 3) [m], a step apart from the release on.
        landed: where the centres fall through the plane (m, 3) [m]; NaN where they do not.
        landed_s: how long after the release (m,) [s].
        steps: number of instants of each until the sphere touches the plane (m,).
        passed: number of instants of each until its centre falls through the plane (m,).
    """

    x: Vector
    landed: Vector
    landed_s: Vector
    steps: NDArray[np.intp]
    passed: NDArray[np.intp]


def drag_constant(problem: ThrowProblem) -> float:
    """Returns k [1/m] of a sphere's deceleration k v^2."""
    thing = problem.cell.object
    return AIR_KG_M3 * thing.drag_coefficient * np.pi * thing.radius_m**2 / (2.0 * thing.mass_kg)


def integrate(p: Vector, v: Vector, plane_z: float, radius: float, gravity: float, drag: float) -> Paths:
    """Returns the flights from positions and velocities (m, 3) until every one is below the plane z = `plane_z`."""
    states = np.concatenate([p, v], axis=1).tolist()
    rows = [states]
    while len(rows) * STEP_S < FLIGHT_MAX_S and any(s[2] >= plane_z or s[5] > 0.0 for s in states):
        states = [_stepped(s, gravity, drag) for s in states]
        rows.append(states)
    x = np.array(rows)[..., :3]
    ends = [_landing(x[:, i], plane_z, radius) for i in range(len(p))]
    return Paths(x, *(np.array(column) for column in zip(*ends, strict=True)))


def _stepped(state: list[float], gravity: float, drag: float) -> list[float]:
    """Returns position and velocity a Runge-Kutta step later; in plain numbers: an array of six takes longer."""
    k1 = _rate(state, gravity, drag)
    k2 = _rate([s + STEP_S / 2.0 * k for s, k in zip(state, k1, strict=True)], gravity, drag)
    k3 = _rate([s + STEP_S / 2.0 * k for s, k in zip(state, k2, strict=True)], gravity, drag)
    k4 = _rate([s + STEP_S * k for s, k in zip(state, k3, strict=True)], gravity, drag)
    every = zip(state, k1, k2, k3, k4, strict=True)
    return [s + STEP_S / 6.0 * (a + 2.0 * b + 2.0 * c + d) for s, a, b, c, d in every]


def _rate(state: list[float], gravity: float, drag: float) -> tuple[float, ...]:
    _, _, _, x, y, z = state
    slowed = -drag * math.sqrt(x * x + y * y + z * z)
    return x, y, z, slowed * x, slowed * y, slowed * z - gravity


def _landing(x: Vector, plane_z: float, radius: float) -> tuple[Vector, float, int, int]:
    """Returns a path's landing point (3,), its time, and how many instants are before the sphere touches and passes."""
    z = x[:, 2]
    falls = np.flatnonzero((z[:-1] >= plane_z) & (z[1:] < plane_z))
    if len(falls) == 0:
        return np.full(3, np.nan), np.nan, len(x), len(x)
    i = int(falls[-1])
    share = (z[i] - plane_z) / (z[i] - z[i + 1])
    landed = x[i] + share * (x[i + 1] - x[i])
    touches = np.flatnonzero((z[:-1] >= plane_z + radius) & (z[1:] < plane_z + radius))
    return landed, (i + share) * STEP_S, int(touches[-1]) + 1 if len(touches) else i + 1, i + 1


def ball_flight_faults(problem: ThrowProblem, motion: Trajectory) -> list[AuditFault]:
    """Returns what is wrong with landing and flight of every release in the window."""
    return [*_landings(problem, motion), *clearance_faults(problem, motion)]


def clearance_faults(problem: ThrowProblem, motion: Trajectory) -> list[AuditFault]:
    """Returns what the object touches, and how it leaves the gripper, for the first faulty release in the window."""
    delays = window_delays(problem)
    arm = MovingArm(problem, motion)
    paths = _paths(problem, motion, delays)
    is_as_fast = problem.cell.gripper.release_speed_factor == 1.0
    in_grip = paths if is_as_fast else _paths(problem, motion, delays, factor=1.0)
    for i, delay in enumerate(delays):
        faults = [*_obstacles(problem, arm, delay, paths, i), *way_out(problem, arm, delay, in_grip.x[:, i])]
        if faults:
            return [replace(fault, text=f"released {delay:+.4f} s late, {fault.text}") for fault in faults]
    return []


def ball_landing_errors(problem: ThrowProblem, motion: Trajectory, delays: Vector) -> Vector:
    """Returns how far from the target the object lands (m,) [m] for delays of the release (m,) [s].

    NaN where it does not land.
    """
    assert isinstance(problem.release, TargetRelease)
    paths = _paths(problem, motion, delays)
    landed_s = np.asarray(motion.release_time_s + delays + paths.landed_s, float)
    return np.linalg.norm(paths.landed - _target_at(problem, landed_s), axis=1)


def _target_at(problem: ThrowProblem, t: Vector) -> Vector:
    """Returns where the target is (m, 3) [m] at times of the motion (m,) [s]."""
    release = problem.release
    assert isinstance(release, TargetRelease)
    if problem.starts_at_s is None:
        return np.tile(release.p_W, (len(t), 1))
    return release.p_W + (problem.starts_at_s + t - release.at_s)[:, None] * release.v_W


def release_state(problem: ThrowProblem, motion: Trajectory) -> tuple[Vector, Vector]:
    """Returns position and velocity (3,) of the tool centre point at the release [m, m/s]."""
    p, v = MovingArm(problem, motion).tool(np.array([motion.release_time_s]))
    return p[0], v[0]


def obstacles_of_path(problem: ThrowProblem, motion: Trajectory, paths: Paths) -> list[AuditFault]:
    """Returns what the first of some paths from the nominal release touches beside the moving arm."""
    return _obstacles(problem, MovingArm(problem, motion), 0.0, paths, 0)


def window_delays(problem: ThrowProblem) -> Vector:
    """Returns the delays of the release that are looked at (n,) [s]."""
    window = problem.release_window_s if problem.is_robust else 0.0
    return np.linspace(-window, window, DELAYS) if window > 0.0 else np.zeros(1)


def _paths(problem: ThrowProblem, motion: Trajectory, delays: Vector, factor: float | None = None) -> Paths:
    """Returns the flights of an object that leaves `factor` times as fast as the tool; None: the learnt factor."""
    p, v = MovingArm(problem, motion).tool(motion.release_time_s + delays)
    v = (problem.cell.gripper.release_speed_factor if factor is None else factor) * v
    return integrate(p, v, problem.plane_z, problem.cell.object.radius_m, problem.gravity, drag_constant(problem))


def _landings(problem: ThrowProblem, motion: Trajectory) -> list[AuditFault]:
    if not isinstance(problem.release, TargetRelease):
        return []
    found = []
    delays = window_delays(problem)
    for delay, missed in zip(delays, ball_landing_errors(problem, motion, delays), strict=True):
        rule, allowed = ("landing", 0.0) if delay == 0.0 else ("landing_window", problem.landing_tolerance_m)
        found += over(rule, f"released {delay:+.4f} s late, lands at a distance", missed, allowed, LANDING_SLACK_M, "m")
    return found[:1]


def _obstacles(problem: ThrowProblem, arm: MovingArm, delay: float, paths: Paths, i: int) -> list[AuditFault]:
    """Returns what the sphere of one path touches before it lands.

    That is where it touches the floor or a shape on which the target is, or where its centre passes the plane. From the
    one to the other it goes on over what it lies on: shapes that are higher count until then.
    """
    around = problem.cell.surroundings
    radius = problem.cell.object.radius_m
    motion_s = arm.released_s
    passing = paths.x[: paths.passed[i], i]
    x = paths.x[: paths.steps[i], i]
    begins_s = motion_s + delay
    contact = _first_contact(problem, passing, begins_s)
    through = passing[:contact]
    height = height_below_target(problem, radius)
    gaps = [("the floor", float((x[:, 2] - radius).min()) - around.floor_z_m)]
    for name, shape in zip(around.keep_out_names, around.keep_out, strict=True):
        path = np.concatenate([through, _lying(problem, passing[contact:], shape, height)])
        gaps.append((name, float(_from_shape(path, shape).min()) - radius))
    for name, frame, apart in arm.gaps(through, delay):
        counted = since_clear(apart - radius) if frame in GRIPPED_FRAMES else np.ones(len(apart), bool)
        required = around.flight_clearance_m if frame in KEPT_OFF_FRAMES else 0.0
        gaps.append((name, float((apart[counted] - radius).min(initial=np.inf)) - required))
    slack = LENGTH_SLACK_M
    found = [f for name, gap in gaps for f in under("flight_clearance", f"flight through {name}", gap, 0.0, slack, "m")]
    return found + _bin(problem, _beside_bin(problem, through, begins_s), slack)


def _lying(problem: ThrowProblem, x: Vector, shape: Solid, height: float | None) -> Vector:
    """Returns where the centre of an object is that lies beside a shape, as it goes on below `x` (n, 3), and at last.

    Nowhere where the target is in the air, or for a shape that is as high as what carries it at `height` [m], or lower.
    """
    if height is None or not isinstance(problem.release, TargetRelease) or shape.upper[2] <= height + LEVEL_M:
        return np.empty((0, 3))
    x = x if problem.release.opening is None else x[:0]  # nothing is followed within a bin
    places = np.concatenate([x, [problem.release.p_W]]) - problem.aim_shift  # it lands as far beside its aim
    places[:, 2] = height + problem.cell.object.radius_m
    return places


def height_below_target(problem: ThrowProblem, radius: float) -> float | None:
    """Returns the height of what the target is on [m], the highest less than the object's radius below; None in air."""
    around = problem.cell.surroundings
    release = problem.release
    plane_z = problem.plane_z
    found = [min(around.floor_z_m, plane_z)] if plane_z - radius < around.floor_z_m else []
    if isinstance(release, TargetRelease):
        tops = [float(shape.upper[2]) for shape in around.keep_out if is_over_top(release.p_W[None], shape)[0]]
        found += [top for top in tops if -radius < top - plane_z <= CARRIES_M]
    return max(found, default=None)


def _beside_bin(problem: ThrowProblem, x: Vector, begins_s: float) -> Vector:
    """Returns a path (n, 3) that begins at a time of the motion [s] as it is beside a bin, which may move."""
    if not isinstance(problem.release, TargetRelease):
        return x
    times_s = np.asarray(begins_s + STEP_S * np.arange(len(x)), float)
    return x - _target_at(problem, times_s) + problem.release.p_W


def _first_contact(problem: ThrowProblem, x: Vector, begins_s: float) -> int:
    """Returns how many instants of a path (n, 3) are before the sphere touches what the target is on.

    Another shape that is as high may be part of the same table. The path begins at a time of the motion [s].
    """
    around = problem.cell.surroundings
    landed = np.zeros(len(x), bool)
    radius = problem.cell.object.radius_m
    height = height_below_target(problem, radius)
    if height is None:
        return len(x)
    surfaces = [(height, np.full(len(x), height <= around.floor_z_m + CARRIES_M))]
    surfaces += [(top, is_over_top(x, b)) for b in around.keep_out if abs((top := b.upper[2]) - height) <= LEVEL_M]
    falls = np.arange(len(x)) >= int(x[:, 2].argmax())
    for top, is_over in surfaces:
        landed |= falls & (x[:, 2].max() >= top + radius) & (x[:, 2] < top + radius) & is_over
    if isinstance(problem.release, TargetRelease) and problem.release.opening is not None:  # within the bin's wall
        beside = _beside_bin(problem, x, begins_s)
        landed &= np.linalg.norm(beside[:, :2] - problem.release.p_W[:2], axis=1) < problem.release.opening.radius_m
    return int(landed.argmax()) if landed.any() else len(x)


def is_over_top(x: Vector, shape: Solid, beside_m: float = 0.0) -> NDArray[np.bool_]:
    """Returns whether points (n, 3) are over a shape that an object can lie on, within it, or so little beside [m]."""
    upright = np.abs(shape.X_WC[2, :3]) > LEVEL_COSINE
    if shape.kind in ("sphere", "capsule") or not (upright[2] if shape.kind == "cylinder" else upright.any()):
        return np.zeros(len(x), bool)
    middle = np.column_stack([x[:, :2], np.full(len(x), shape.X_WC[2, 3])])
    return _from_shape(middle, shape) <= beside_m


def _from_shape(x: Vector, shape: Solid) -> Vector:
    """Returns the distances (n,) [m] of points (n, 3) from a shape; within it the negative depth."""
    y = (x - shape.X_WC[:3, 3]) @ shape.X_WC[:3, :3]
    half = 0.5 * shape.extent
    if shape.kind in ("sphere", "capsule"):
        straight = half[2] - half[0]
        y[:, 2] -= np.clip(y[:, 2], -straight, straight)
        return np.linalg.norm(y, axis=1) - half[0]
    beyond = np.abs(y) - half
    if shape.kind == "cylinder":
        beyond = np.column_stack([np.hypot(y[:, 0], y[:, 1]) - half[0], beyond[:, 2]])
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def way_out(problem: ThrowProblem, arm: MovingArm, delay: float, x: Vector) -> list[AuditFault]:
    """Returns whether the way of the object in the tool leaves the gripper's opening cone before the object is out."""
    gripper = problem.cell.gripper
    out_m = max(problem.cell.object.radius_m, OUT_M)
    if gripper.opening_direction is None or gripper.opening_cone_rad is None:
        return []
    for begin in range(1, len(x), AT_ONCE):
        places = x[begin : begin + AT_ONCE]
        after_s = np.asarray((begin + np.arange(len(places))) * STEP_S + delay, float)
        for k, moved in enumerate(arm.in_tool(places, after_s), start=begin):
            if np.linalg.norm(moved) >= out_m:
                return []
            if np.linalg.norm(moved) < FREE_M:
                continue
            angle = float(np.arccos(np.clip(moved @ gripper.opening_direction / np.linalg.norm(moved), -1.0, 1.0)))
            text = f"leaves the gripper aside after {k * STEP_S} s"
            if found := over("opening_direction", text, angle, gripper.opening_cone_rad, ANGLE_SLACK, "rad"):
                return found
    return []


def since_clear(gaps: Vector, step_s: float = STEP_S) -> NDArray[np.bool_]:
    """Returns which instants (n,) count for a body that held the object: those after it was clear for `CLEAR_S`."""
    steps = round(CLEAR_S / step_s)
    clear = np.convolve(gaps > 0.0, np.ones(steps), "full")[: len(gaps)] >= steps
    return np.maximum.accumulate(clear) if len(gaps) else clear


def _bin(problem: ThrowProblem, x: Vector, slack: float) -> list[AuditFault]:
    """Returns whether the sphere touches a bin's wall before its centre passes the mouth, or passes outside it."""
    release = problem.release
    radius = problem.cell.object.radius_m
    if not isinstance(release, TargetRelease) or release.opening is None:
        return []
    inner = release.opening.radius_m
    rim = release.p_W[2] + release.opening.rim_height_m
    falls = np.flatnonzero((x[:-1, 2] >= rim) & (x[1:, 2] < rim))
    last = int(falls[-1]) + 1 if len(falls) else len(x) - 1
    before = x[: last + 1]
    off = np.linalg.norm(x[: last + 1, :2] - release.p_W[:2], axis=1)
    gap = np.hypot(off - inner, np.maximum(before[:, 2] - rim, 0.0))
    inside = (before[:, 2] < release.p_W[2]) & (off > inner)  # below the bottom's height, outside: no wall there
    gap = np.where(inside, np.inf, gap).min() - radius
    beside = (before[:, 2] < rim) & (before[:, 2] >= release.p_W[2])  # at a height at which there is a wall
    passed = np.diff(off > inner) & beside[:-1] & beside[1:]  # of a point the gap is 0 there
    gap = (-np.abs(np.diff(off))[passed]).min(initial=gap)
    found = under("flight_clearance", "flight through the bin's wall", float(gap), 0.0, slack, "m")
    found += _through_bottom(x, release.p_W, inner)
    if len(falls):
        share = (x[last - 1, 2] - rim) / (x[last - 1, 2] - x[last, 2])
        entry = np.linalg.norm((x[last - 1] + share * (x[last] - x[last - 1]))[:2] - release.p_W[:2])
        found += over("bin_mouth", "enters the bin beside its axis", float(entry), inner - radius, slack, "m")
    elif release.opening.rim_height_m < radius:  # it lies on the bottom with its centre above the rim
        found += over("bin_mouth", "comes to the bottom beside the bin's axis", float(off[-1]), inner, slack, "m")
    elif x[-1, 2] - rim > x[-2, 2] - x[-1, 2] or off[-1] > inner:  # it ends where the sphere touches, within a step
        found.append(
            AuditFault("bin_mouth", "never passes the bin's mouth, ends at a height", float(x[-1, 2]), rim, "m")
        )
    return found


def _through_bottom(x: Vector, bottom: Vector, radius_m: float) -> list[AuditFault]:
    """Returns whether centres come up through a bin's bottom, within its wall."""
    above = x[:, 2] >= bottom[2]
    inside = np.linalg.norm(x[:, :2] - bottom[:2], axis=1) < radius_m
    rises = np.flatnonzero(~above[:-1] & above[1:] & inside[:-1] & inside[1:])
    text = "comes up through the bin's bottom, from"
    return [AuditFault("bin_mouth", text, float(x[k, 2]), float(bottom[2]), "m") for k in rises[:1]]


class MovingArm:
    """Pinocchio's arm along a motion; after its end it rests."""

    def __init__(self, problem: ThrowProblem, motion: Trajectory) -> None:
        self._cell = problem.cell
        self._motion = motion
        self._spline = CubicHermiteSpline(motion.t, motion.q, motion.qd)
        self._model = arm_model(problem.cell, False)

    def at(self, t: Vector) -> ArmPath:
        """Returns the arm at times (n,) [s]."""
        inside = np.clip(t, 0.0, self._motion.duration_s)
        return ArmPath.of(self._cell, self._model, self._spline(inside), self._spline(inside, 1))

    @property
    def released_s(self) -> float:
        """Time of the nominal release [s]."""
        return self._motion.release_time_s

    def hand(self, t: float) -> tuple[pin.SE3, Vector, Vector]:
        """Returns the pose of the flange, and the tool's linear and angular velocity (3,) [m/s, rad/s], at a time."""
        arm = self.at(np.array([t]))
        return pin.SE3(arm.R[0, 6], arm.p[0, 6]), arm.v[0], arm.w[0]

    def tool(self, t: Vector) -> tuple[Vector, Vector]:
        """Returns positions and velocities (m, 3) of the tool centre point at times (m,) [s]."""
        arm = self.at(t)
        return arm.points(6, self._cell.tool.X_FT[None, :3, 3])[:, 0], arm.v

    def in_tool(self, x: Vector, after_s: Vector) -> Vector:
        """Returns places (n, 3) of the world in the axes of the tool, from its centre point, after the release [m]."""
        arm = self.at(self._motion.release_time_s + after_s)
        X_FT = self._cell.tool.X_FT
        in_flange = np.einsum("nij,ni->nj", arm.R[:, 6], x - arm.p[:, 6])
        return (in_flange - X_FT[:3, 3]) @ X_FT[:3, :3]

    def gaps(self, x: Vector, delay: float) -> list[tuple[str, int, Vector]]:
        """Returns name, frame and distance (n,) [m] of each body from the path's points `x` (n, 3)."""
        times = np.asarray(self._motion.release_time_s + delay + STEP_S * np.arange(len(x)), float)
        moving = int(np.searchsorted(times, self._motion.duration_s)) + 1
        arm = self.at(times[:moving]).rows(np.minimum(np.arange(len(x)), moving - 1))
        rows = []
        for shape in shapes(self._cell):
            ends = arm.points(shape.frame, shape.ends)
            along = ends[:, 1] - ends[:, 0]
            square = np.maximum((along**2).sum(axis=1), 1e-30)
            share = np.clip(((x - ends[:, 0]) * along).sum(axis=1) / square, 0.0, 1.0)
            nearest = ends[:, 0] + share[:, None] * along
            rows.append((shape.name, shape.frame, np.linalg.norm(x - nearest, axis=1) - shape.radius_m))
        return rows
