"""Checks of a certified plan with Pinocchio, coal and MuJoCo; they share only the arms' shapes with the certificate.

A plan is faulty if a dense evaluation by these libraries violates a limit by more than the tolerances below. Kinematics
and torques come from the published URDF numbers, not from `planner/robot_data`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from audit.judge.distances import LENGTH_SLACK_M, SPARSE_S, Obstacle, spatial_faults
from audit.judge.fault import AuditFault, joint_faults, over, under
from audit.judge.landings import aim_faults, flight_faults
from audit.judge.mujoco_model import inverse_dynamics
from audit.judge.pinocchio_arm import arm_model, dh_frames_in_urdf, poses_and_velocity
from audit.judge.safety import grip_faults, object_times, safety_faults
from planner.problem import JointRelease, PointRelease, PoseRelease, Release, ThrowProblem
from planner.releases import SteadyLine
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

STEP_S = 0.001  # [s] grid of joint limits
TORQUE_S = 0.004  # [s] grid of torques
LIMIT_SLACK = 1e-5  # [-] of a limit: spline interpolation, and quarter turns rounded in the URDF
SPEED_SLACK = 1.1e-4  # [m/s] at the release: the certificate's tolerance and rounding
START_SLACK = 1e-6  # [rad, rad/s] at start and end
TICK_SLACK_S = 1e-8  # [s] of a time on ticks: rounding
TORQUE_AGREEMENT = 1e-4  # [-] of the largest torque, between Pinocchio and MuJoCo


@dataclass(frozen=True, eq=False)
class DenseSamples:
    """A motion evaluated by a cubic Hermite spline through its positions and velocities.

    The spline does not use the given accelerations, so that its accelerations and jerks check them.

    Attributes:
        t: Times (n,) [s].
        q: Positions (n, 6) [rad].
        qd: Velocities (n, 6) [rad/s].
        qdd: Accelerations (n, 6) [rad/s^2].
        jerk: Jerks in the middle of each tick, and between ticks by second differences of the velocities, with rest
            before and after the motion (2N-1, 6) [rad/s^3]. Neither exceeds the largest jerk of a smooth motion.
    """

    t: Vector
    q: Vector
    qd: Vector
    qdd: Vector
    jerk: Vector

    @classmethod
    def of(cls, motion: Trajectory, smooth: bool, start_qdd: Vector) -> DenseSamples:
        """Evaluates a motion.

        Args:
            motion: The motion.
            smooth: Whether its jerk may change within a tick. The spline's acceleration at the end of a tick is then
                not the motion's; that in the middle is its mean over the tick, and only that is taken.
            start_qdd: Acceleration at the start [rad/s^2], of the motion that it joins.
        """
        spline = CubicHermiteSpline(motion.t, motion.q, motion.qd)
        middle = 0.5 * (motion.t[1:] + motion.t[:-1])
        t = middle if smooth else np.linspace(0.0, motion.duration_s, max(2, round(motion.duration_s / STEP_S) + 1))
        rest = np.zeros((1, motion.qd.shape[1]))
        before = motion.qd[:1] - motion.dt * start_qdd  # what the motion joins; at rest zero
        across = np.diff(np.concatenate([before, motion.qd, rest]), n=2, axis=0) / motion.dt**2
        return cls(t, spline(t), spline(t, 1), spline(t, 2), np.concatenate([spline(middle, 3), across]))

    def every(self, step_s: float) -> int:
        """Returns of how many times one is taken, so that those taken are `step_s` apart or a little less."""
        return max(1, int(step_s / (self.t[1] - self.t[0]) + 1e-6)) if len(self.t) > 1 else 1


def find_faults(
    problem: ThrowProblem, motion: Trajectory, step_s: float = SPARSE_S, beyond: tuple[Obstacle, ...] = ()
) -> list[AuditFault]:
    """Returns the faults of a certified motion; an empty list if it is right.

    Args:
        problem: The problem.
        motion: The motion.
        step_s: Grid of the distances [s].
        beyond: Obstacles that the cell knows by others which cover them: meshes as they are.
    """
    found = motion_faults(problem, motion, step_s=step_s, beyond=beyond)
    found += [*safety_faults(problem, motion), *grip_faults(problem, motion)]
    found += [*flight_faults(problem, motion), *aim_faults(problem, motion)]
    return [*found, *_passages(problem, motion), *_times(problem, motion)]


def motion_faults(
    problem: ThrowProblem,
    motion: Trajectory,
    smooth: bool = False,
    step_s: float = SPARSE_S,
    beyond: tuple[Obstacle, ...] = (),
) -> list[AuditFault]:
    """Returns the faults of a motion by itself: start, rest, joints, torques, distances, speed; not of the release.

    Args:
        problem: The problem.
        motion: The motion; its accelerations are not used.
        smooth: Whether its jerk may change within a tick.
        step_s: Grid of the distances [s].
        beyond: Obstacles beside those of the cell.
    """
    dense = DenseSamples.of(motion, smooth, problem.start_qdd)
    found = [*_limits(problem, motion, dense), *_torques(problem, motion, dense)]
    return found + _space(problem, motion, dense, step_s, beyond)


def _limits(problem: ThrowProblem, motion: Trajectory, dense: DenseSamples) -> list[AuditFault]:
    limits = problem.limits
    q = np.concatenate([dense.q, motion.q])
    qd = np.concatenate([dense.qd, motion.qd])
    rows = (
        ("joint_velocity", "velocity", np.abs(qd).max(axis=0), limits.qd_max, 0.0, "rad/s"),
        ("joint_acceleration", "acceleration", np.abs(dense.qdd).max(axis=0), limits.qdd_max, 0.0, "rad/s^2"),
        ("joint_jerk", "jerk", np.abs(dense.jerk).max(axis=0), limits.jerk_max, 0.0, "rad/s^3"),
        ("joint_position", "upper position", q.max(axis=0), limits.q_upper, 1e-6, "rad"),
        ("joint_position", "lower position, negated", -q.min(axis=0), -limits.q_lower, 1e-6, "rad"),
    )
    found = []
    for rule, text, worst, limit, slack, unit in rows:
        found += joint_faults(rule, text, worst, limit, slack + LIMIT_SLACK * np.abs(limit), unit)
    off = float(np.abs(motion.q[0] - problem.start).max())
    found += over("start", "does not start as requested", off, 0.0, START_SLACK, "rad")
    asked = np.array([problem.start_qd, problem.start_qdd])
    off = float(np.abs(np.array([motion.qd[0], motion.qdd[0]]) - asked).max())
    found += over("start", "does not start at the speed and acceleration asked for", off, 0.0, START_SLACK, "rad/s")
    speed = float(np.abs(motion.qd[-1]).max())
    found += over("end_at_rest", "does not end at rest", speed, 0.0, START_SLACK, "rad/s")
    return found


def _torques(problem: ThrowProblem, motion: Trajectory, dense: DenseSamples) -> list[AuditFault]:
    found = []
    cell = problem.cell
    worst = np.zeros(6)
    gone_from, held_until = object_times(problem, motion)
    for rows, with_object in ((dense.t <= held_until, True), (dense.t >= gone_from, False)):
        states = [x[rows][:: dense.every(TORQUE_S)] for x in (dense.q, dense.qd, dense.qdd)]
        if len(states[0]) == 0:
            continue
        model = arm_model(cell, with_object)
        data = model.createData()
        tau = np.array([pin.rnea(model, data, *state) for state in zip(*states, strict=True)])
        worst = np.maximum(worst, np.abs(tau).max(axis=0))
        other = inverse_dynamics(cell, with_object, *(x[::8] for x in states))
        off = float(np.abs(tau[::8] - other).max())
        agreed = TORQUE_AGREEMENT * max(1.0, np.abs(tau).max())
        found += over("joint_torque", "Pinocchio and MuJoCo disagree on torques", off, agreed, 0.0, "N m")
    slack = problem.limits.tau_max * LIMIT_SLACK + 1e-6
    return joint_faults("joint_torque", "torque", worst, problem.limits.tau_max, slack, "N m") + found


def _space(
    problem: ThrowProblem, motion: Trajectory, dense: DenseSamples, step_s: float, beyond: tuple[Obstacle, ...]
) -> list[AuditFault]:
    rows = slice(None, None, dense.every(step_s))
    moving = [t for release, t in _passed(problem, motion) if not release.is_at_rest]
    held_until_s = object_times(problem, motion)[1]
    states = dense.q[rows], dense.qd[rows], dense.t[rows]
    return spatial_faults(problem, *states, held_until_s, np.array(moving), beyond)


def _passed(problem: ThrowProblem, motion: Trajectory) -> list[tuple[Release, float]]:
    """Returns the states that are asked for, each with its time [s]: of the release, or of all passages and the end."""
    if not problem.passages:
        return [(problem.release, motion.release_time_s)]
    states: list[tuple[Release, float]] = []
    for passage, k in zip(problem.passages, motion.passed, strict=True):
        at_s = k * motion.dt
        if isinstance(passage.state, SteadyLine):
            states += [(state, at_s + t) for state, t in _on_line(passage.state)]
        else:
            states.append((passage.state, at_s))
    return states if problem.end is None else [*states, (problem.end, motion.duration_s)]


def _on_line(line: SteadyLine) -> list[tuple[Release, float]]:
    """Returns the states on a line, each with its time from the start [s]: both ends, and every millisecond or less."""
    R_0 = line.X_WT[:3, :3]
    way = line.X_WE[:3, 3] - line.X_WT[:3, 3]
    lasts_s = float(np.linalg.norm(way)) / line.speed_m_s
    twist = np.concatenate([way, pin.log3(line.X_WE[:3, :3] @ R_0.T)]) / lasts_s
    t = np.linspace(0.0, lasts_s, int(lasts_s / STEP_S) + 2)
    poses = [pin.SE3(pin.exp3(s * twist[3:]) @ R_0, line.X_WT[:3, 3] + s * twist[:3]).homogeneous for s in t]
    return [(PoseRelease(X, twist), float(s)) for X, s in zip(poses, t, strict=True)]


def _times(problem: ThrowProblem, motion: Trajectory) -> list[AuditFault]:
    """Returns the passages that are too early, or not at the time that is asked for, to a tick."""
    found = []
    for passage, k in zip(problem.passages, motion.passed if problem.passages else (), strict=True):
        at_s = k * motion.dt
        text = f"passage {passage.name!r} is passed"
        if passage.at_s is not None:
            off = abs(at_s - passage.at_s)
            found += over("passage_time", f"{text} off its time", off, 0.5 * motion.dt, TICK_SLACK_S, "s")
        found += under("passage_time", f"{text} before its time", at_s, passage.not_before_s, TICK_SLACK_S, "s")
    return found


def _passages(problem: ThrowProblem, motion: Trajectory) -> list[AuditFault]:
    """Returns the faults of the states that are asked for."""
    model = arm_model(problem.cell, True)
    spline = CubicHermiteSpline(motion.t, motion.q, motion.qd)
    states = [(release, spline(t), spline(t, 1)) for release, t in _passed(problem, motion)]
    return [fault for state in states for fault in _state(problem, model, *state)]


def _state(problem: ThrowProblem, model: pin.Model, release: Release, q: Vector, qd: Vector) -> list[AuditFault]:
    """Returns the faults of a joint state (6,), (6,), where that of a release is asked for."""
    cell = problem.cell
    poses, v = poses_and_velocity(cell, model, model.createData(), q, qd)
    p = poses[6].act(cell.tool.X_FT[:3, 3])
    found = []
    if isinstance(release, JointRelease):
        off = max(np.abs(q - release.q).max(), np.abs(qd - release.qd).max())
        return over("release_velocity", "another joint state at the release", float(off), 0.0, SPEED_SLACK)
    if isinstance(release, PoseRelease | PointRelease):
        place = release.X_WT[:3, 3] if isinstance(release, PoseRelease) else release.p_WT
        velocity = release.V_WT[:3] if isinstance(release, PoseRelease) else release.v_WT
        apart = float(np.linalg.norm(p - place))
        too_fast = float(np.linalg.norm(v - velocity))
        found += over("release_position", "another place of release", apart, 0.0, 2.0 * LENGTH_SLACK_M, "m")
        found += over("release_velocity", "another velocity of release", too_fast, 0.0, 2.0 * SPEED_SLACK, "m/s")
    if isinstance(release, PoseRelease):
        found += _orientation(release, problem, model, q, qd)
    return found


def _orientation(
    release: PoseRelease, problem: ThrowProblem, model: pin.Model, q: Vector, qd: Vector
) -> list[AuditFault]:
    data = model.createData()
    pin.forwardKinematics(model, data, q, qd)
    R_WT = data.oMi[6].rotation @ dh_frames_in_urdf(problem.cell.robot)[5].rotation @ problem.cell.tool.X_FT[:3, :3]
    turn = float(np.linalg.norm(pin.log3(R_WT @ release.X_WT[:3, :3].T)))
    spin = float(np.linalg.norm(pin.getVelocity(model, data, 6, pin.LOCAL_WORLD_ALIGNED).angular - release.V_WT[3:]))
    found = over("release_position", "release turned", turn, 0.0, 2.0 * LENGTH_SLACK_M, "rad")
    return found + over("release_velocity", "another spin of release", spin, 0.0, 2.0 * SPEED_SLACK, "rad/s")
