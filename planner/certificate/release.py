"""Checks of the release state, of the landing, and of the landing after a late or early release."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from planner.arrays import Array, Index
from planner.certificate.bounds import curvature_bound, joint_rates, prove_above
from planner.certificate.certificate import ROUNDING, Check, at_least, at_most
from planner.certificate.samples import ArmSamples, MotionSamples
from planner.certificate.touchdown import LandingCells, prove, touchdowns_of
from planner.flight import Flight, LandingStates, fly, landing_states
from planner.geometry import ToolState, tool_state
from planner.problem import ThrowProblem
from planner.releases import Bound, Release, ReleaseSample
from planner.rotations import pose
from planner.trajectory import Trajectory

RELEASE_POSITION_TOLERANCE = 1e-5  # [m, rad] less than a third of a UR's repeatability, 0.03 mm
RELEASE_VELOCITY_TOLERANCE = 1e-4  # [m/s, rad/s] 0.1 mm of landing for a flight of one second
GRAZES = "grazes the plane, so that nothing bounds the landings between those evaluated, of which this is the worst"
RELEASED_IN_TIME = "released in time"
LANDING_TOLERANCE_M = 5e-4  # [m] of the nominal release; far below the scatter of a gripper


def release_flight(problem: ThrowProblem, trajectory: Trajectory) -> Flight | None:
    """Returns the flight of the object from the release; None if nothing is thrown, or if it never lands."""
    if not problem.throws:
        return None
    k = trajectory.release_index
    state = tool_state(problem.cell, trajectory.q[k], trajectory.qd[k])
    whole = _flown(problem, state.p_WT, state.v_WT)
    if whole is None or problem.body is None:
        return whole
    released = MotionSamples(problem, trajectory).at(np.array([trajectory.release_time_s]))
    landed = _landed(problem, released)
    if np.isnan(landed.time_s[0]):
        return None
    return replace(
        whole,
        landing_point=landed.p[0],
        landing_velocity=landed.v[0],
        time_of_flight_s=float(landed.time_s[0]),
    )


def _flown(problem: ThrowProblem, p_WT: Array, v_WT: Array) -> Flight | None:
    """Returns the flight of the centre from a state of the tool centre point, both (3,), to the landing plane."""
    leaves = problem.release_speed_factor * v_WT
    return fly(p_WT, leaves, problem.plane_z, problem.gravity, problem.drag)


def release_position(motion: MotionSamples) -> Check | None:
    """Checks the place of the release; None where it is free, or where passages without a release are asked for."""
    if motion.problem.passages and not motion.problem.throws:
        return None
    return position_at("release_position", motion, motion.problem.release, motion.trajectory.release_index)


def release_velocity(motion: MotionSamples) -> Check | None:
    """Checks the velocity of the release; None where it is free, or where passages without a release are asked for."""
    if motion.problem.passages and not motion.problem.throws:
        return None
    return velocity_at("release_velocity", motion, motion.problem.release, motion.trajectory.release_index)


def position_at(name: str, motion: MotionSamples, asked: Release, index: int) -> Check | None:
    """Returns the check of the place at a sample that is a knot; None where it is free."""
    bounds = asked.position_bounds(_sample(motion, index))
    return _tightest(name, bounds, RELEASE_POSITION_TOLERANCE, index / motion.trajectory.sample_rate_hz)


def velocity_at(name: str, motion: MotionSamples, asked: Release, index: int) -> Check | None:
    """Returns the check of the velocity at a sample that is a knot; None where it is free."""
    bounds = asked.velocity_bounds(_sample(motion, index))
    return _tightest(name, bounds, RELEASE_VELOCITY_TOLERANCE, index / motion.trajectory.sample_rate_hz)


def _sample(motion: MotionSamples, row: int) -> ReleaseSample:
    """Returns the motion at a sample that is a knot."""
    k = int(np.searchsorted(motion.knots, row))
    arm = motion.at_knots
    R_WT = arm.X_WL[k, 6, :3, :3] @ motion.problem.cell.tool.X_FT[:3, :3]
    V_WT = np.concatenate([arm.v_WT[:, k], arm.links.angular_velocity[:, 5, k]])
    tool = ToolState(pose(arm.p_WT[:, k], R_WT), V_WT)
    return ReleaseSample(motion.trajectory.q[row], motion.trajectory.qd[row], tool)


def _tightest(name: str, bounds: Sequence[Bound], tolerance: float, at_s: float) -> Check | None:
    """Returns the check of the bound that is kept least; None without bounds.

    Args:
        name: of the check.
        bounds: on the release.
        tolerance: by which those that are not exact may be exceeded.
        at_s: time of the release [s].
    """
    checks = []
    for bound in bounds:
        room = 0.0 if bound.is_exact else tolerance
        if bound.is_least:
            checks.append(at_least(name, bound.value, bound.limit - room, bound.unit, at_s, bound.detail))
        else:
            checks.append(at_most(name, bound.value, bound.limit + room, bound.unit, at_s, bound.detail))
    return min(checks, key=lambda check: (check.ok, check.margin), default=None)


def landing(motion: MotionSamples) -> Check | None:
    """Checks that the object lands on the target after the nominal release; None where there is no target."""
    problem = motion.problem
    target = problem.target
    k = motion.release_knot
    if target is None:
        return None
    if problem.body is not None:
        landed = _landed(problem, motion.at(np.array([motion.trajectory.release_time_s])))
        miss = float(np.nan_to_num(np.linalg.norm(landed.p[0] - target.p_W), nan=math.inf))
        return at_most("landing", miss, LANDING_TOLERANCE_M, "m", motion.trajectory.release_time_s)
    p = motion.at_knots.p_WT[:, k]
    v = motion.at_knots.v_WT[:, k]
    flight = _flown(problem, p, v)
    released_s = motion.trajectory.release_time_s
    if flight is None:
        return at_most("landing", math.inf, LANDING_TOLERANCE_M, "m", released_s)
    lands_s = released_s + flight.time_of_flight_s
    there = target.p_W
    if target.moves and problem.starts_at_s is not None:
        there = target.p_W + (problem.starts_at_s + lands_s - target.at_s) * target.v_W
    miss = float(np.linalg.norm(flight.landing_point - there))
    if target.moves and (late := _while_kept_clear(problem, lands_s, motion.trajectory.duration_s)) is not None:
        return late
    return at_most("landing", miss, LANDING_TOLERANCE_M, "m", released_s)


def _while_kept_clear(problem: ThrowProblem, lands_s: float, ends_s: float) -> Check | None:
    """Returns the refusal of a motion that is not over while the arm keeps out of the path of the target; else None.

    Args:
        problem: with a target that moves.
        lands_s, ends_s: landing and end of the motion, from its start [s].
    """
    before_s, after_s = problem.swept_s
    path = "the arm keeps out of the target's path for so long"
    if lands_s > before_s:
        return at_most("landing", lands_s, before_s, "s", lands_s, f"from the start to the landing: {path}")
    if ends_s - lands_s > after_s:
        return at_most("landing", ends_s - lands_s, after_s, "s", ends_s, f"from the landing to rest: {path}")
    return None


def landing_axis(motion: MotionSamples) -> Check | None:
    """Checks how the object lies as it lands on the target, after a release at any instant of the window.

    None where any way will do. Between evaluated instants: see `planner.certificate.touchdown`.
    """
    problem = motion.problem
    asked = None if problem.target is None else problem.target.orientation
    if asked is None:
        return None
    limit = asked.tolerance_rad * (1.0 + ROUNDING)

    def judge(cells: LandingCells) -> tuple[Array, Array]:
        landings = cells.touchdowns
        return limit - asked.angles(landings.axes_at(landings.time_s)[:, :, 2]), cells.turned_rad

    proof, _ = prove(motion, problem.planned_window_s, judge, motion.share_accuracy)
    angle = float(np.nan_to_num(limit - proof.value, nan=math.inf))
    check = at_most("landing_axis", angle, asked.tolerance_rad, "rad", proof.at_s, "from the axis asked for")
    return check.provided(proof.proven)


def landing_attitude(problem: ThrowProblem, trajectory: Trajectory) -> Array | None:
    """Returns the object's axes in the world (3, 3) as it lands after the nominal release; None of a ball."""
    if not problem.throws or problem.body is None:
        return None
    arm = MotionSamples(problem, trajectory).at(np.array([trajectory.release_time_s]))
    landings = touchdowns_of(problem, arm)
    return None if np.isnan(landings.time_s[0]) else landings.axes_at(landings.time_s)[0]


