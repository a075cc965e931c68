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

from benchmarks.audit.distances import LENGTH_SLACK_M, SPARSE_S, spatial_faults
from benchmarks.audit.flights import flight_faults
from benchmarks.audit.mujoco_model import inverse_dynamics
from benchmarks.audit.pinocchio_arm import arm_model, dh_frames_in_urdf, poses_and_velocity
from benchmarks.audit.safety import grip_faults, object_times, safety_faults
from planner.problem import JointRelease, PointRelease, PoseRelease, ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

STEP_S = 0.001  # [s] grid of joint limits, torques and speeds
LIMIT_SLACK = 1e-5  # [-] of a limit: spline interpolation, and quarter turns rounded in the URDF
SPEED_SLACK = 1.1e-4  # [m/s] at the release: the certificate's tolerance and rounding
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
        jerk: Jerks in the middle of each tick (N-1, 6) [rad/s^3].
    """

    t: Vector
    q: Vector
    qd: Vector
    qdd: Vector
    jerk: Vector

    @classmethod
    def of(cls, motion: Trajectory) -> DenseSamples:
        """Evaluates a motion."""
        spline = CubicHermiteSpline(motion.t, motion.q, motion.qd)
        t = np.linspace(0.0, motion.duration_s, max(2, round(motion.duration_s / STEP_S) + 1))
        return cls(t, spline(t), spline(t, 1), spline(t, 2), spline(0.5 * (motion.t[1:] + motion.t[:-1]), 3))


def find_faults(problem: ThrowProblem, motion: Trajectory) -> list[str]:
    """Returns the faults of a certified motion, in words; an empty list if it is right."""
    dense = DenseSamples.of(motion)
    found = [*_limits(problem, motion, dense), *_torques(problem, motion, dense), *_space(problem, motion, dense)]
    found += [*safety_faults(problem, motion), *grip_faults(problem, motion), *flight_faults(problem, motion)]
    return found + _release(problem, motion)


def _limits(problem: ThrowProblem, motion: Trajectory, dense: DenseSamples) -> list[str]:
    limits = problem.limits
    pairs = (
        ("velocity", np.abs(dense.qd).max(axis=0), limits.qd_max),
        ("acceleration", np.abs(dense.qdd).max(axis=0), limits.qdd_max),
        ("jerk", np.abs(dense.jerk).max(axis=0), limits.jerk_max),
        ("upper position", dense.q.max(axis=0), limits.q_upper + 1e-6),
        ("lower position", -dense.q.min(axis=0), -limits.q_lower + 1e-6),
    )
    found = [f"{name} {worst}" for name, worst, limit in pairs if np.any(worst > limit + LIMIT_SLACK * np.abs(limit))]
    if np.abs(motion.qd[-1]).max() > 1e-6 or np.abs(motion.q[0] - problem.start).max() > 1e-6:
        found.append("does not start as requested or does not end at rest")
    return found


def _torques(problem: ThrowProblem, motion: Trajectory, dense: DenseSamples) -> list[str]:
    found, cell = [], problem.cell
    gone_from, held_until = object_times(problem, motion)
    for rows, with_object in ((dense.t <= held_until, True), (dense.t >= gone_from, False)):
        states = [x[rows][::4] for x in (dense.q, dense.qd, dense.qdd)]
        if len(states[0]) == 0:
            continue
        model = arm_model(cell, with_object)
        data = model.createData()
        tau = np.array([pin.rnea(model, data, *state) for state in zip(*states, strict=True)])
        if np.any(np.abs(tau) > problem.limits.tau_max * (1.0 + LIMIT_SLACK) + 1e-6):
            found.append(f"torque {np.abs(tau).max(axis=0)}")
        other = inverse_dynamics(cell, with_object, model, *(x[::8] for x in states))
        if np.abs(tau[::8] - other).max() > TORQUE_AGREEMENT * max(1.0, np.abs(tau).max()):
            found.append("Pinocchio and MuJoCo disagree on torques")
    return found


def _space(problem: ThrowProblem, motion: Trajectory, dense: DenseSamples) -> list[str]:
    rows = slice(None, None, round(SPARSE_S / STEP_S))
    return spatial_faults(problem, dense.q[rows], dense.qd[rows], dense.t[rows], object_times(problem, motion)[1])


def _release(problem: ThrowProblem, motion: Trajectory) -> list[str]:
    """Returns the faults of the release state."""
    cell, k, release = problem.cell, motion.release_index, problem.release
    model = arm_model(cell, True)
    poses, v = poses_and_velocity(cell, model, model.createData(), motion.q[k], motion.qd[k])
    p, found = poses[6].act(cell.tool.X_FT[:3, 3]), []
    if isinstance(release, JointRelease):
        if max(np.abs(motion.q[k] - release.q).max(), np.abs(motion.qd[k] - release.qd).max()) > SPEED_SLACK:
            found.append("another joint state at the release")
        return found
    if isinstance(release, PoseRelease | PointRelease):
        place = release.X_WT[:3, 3] if isinstance(release, PoseRelease) else release.p_WT
        velocity = release.V_WT[:3] if isinstance(release, PoseRelease) else release.v_WT
        if np.linalg.norm(p - place) > 2.0 * LENGTH_SLACK_M or np.linalg.norm(v - velocity) > 2.0 * SPEED_SLACK:
            found.append(f"release off by {np.linalg.norm(p - place)} m, {np.linalg.norm(v - velocity)} m/s")
    if isinstance(release, PoseRelease):
        found += _orientation(release, problem, motion, model)
    return found


def _orientation(release: PoseRelease, problem: ThrowProblem, motion: Trajectory, model: pin.Model) -> list[str]:
    k, data = motion.release_index, model.createData()
    pin.forwardKinematics(model, data, motion.q[k], motion.qd[k])
    R_WT = (
        data.oMi[6].rotation @ dh_frames_in_urdf(problem.cell.robot.name)[5].rotation @ problem.cell.tool.X_FT[:3, :3]
    )
    turn = float(np.linalg.norm(pin.log3(R_WT @ release.X_WT[:3, :3].T)))
    spin = float(np.linalg.norm(pin.getVelocity(model, data, 6, pin.LOCAL_WORLD_ALIGNED).angular - release.V_WT[3:]))
    if turn > 2.0 * LENGTH_SLACK_M or spin > 2.0 * SPEED_SLACK:
        return [f"release turned by {turn} rad, {spin} rad/s"]
    return []
