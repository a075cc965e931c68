"""Dense check of an object's flight, apart from the certificate: by Pinocchio, splines and numerical integration."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from benchmarks.audit.pinocchio_arm import arm_model, poses_and_velocity
from planner.cell import Box
from planner.geometry import body_capsules
from planner.problem import Opening, TargetRelease, ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

PATH_STEP_S, ARM_STEP_S = 0.0005, 0.004  # [s] grids of the flight, and of its distance from the arm
RELEASES = 9  # releases tried in a window
SLACK_M = 5e-4  # [m] of distances, from the grids
FLIGHT_MAX_S = 5.0  # [s]
AIR_DENSITY = 1.204  # [kg/m^3] source: ISO 2533, 20 degC
TOOL_FRAME = 6  # shapes of the flange's frame are the tool's, which the object starts inside of


def flight_faults(problem: ThrowProblem, motion: Trajectory) -> list[str]:
    """Returns what the object touches on its way, over the whole release window, in words."""
    window = problem.release_window_s if problem.is_robust else 0.0
    spline = CubicHermiteSpline(motion.t, motion.q, motion.qd)
    model = arm_model(problem.cell, False)
    data = model.createData()
    found: dict[str, str] = {}
    for delay in np.linspace(-window, window, RELEASES if window else 1):
        start = motion.release_time_s + delay
        poses, v = poses_and_velocity(problem.cell, model, data, spline(start), spline(start, 1))
        p = poses[6].act(problem.cell.tool.X_FT[:3, 3])
        t, x = _path(problem, p, v)
        for fault in [*_surroundings(problem, x), *_arm(problem, spline, motion.duration_s, start, t, x, data, model)]:
            found.setdefault(fault.split(":")[0], f"{fault} released {delay * 1e3:+.0f} ms")
    return list(found.values())


def _path(problem: ThrowProblem, p: Vector, v: Vector) -> tuple[Vector, Vector]:
    """Returns times (n,) and centres (n, 3) until the sphere touches the landing plane from above."""
    thing = problem.cell.object
    k = 0.5 * AIR_DENSITY * thing.drag_coefficient * np.pi * thing.radius_m**2 / thing.mass_kg

    def rate(_: float, x: Vector) -> Vector:
        pull = np.array([0.0, 0.0, -problem.gravity]) - k * np.linalg.norm(x[3:]) * x[3:]
        return np.concatenate([x[3:], pull])

    t = np.arange(0.0, FLIGHT_MAX_S, PATH_STEP_S)
    x = solve_ivp(rate, (0.0, FLIGHT_MAX_S), np.concatenate([p, v]), t_eval=t, rtol=1e-9, atol=1e-10).y.T
    low = (x[:, 2] <= problem.plane_z + thing.radius_m) & (x[:, 5] < 0.0)
    n = int(np.argmax(low)) if low.any() else len(x)
    return t[:n], x[:n, :3]


def _surroundings(problem: ThrowProblem, x: Vector) -> list[str]:
    radius, around, release = problem.cell.object.radius_m, problem.cell.surroundings, problem.release
    gaps = {f"box {i}": _box_gap(box, x) - radius for i, box in enumerate(around.keep_out)}
    gaps["floor"] = float((x[:, 2] - around.floor_z_m).min(initial=np.inf)) - radius
    if isinstance(release, TargetRelease) and release.opening is not None:
        gaps["bin"] = _wall_gap(release.opening, release.p_W, x) - radius
    return [f"{name}: {gap * 1e3:.1f} mm" for name, gap in gaps.items() if gap < -SLACK_M]


def _box_gap(box: Box, x: Vector) -> float:
    return float(np.linalg.norm(x - np.clip(x, box.lower, box.upper), axis=1).min(initial=np.inf))


def _wall_gap(opening: Opening, centre: Vector, x: Vector) -> float:
    """Returns the least distance of the centres (n, 3) from the bin's wall, a vertical cylinder without thickness."""
    out = np.hypot(*(x - centre)[:, :2].T) - opening.radius_m
    return float(np.hypot(out, np.maximum(x[:, 2] - centre[2] - opening.rim_height_m, 0.0)).min(initial=np.inf))


def _arm(
    problem: ThrowProblem,
    spline: CubicHermiteSpline,
    end_s: float,
    start_s: float,
    t: Vector,
    x: Vector,
    data: pin.Data,
    model: pin.Model,
) -> list[str]:
    """Returns the links that the object meets while they move on."""
    found, every = [], round(ARM_STEP_S / PATH_STEP_S)
    shapes = [c for c in body_capsules(problem.cell.robot, problem.cell.tool.capsules) if c.frame < TOOL_FRAME]
    for i in range(0, len(t), every):
        poses, _ = poses_and_velocity(problem.cell, model, data, spline(min(start_s + t[i], end_s)), np.zeros(6))
        for c in shapes:
            a, b = poses[c.frame].act(c.p0), poses[c.frame].act(c.p1)
            along = b - a
            share = np.clip((x[i] - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
            gap = float(np.linalg.norm(x[i] - a - share * along)) - c.radius_m - problem.cell.object.radius_m
            if gap < -SLACK_M:
                found.append(f"{c.name}: {gap * 1e3:.1f} mm")
    return found