def _body_window(motion: MotionSamples, goal: Array) -> Check:
    """Returns the check of the landing of a body, see `landing_window`."""
    problem = motion.problem
    limit = problem.landing_tolerance_m * (1.0 + ROUNDING)

    def judge(cells: LandingCells) -> tuple[Array, Array]:
        landings = cells.touchdowns
        off = landings.centres_at(landings.time_s)[:, :2] - goal[:2]
        return limit - np.linalg.norm(off, axis=1), cells.aside_m

    proof, _ = prove(motion, problem.release_window_s, judge, motion.distance_accuracy)
    if math.isnan(proof.value):
        return at_most("landing_window", math.inf, problem.landing_tolerance_m, "m", proof.at_s, "never lands")
    delay_s = proof.at_s - motion.trajectory.release_time_s
    check = at_most(
        "landing_window", limit - proof.value, problem.landing_tolerance_m, "m", proof.at_s, _delayed(delay_s)
    )
    return check.provided(proof.proven)


def _delayed(delay_s: float) -> str:
    """Returns in words how late a release is [s]."""
    delay_ms = 1e3 * delay_s
    return f"released {abs(delay_ms):.3g} ms {'late' if delay_ms > 0.0 else 'early'}" if delay_ms else RELEASED_IN_TIME


def landing_window(motion: MotionSamples) -> Check | None:
    """Checks the landing after a release at any instant of the window; None where no window is requested.

    Between evaluated instants the landing point L deviates from its chord by at most sup|L''| h^2/8.
    """
    problem = motion.problem
    released = motion.trajectory.release_time_s
    if not problem.is_robust:
        return None
    tolerance = problem.landing_tolerance_m
    most = tolerance * (1.0 + ROUNDING)
    goal = _nominal_landing(problem, motion.trajectory)
    if problem.body is not None:
        return _body_window(motion, goal)

    def room(arm: ArmSamples) -> Array:
        return most - problem.start_slack_m - np.linalg.norm(_landed_beside(motion, arm) - goal, axis=1)

    def evaluate(t: Array, item: Index) -> Array:
        return room(motion.at(t))

    arm = motion.in_window
    rooms = room(arm)
    curvature = _landing_curvature(motion, arm)
    if not np.isfinite(rooms).all():
        return at_most("landing_window", math.inf, tolerance, "m", released, "never lands")
    if not math.isfinite(curvature):
        error = most - rooms.min()
        at_s = float(arm.t[rooms.argmin()])
        return at_most("landing_window", error, tolerance, "m", at_s, GRAZES).provided(False)
    proof = prove_above(
        evaluate, arm.t, rooms[None], np.array([curvature]), 0.0, curvature_bound, motion.distance_accuracy
    )
    error = most - proof.value
    detail = _delayed(proof.at_s - released)
    return at_most("landing_window", error, tolerance, "m", proof.at_s, detail).provided(proof.proven)


