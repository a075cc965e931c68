"""Checks of the joint motion: closed forms on the cubic pieces, exact between samples."""

from __future__ import annotations

import numpy as np

from planner.arrays import Array
from planner.certificate.certificate import Check, at_most
from planner.certificate.samples import MotionSamples
from planner.trajectory import Trajectory

START_TOLERANCE = 1e-6  # [rad, rad/s, rad/s^2] rounding only; far below the step of an encoder
REST_TOLERANCE = 1e-6  # [rad/s, rad/s^2] rounding only
CONTINUITY_TOLERANCE = 1e-7  # [rad, rad/s] disagreement of neighbouring samples, rounding only


def start(motion: MotionSamples) -> Check:
    """Checks that the motion begins at rest at the problem's start."""
    trajectory = motion.trajectory
    offset = np.abs(trajectory.q[0] - motion.problem.start).max()
    speed = max(np.abs(trajectory.qd[0]).max(), np.abs(trajectory.qdd[0]).max())
    detail = "position" if offset >= speed else "not at rest"
    return at_most("start", float(max(offset, speed)), START_TOLERANCE, "rad", 0.0, detail)


def joint_position(motion: MotionSamples) -> Check:
    """Checks that no joint leaves its range: the extrema of every cubic piece are found in closed form."""
    limits = motion.problem.limits
    lowest, highest, times = _position_extrema(motion.trajectory)
    below, above = lowest - limits.q_lower, limits.q_upper - highest
    worst_below, worst_above = below.min(axis=0), above.min(axis=0)
    joint = int(np.minimum(worst_below, worst_above).argmin())
    if worst_below[joint] < worst_above[joint]:
        piece = int(below[:, joint].argmin())
        value, limit, margin = lowest[piece, joint], limits.q_lower[joint], worst_below[joint]
    else:
        piece = int(above[:, joint].argmin())
        value, limit, margin = highest[piece, joint], limits.q_upper[joint], worst_above[joint]
    ok, at_s, detail = bool(margin >= -START_TOLERANCE * 1e-3), float(times[piece]), _joint(motion, joint)
    return Check("joint_position", float(value), float(limit), "rad", float(margin), at_s, ok, detail)


def joint_velocity(motion: MotionSamples) -> Check:
    """Checks that no joint exceeds its speed: at the samples, and at the vertex of every quadratic piece."""
    return _largest("joint_velocity", motion, _speed_extrema(motion.trajectory), motion.problem.limits.qd_max, "rad/s")


def joint_acceleration(motion: MotionSamples) -> Check:
    """Checks that no joint exceeds its acceleration: linear between samples, so the samples decide."""
    values = np.abs(motion.trajectory.qdd)
    return _largest("joint_acceleration", motion, values, motion.problem.limits.qdd_max, "rad/s^2")


def joint_jerk(motion: MotionSamples) -> Check:
    """Checks that no joint exceeds its jerk: constant in every tick."""
    values = np.abs(motion.trajectory.jerk)
    return _largest("joint_jerk", motion, values, motion.problem.limits.jerk_max, "rad/s^3")


def end_at_rest(motion: MotionSamples) -> Check:
    """Checks that the last sample is at rest."""
    trajectory = motion.trajectory
    value = max(np.abs(trajectory.qd[-1]).max(), np.abs(trajectory.qdd[-1]).max())
    return at_most("end_at_rest", float(value), REST_TOLERANCE, "rad/s", trajectory.duration_s)


def continuity(motion: MotionSamples) -> Check:
    """Checks that neighbouring samples are states of one motion of constant jerk."""
    trajectory = motion.trajectory
    dt, q, qd, qdd = trajectory.dt, trajectory.q, trajectory.qd, trajectory.qdd
    speed = np.abs(np.diff(qd, axis=0) - dt * (qdd[:-1] + qdd[1:]) / 2.0)
    place = np.abs(np.diff(q, axis=0) - dt * (qd[:-1] + dt * (2.0 * qdd[:-1] + qdd[1:]) / 6.0))
    residual = np.maximum(speed, place)
    residual = np.where(np.isfinite(residual), residual, np.inf)
    piece, joint = np.unravel_index(int(residual.argmax()), residual.shape)
    at_s = float(piece) * dt
    worst, detail = float(residual[piece, joint]), _joint(motion, int(joint))
    return at_most("continuity", worst, CONTINUITY_TOLERANCE, "rad", at_s, detail)


def sample_rate(motion: MotionSamples) -> Check | None:
    """Checks that the samples are ticks of the cell's controller; reported as `continuity`, only if not."""
    off = abs(motion.trajectory.sample_rate_hz - motion.problem.cell.robot.sample_rate_hz)
    check = at_most("continuity", off, 0.0, "Hz", None, "sample rate against the controller's")
    return None if check.ok else check


def _largest(name: str, motion: MotionSamples, values: Array, limit: Array, unit: str) -> Check:
    """Returns the check of the largest share of a limit (n,) in `values` (pieces, n)."""
    share = np.where(np.isfinite(values), values, np.inf) / limit
    piece, joint = np.unravel_index(int(share.argmax()), share.shape)
    at_s, detail = float(piece) * motion.trajectory.dt, _joint(motion, int(joint))
    return at_most(name, float(values[piece, joint]), float(limit[joint]), unit, at_s, detail)


def _speed_extrema(trajectory: Trajectory) -> Array:
    """Returns the largest |qd| of every tick (N-1, n): at its ends, or at the vertex where qdd changes sign."""
    qd, qdd, jerk = trajectory.qd, trajectory.qdd, trajectory.jerk
    ends = np.maximum(np.abs(qd[:-1]), np.abs(qd[1:]))
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = np.abs(qd[:-1] - qdd[:-1] ** 2 / (2.0 * jerk))
    return np.where(qdd[:-1] * qdd[1:] < 0.0, np.maximum(ends, vertex), ends)


def _position_extrema(trajectory: Trajectory) -> tuple[Array, Array, Array]:
    """Returns lowest and highest q of every tick (N-1, n) and the ticks' times (N-1,).

    A joint turns back inside a tick only where its velocity changes sign, or its acceleration does.
    """
    dt, q, qd, qdd = trajectory.dt, trajectory.q, trajectory.qd, trajectory.qdd
    lowest, highest = np.minimum(q[:-1], q[1:]), np.maximum(q[:-1], q[1:])
    turns = ~((qd[:-1] * qd[1:] > 0.0) & (qdd[:-1] * qdd[1:] >= 0.0))
    start, v, a, jerk = q[:-1][turns], qd[:-1][turns], qdd[:-1][turns], trajectory.jerk[turns]
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(a * a - 2.0 * jerk * v)
        s = np.array([(-a + root) / jerk, (-a - root) / jerk, -v / a])
    s = np.where(np.isfinite(s), np.clip(s, 0.0, dt), 0.0)
    turn = start + s * (v + s * (a / 2.0 + s * jerk / 6.0))
    lowest[turns] = np.minimum(lowest[turns], turn.min(axis=0))
    highest[turns] = np.maximum(highest[turns], turn.max(axis=0))
    return lowest, highest, trajectory.t[:-1]


def _joint(motion: MotionSamples, index: int) -> str:
    return motion.problem.cell.robot.joint_names[index]
