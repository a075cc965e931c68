"""Checks of the joint motion: closed forms on the cubic pieces, exact between samples."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from planner.arrays import Array
from planner.certificate.certificate import Check, at_most
from planner.certificate.samples import MotionSamples
from planner.kernel import Kernel, Pinned, twin_of
from planner.trajectory import Trajectory, integrate

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
    return _largest("joint_velocity", motion, 2, motion.problem.limits.qd_max, "rad/s")


def joint_acceleration(motion: MotionSamples) -> Check:
    """Checks that no joint exceeds its acceleration: linear between samples, so the samples decide."""
    return _largest("joint_acceleration", motion, 3, motion.problem.limits.qdd_max, "rad/s^2")


def joint_jerk(motion: MotionSamples) -> Check:
    """Checks that no joint exceeds its jerk: constant in every tick."""
    return _largest("joint_jerk", motion, 4, motion.problem.limits.jerk_max, "rad/s^3")


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


def _largest(name: str, motion: MotionSamples, row: int, limit: Array, unit: str) -> Check:
    """Returns the check of the largest share of a limit (n,) in a row of the motion's extremes; the first, if equal."""
    values, ticks = (each[row] for each in _extremes(motion.trajectory))
    joint = int(np.lexsort((ticks, -values / limit))[0])
    at_s = float(ticks[joint]) * motion.trajectory.dt
    detail = _joint(motion, joint)
    return at_most(name, float(values[joint]), float(limit[joint]), unit, at_s, detail)


@lru_cache(maxsize=1)
def _extremes(trajectory: Trajectory) -> Array:
    """Returns the extremes of a motion and their ticks, see `_joint_extremes`."""
    return _joint_extremes(trajectory.dt, trajectory.samples)


def _example() -> tuple[float, Pinned]:
    jerk = np.random.default_rng(0).uniform(-500.0, 500.0, (40, 6))
    q, qd, qdd = integrate(np.zeros(6), np.zeros(6), np.ones(6), jerk, 0.002)
    return 0.002, Pinned(q, qd, qdd + 1e-6 * q, jerk)


@twin_of(Kernel.joint_extremes, _example)
def _joint_extremes(dt: float, samples: Pinned) -> Array:
    """Returns largest values and their ticks (2, 6, 6) for q, qd, qdd (N, 6) and the jerk of every tick (N-1, 6).

    They are those of -q, q, |qd|, |qdd|, |jerk| and of the disagreement of neighbouring samples. What is not finite is
    infinite.
    """
    q, qd, qdd, jerk = samples.arrays
    rows = (
        *_position_extrema(dt, q, qd, qdd, jerk),
        _speed_extrema(qd, qdd, jerk),
        np.abs(qdd),
        np.abs(jerk),
        _disagreement(dt, q, qd, qdd),
    )
    return np.array([_largest_of(values) for values in rows]).swapaxes(0, 1)


def _largest_of(values: Array) -> Array:
    """Returns the largest of `values` (k, n) and their first rows (2, n)."""
    values = np.where(np.isfinite(values), values, np.inf)
    return np.array([values.max(axis=0), values.argmax(axis=0)])


def _disagreement(dt: float, q: Array, qd: Array, qdd: Array) -> Array:
    """Returns by how much the state at the end of every tick (N-1, n) differs from that at its beginning."""
    speed = np.abs(np.diff(qd, axis=0) - dt * (qdd[:-1] + qdd[1:]) / 2.0)
    place = np.abs(np.diff(q, axis=0) - dt * (qd[:-1] + dt * (2.0 * qdd[:-1] + qdd[1:]) / 6.0))
    return np.maximum(speed, place)


def _speed_extrema(qd: Array, qdd: Array, jerk: Array) -> Array:
    """Returns the largest |qd| of every tick (N-1, n): at its ends, or at the vertex where qdd changes sign."""
    ends = np.maximum(np.abs(qd[:-1]), np.abs(qd[1:]))
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = np.abs(qd[:-1] - qdd[:-1] ** 2 / (2.0 * jerk))
    return np.where(qdd[:-1] * qdd[1:] < 0.0, np.maximum(ends, vertex), ends)


def _position_extrema(dt: float, q: Array, qd: Array, qdd: Array, jerk: Array) -> tuple[Array, Array]:
    """Returns the largest -q and q of every tick (N-1, n).

    A joint turns back inside a tick only where its velocity changes sign, or its acceleration does.
    """
    lowest = np.minimum(q[:-1], q[1:])
    highest = np.maximum(q[:-1], q[1:])
    turns = ~((qd[:-1] * qd[1:] > 0.0) & (qdd[:-1] * qdd[1:] >= 0.0))
    start = q[:-1][turns]
    v = qd[:-1][turns]
    a = qdd[:-1][turns]
    j = jerk[turns]
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(a * a - 2.0 * j * v)
        s = np.array([(-a + root) / j, (-a - root) / j, -v / a])
    s = np.where(np.isfinite(s), np.clip(s, 0.0, dt), 0.0)
    turn = start + s * (v + s * (a / 2.0 + s * j / 6.0))
    lowest[turns] = np.minimum(lowest[turns], turn.min(axis=0))
    highest[turns] = np.maximum(highest[turns], turn.max(axis=0))
    return -lowest, highest


def _joint(motion: MotionSamples, index: int) -> str:
    return motion.problem.cell.robot.joint_names[index]