def landing_height(problem: ThrowProblem, trajectory: Trajectory) -> float:
    """Returns the height of the object's centre as it lands after the nominal release [m]: a ball's landing plane.

    That of a body at its touch; its landing plane where it has none.
    """
    if problem.body is None or not problem.throws:
        return problem.plane_z
    arm = MotionSamples(problem, trajectory).at(np.array([trajectory.release_time_s]))
    landings = touchdowns_of(problem, arm)
    height = float(landings.centres_at(landings.time_s)[0, 2])
    return problem.plane_z if math.isnan(height) else height


def landing_errors(problem: ThrowProblem, trajectory: Trajectory, delays: Array) -> Array:
    """Returns the landing errors (k,) [m] of releases `delays` (k,) [s] after the nominal one.

    They are distances from the target, or without a target from the landing point of the nominal release.
    """
    points = window_landing_points(problem, trajectory, delays)
    return np.linalg.norm(points - _nominal_landing(problem, trajectory), axis=1)


def window_landing_points(problem: ThrowProblem, trajectory: Trajectory, delays: Array) -> Array:
    """Returns the landing points (k, 3) [m] of releases `delays` (k,) [s] after the nominal one; NaN where none.

    Beside a target that moves they are as it carries them: less its way since the landing of the nominal release.
    """
    motion = MotionSamples(problem, trajectory)
    return _landed_beside(motion, motion.at(trajectory.release_time_s + delays))


def _landed_beside(motion: MotionSamples, arm: ArmSamples) -> Array:
    """Returns the landing points (k, 3) [m] after a release at each instant, as a target that moves carries them."""
    landed = _landed(motion.problem, arm)
    target = motion.problem.moving
    nominal = None if target is None else release_flight(motion.problem, motion.trajectory)
    if target is None or nominal is None:
        return landed.p
    later_s = arm.t + landed.time_s - motion.trajectory.release_time_s - nominal.time_of_flight_s
    return landed.p - later_s[:, None] * target.v_W


