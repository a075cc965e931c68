"""Checks of the joint motion: closed forms on the cubic pieces, exact between samples."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from planner.arrays import Array
from planner.certificate.certificate import Check, at_most
from planner.certificate.samples import MotionSamples
from planner.certificate.shown import Curve, ShownMotion
from planner.native import loops
from planner.trajectory import Trajectory

START_TOLERANCE = 1e-6  # [rad, rad/s, rad/s^2] rounding only; far below the step of an encoder
REST_TOLERANCE = 1e-6  # [rad/s, rad/s^2] rounding only
CONTINUITY_TOLERANCE = 1e-7  # [rad, rad/s] disagreement of neighbouring samples, rounding only


def start(motion: MotionSamples) -> Check:
    """Checks that the motion begins in the problem's start; in one that moves it joins the motion before: `join`."""
    trajectory = motion.trajectory
    problem = motion.problem
    begins = (trajectory.q[0], trajectory.qd[0], trajectory.qdd[0])
    offset, *off = (np.abs(x - asked).max() for x, asked in zip(begins, problem.start_state, strict=True))
    if problem.starts_at_rest:
        speed = max(off)
        detail = "position" if offset >= speed else "not at rest"
        return at_most("start", float(max(offset, speed)), START_TOLERANCE, "rad", 0.0, detail)
    worst = int(np.argmax([offset, *off]))
    detail, unit = (("position", "rad"), ("velocity", "rad/s"), ("acceleration", "rad/s^2"))[worst]
    return at_most("join", float(max(offset, *off)), START_TOLERANCE, unit, 0.0, detail)


def joint_position(motion: MotionSamples) -> Check:
    """Checks that no joint leaves its range: the extrema of every cubic piece are found in closed form."""
    limits = motion.limits
    ((lowest, highest, *_), ticks) = _extremes(motion.trajectory)
    below = -lowest - limits.q_lower
    above = limits.q_upper - highest
    joint = int(np.minimum(below, above).argmin())
    if below[joint] < above[joint]:
        value = -lowest[joint]
        limit = limits.q_lower[joint]
        margin = below[joint]
        tick = ticks[0, joint]
    else:
        value = highest[joint]
        limit = limits.q_upper[joint]
        margin = above[joint]
        tick = ticks[1, joint]
    ok = bool(margin >= -START_TOLERANCE * 1e-3)
    at_s = tick / motion.trajectory.sample_rate_hz
    detail = _joint(motion, joint)
    return Check("joint_position", float(value), float(limit), "rad", float(margin), float(at_s), ok, detail)


def joint_velocity(motion: MotionSamples) -> Check:
    """Checks that no joint exceeds its speed: at the samples, and at the vertex of every quadratic piece."""
    return _largest("joint_velocity", motion, 2, motion.limits.qd_max, "rad/s")


def joint_acceleration(motion: MotionSamples) -> Check:
    """Checks that no joint exceeds its acceleration: linear between samples, so the samples decide."""
    return _largest("joint_acceleration", motion, 3, motion.limits.qdd_max, "rad/s^2")


def joint_jerk(motion: MotionSamples) -> Check:
    """Checks that no joint exceeds its jerk: constant in every tick."""
    return _largest("joint_jerk", motion, 4, motion.limits.jerk_max, "rad/s^3")


def end_at_rest(motion: MotionSamples) -> Check:
    """Checks that the last sample is at rest."""
    trajectory = motion.trajectory
    value = max(np.abs(trajectory.qd[-1]).max(), np.abs(trajectory.qdd[-1]).max())
    return at_most("end_at_rest", float(value), REST_TOLERANCE, "rad/s", trajectory.duration_s)


def continuity(motion: MotionSamples) -> Check:
    """Checks that neighbouring samples are states of one motion of constant jerk."""
    return _largest("continuity", motion, 5, np.full(len(motion.problem.start), CONTINUITY_TOLERANCE), "rad")


def sample_rate(motion: MotionSamples) -> Check | None:
    """Checks that the samples are ticks of the cell's controller; reported as `continuity`, only if not."""
    off = abs(motion.trajectory.sample_rate_hz - motion.problem.cell.robot.sample_rate_hz)
    check = at_most("continuity", off, 0.0, "Hz", None, "sample rate against the controller's")
    return None if check.ok else check


def curves(shown: ShownMotion) -> list[Curve]:
    """Returns the curves of positions, velocities, accelerations and jerks."""
    limits = shown.motion.limits
    trajectory = shown.trajectory
    rows = shown.rows
    jerk = np.append(trajectory.jerk, np.zeros((1, trajectory.q.shape[1])), axis=0)[rows]  # at rest after the end
    speed = limits.qd_max
    bend = limits.qdd_max
    jolt = limits.jerk_max
    return [
        shown.of_joints("joint_position", "rad", trajectory.q[rows], limits.q_lower, limits.q_upper),
        shown.of_joints("joint_velocity", "rad/s", trajectory.qd[rows], -speed, speed),
        shown.of_joints("joint_acceleration", "rad/s^2", trajectory.qdd[rows], -bend, bend),
        shown.of_joints("joint_jerk", "rad/s^3", jerk, -jolt, jolt, holds_until_next=True),
    ]


def _largest(name: str, motion: MotionSamples, row: int, limit: Array, unit: str) -> Check:
    """Returns the check of the largest share of a limit (n,) in a row of the motion's extremes; the first, if equal."""
    values, ticks = (each[row] for each in _extremes(motion.trajectory))
    joint = int(np.lexsort((ticks, -values / limit))[0])
    at_s = float(ticks[joint]) * motion.trajectory.dt
    detail = _joint(motion, joint)
    return at_most(name, float(values[joint]), float(limit[joint]), unit, at_s, detail)


@lru_cache(maxsize=1)
def _extremes(trajectory: Trajectory) -> Array:
    """Returns the largest values of a motion and their ticks (2, 6, 6).

    They are those of -q, q, |qd|, |qdd|, |jerk| and of the disagreement of neighbouring samples. What is not finite is
    infinite. Inside a tick a velocity is largest where the acceleration changes sign; a joint turns back only where its
    velocity changes sign, or its acceleration does.
    """
    return loops.joint_extremes(trajectory.dt, trajectory.samples)


def _joint(motion: MotionSamples, index: int) -> str:
    return motion.problem.cell.robot.joint_names[index]
