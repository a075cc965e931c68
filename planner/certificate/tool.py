"""Checks of the tool's speed and of the distance to singularities near the release."""

from __future__ import annotations

import math

import numpy as np

from planner.arrays import Array, Index
from planner.certificate.bounds import Rates, curvature_bound, joint_rates, point_bound, prove_above
from planner.certificate.certificate import ROUNDING, Check, NotChecked, at_least, at_most
from planner.certificate.loads import watched_levers
from planner.certificate.samples import ArmSamples, MotionSamples, ticks_around
from planner.certificate.shown import Curve, Series, ShownMotion
from planner.dynamics import WatchedPoint, tool_points
from planner.kinematics import SINGULARITIES, signed_singularity_distances
from planner.robots import Robot

SINGULARITY_WINDOW_S = 0.05  # [s] before and after the release, in which Cartesian motion must stay controllable


def tcp_speed(motion: MotionSamples) -> Check:
    """Checks the speed of the tool centre point, and that of the flange where the cell gives the arm's own tool speed.

    The flange is reported only where it is too fast.
    """
    cell, levers = motion.problem.cell, watched_levers(motion.problem.cell)
    tool, flange = tool_points(cell)
    check = _speed(motion, tool, levers.tool, motion.tool_speed_max)
    if cell.safety.tool_speed_m_s is None or not check.ok:
        return check
    of_flange = _speed(motion, flange, levers.flange, cell.safety.tool_speed_m_s)
    return check if of_flange.ok else of_flange


def tool_speed(motion: MotionSamples) -> NotChecked | None:
    """Says that the cell gives no tool speed of the arm's own, so that of the flange is not limited.

    Where it does, `tcp_speed` checks both.
    """
    return NotChecked("tool_speed") if motion.problem.cell.safety.tool_speed_m_s is None else None


def _speed(motion: MotionSamples, point: WatchedPoint, lever: Array, limit: float) -> Check:
    def room(arm: ArmSamples) -> Array:
        return limit - (arm.tool_speed if point is tool_points(arm.cell)[0] else arm.flange_speed)[None]

    rates = point_bound(lever, motion.rates, 3)
    # |v| is at most that of the chord of v, plus the deviation of v from it: the curvature bound of v serves.
    proof = motion.prove(room, rates, -limit * ROUNDING, curvature_bound, motion.share_accuracy * limit)
    return at_most("tcp_speed", limit - proof.value, limit, "m/s", proof.at_s, point.name).provided(proof.proven)


def singularity_distance(motion: MotionSamples) -> Check | None:
    """Checks the distance to all three singularities around the release, or around every passage at speed.

    Around a line that is all along it. None for a move that ends at rest.
    """
    problem = motion.problem
    trajectory = motion.trajectory
    released = trajectory.release_index
    spans = [] if problem.ends_at_rest else [(released, released)]
    if problem.passages:
        moving = zip(problem.passages, trajectory.passed, strict=False)
        rate_hz = trajectory.sample_rate_hz
        spans = [(index, index + each.ticks(rate_hz)) for each, index in moving if not each.state.is_at_rest]
    found = [_singularity_distance(motion, *span) for span in spans]
    return min(found, key=lambda check: (check.ok, check.margin), default=None)


def _singularity_distance(motion: MotionSamples, index: int, until: int) -> Check:
    """Returns the check of the distance to singularities around a sample, or from one to another."""
    problem = motion.problem
    trajectory = motion.trajectory
    required = motion.limits.singularity_distance_min
    robot = problem.cell.robot
    first, _ = ticks_around(trajectory, index, SINGULARITY_WINDOW_S)
    _, last = ticks_around(trajectory, until, SINGULARITY_WINDOW_S)
    rows = motion.knots[(motion.knots > first) & (motion.knots < last)]
    rows = np.concatenate([[first], rows, [last]])

    # Signed on the side of the release: a zero between two samples is a change of sign, which |f| would hide.
    signed = signed_singularity_distances(robot, trajectory.q[rows])
    side = np.sign(signed[np.searchsorted(rows, index)])

    def evaluate(t: Array, item: Index) -> Array:
        return (signed_singularity_distances(robot, trajectory.at(t)[0]) * side)[np.arange(len(t)), item]

    rates = _singularity_curvature(robot, joint_rates(trajectory, rows))
    asked = required if required > 0.0 else -math.inf  # nothing
    sides = (signed * side).T
    t = trajectory.t[rows]
    proof = prove_above(evaluate, t, sides, rates, asked, curvature_bound, motion.distance_accuracy)
    name = SINGULARITIES[proof.item]
    value, detail = (proof.value, name) if proof.value > 0.0 else (0.0, f"{name}: passed through")
    return at_least("singularity_distance", value, required, "1", proof.at_s, detail).provided(proof.proven)


def _singularity_curvature(robot: Robot, rates: Rates) -> Array:
    """Returns sup |f''| of the three distances (3, m): two sines, and a horizontal offset over the arm's length."""
    length = abs(robot.a[1]) + abs(robot.a[2])
    sines = rates.qd[[4, 2]] ** 2 + rates.qdd[[4, 2]]
    speed, acceleration = rates.sums[:2, 1:4] - rates.sums[:2, :1]  # of upper arm, forearm, wrist in the arm's plane
    shoulder = np.abs([robot.a[1], robot.a[2], robot.d[4]]) / length @ (speed**2 + acceleration)
    return np.concatenate([sines, shoulder[None]])


def speed_curves(shown: ShownMotion) -> list[Curve]:
    """Returns the curve of the speeds of tool centre point and flange."""
    arm = shown.arm
    safety = shown.problem.cell.safety
    tool, flange = (point.name for point in tool_points(shown.problem.cell))
    points = (
        Series(tool, arm.tool_speed, None, shown.motion.tool_speed_max),
        Series(flange, arm.flange_speed, None, safety.tool_speed_m_s),
    )
    return [Curve("tcp_speed", "m/s", shown.t, points)]


def singularity_curves(shown: ShownMotion) -> list[Curve]:
    """Returns the curve of the distances to singularities."""
    problem = shown.problem
    distances = np.abs(signed_singularity_distances(problem.cell.robot, shown.trajectory.q[shown.rows]))
    required = None if problem.ends_at_rest else problem.limits.singularity_distance_min
    series = tuple(Series(name, d, required) for name, d in zip(SINGULARITIES, distances.T, strict=True))
    passed = shown.trajectory.passed
    first, _ = ticks_around(shown.trajectory, passed[0], SINGULARITY_WINDOW_S)
    _, last = ticks_around(shown.trajectory, passed[-1], SINGULARITY_WINDOW_S)
    span = (float(shown.trajectory.t[first]), float(shown.trajectory.t[last]))
    return [Curve("singularity_distance", "1", shown.t, series, limited=None if problem.ends_at_rest else span)]