@lru_cache(maxsize=1)  # of the window, for its landings and the bound between them
def _landed(problem: ThrowProblem, arm: ArmSamples) -> LandingStates:
    """Returns the landings (k,) after a release at each instant; NaN where the object never lands.

    That of a body is its centre's place at the touch, on the landing plane: see `planner.touchdown`.
    """
    if problem.body is not None:
        landings = touchdowns_of(problem, arm)
        time_s = landings.time_s
        x = landings.centres_at(time_s)
        x[:, 2] = np.where(np.isnan(time_s), np.nan, problem.plane_z)
        step_s = 1e-6
        v = (landings.centres_at(time_s + step_s) - landings.centres_at(time_s - step_s)) / (2.0 * step_s)
        return LandingStates(x, v, time_s)
    leaves = problem.release_speed_factor * arm.v_WT.T
    return landing_states(arm.p_WT.T, leaves, problem.plane_z, problem.gravity, problem.drag)


def _nominal_landing(problem: ThrowProblem, trajectory: Trajectory) -> Array:
    if problem.target is not None:
        return problem.target.p_W
    flight = release_flight(problem, trajectory)
    return np.full(3, np.nan) if flight is None else flight.landing_point


def _landing_curvature(motion: MotionSamples, arm: ArmSamples) -> float:
    """Returns sup |L''| [m/s^2] of the landing point by the time of the release, over the window sampled by `arm`.

    The flight x(t) from a release at p with velocity v obeys x'' = F(x') with F(w) = -k |w| w - g, so that it is
    p + xi(t; v). F' is symmetric with eigenvalues -k|w| and -2k|w|, none above 0: velocities approach each other, and
    |dw/dv| <= 1, |d xi/dv| <= t. |F''| <= 2k: |d^2 w/dv^2| <= 2 k t, |d^2 xi/dv^2| <= k t^2. With bounds A, J on the
    acceleration and jerk of the tool, V on its speed, all three also times the release speed factor, T on the time of
    flight, and at the landing W on the speed, w on the downward speed (from below) and G = max(g, k W^2) on the
    vertical acceleration, differentiation of z(t, v) = plane by the time of the release gives
        |t'|  <= (V + A T) / w =: t1
        |t''| <= (X + 2 A t1 + G t1^2) / w =: t2   with X = A + J T + k (A T)^2 >= |d^2 x|
        |L''| <= X + 2 A t1 + k W^2 t1^2 + V t2,
    because drag only slows the horizontal motion. Beside a target at the speed u the landing moves by u t' more, and
    its bound grows by u t2. T and w between samples: see `_between_landings`.
    """
    problem = motion.problem
    trajectory = motion.trajectory
    gravity = problem.gravity
    drag = problem.drag
    landed = _landed(problem, arm)
    if np.isnan(landed.time_s).any():
        return math.inf
    reach = math.ceil(problem.release_window_s * trajectory.sample_rate_hz) + 1
    k = trajectory.release_index
    rates = joint_rates(trajectory, np.array([max(0, k - reach), min(len(trajectory.q) - 1, k + reach)]))
    most = max(1.0, problem.release_speed_factor)  # of tool and object, whichever is faster
    _, a, j, _ = (most * (motion.body.tool_lever @ rates.by_derivative)[:, 0]).tolist()
    half = float(np.diff(arm.t).max()) / 2.0
    speed = most * float(np.sqrt((arm.v_WT**2).sum(axis=0).max())) + a * half
    height = max(0.0, float(arm.p_WT[2].max()) + speed * half - problem.plane_z)
    fastest = speed**2 + 2.0 * gravity * height  # square of the landing speed without drag, which only slows
    g = max(gravity, drag * fastest)
    time, w = _between_landings(landed, (a, speed, g), half)
    if not w > 0.0:
        return math.inf
    t1 = (speed + a * time) / w
    x = a + j * time + drag * (a * time) ** 2
    t2 = (x + 2.0 * a * t1 + g * t1**2) / w
    carried = 0.0 if problem.moving is None else float(np.linalg.norm(problem.moving.v_W))
    return x + 2.0 * a * t1 + drag * fastest * t1**2 + (speed + carried) * t2


def _between_landings(landed: LandingStates, bounds: tuple[float, float, float], half: float) -> tuple[float, float]:
    """Returns bounds on flight time [s] and downward landing speed [m/s] also between samples; a speed of 0: none.

    Over `half` [s] they change by at most |t'| half and (A + G |t'|) half, where |t'| depends on them again: twice the
    change by the sampled values is assumed, and then must suffice.
    """
    (a, speed, g) = bounds
    time = float(landed.time_s.max())
    w = float((-landed.v[:, 2]).min())
    if not w > 0.0:
        return time, 0.0
    later = 2.0 * half * (speed + a * time) / w
    slower = 2.0 * half * a + g * later
    if not w > slower:
        return time, 0.0
    t1 = (speed + a * (time + later)) / (w - slower)
    holds = half * t1 <= later and half * (a + g * t1) <= slower
    return time + later, w - slower if holds else 0.0
