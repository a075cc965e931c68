"""The arm's own safety limits and the grip, by Pinocchio and finite differences."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from audit.judge.arm_path import ArmPath
from audit.judge.distances import shapes
from audit.judge.fault import AuditFault, over
from audit.judge.pinocchio_arm import arm_model
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

STEP_S = 0.002  # [s] grid of speeds, momentum, power and stops
DIFFERENCE_S = 1e-4  # [s] of the finite differences
LIMIT_SLACK = 1e-4  # [-] of a limit: finite differences, and quarter turns rounded in the URDF
# [-] by which the stop of the model is lengthened; source: docs/safety-limits.md
STOP_TIME = 1.85
STOP_DISTANCE = 1.31


def object_times(problem: ThrowProblem, motion: Trajectory) -> tuple[float, float]:
    """Returns from when the object may be gone, and until when it may be held [s]."""
    if not problem.throws:
        return np.inf, np.inf
    window = problem.release_window_s if problem.is_robust else 0.0
    return motion.release_time_s - window, motion.release_time_s + window


def safety_faults(problem: ThrowProblem, motion: Trajectory) -> list[AuditFault]:
    """Returns the safety limits of the cell that a motion violates."""
    safety = problem.cell.safety
    limits = {
        "flange speed": safety.tool_speed_m_s,
        "elbow speed": safety.elbow_speed_m_s,
        "momentum": safety.momentum_kg_m_s,
        "power": safety.power_w,
        "stopping time": safety.stopping_time_s,
        "stopping distance": safety.stopping_distance_m,
    }
    if all(limit is None for limit in limits.values()):
        return []
    worst = np.zeros(len(limits))
    tau_max = problem.cell.robot.tau_max
    gone_from, held_until = object_times(problem, motion)
    spline = CubicHermiteSpline(motion.t, motion.q, motion.qd)
    times = np.linspace(0.0, motion.duration_s, max(2, round(motion.duration_s / STEP_S) + 1))
    for with_object, rows in ((True, times <= held_until), (False, times >= gone_from)):
        if rows.any():
            states = (spline(times[rows], k) for k in (0, 1, 2))
            values, fastest, drift, momentum = _watched(problem, with_object, *states)
            stop = _stopping_times(drift, momentum, tau_max)
            way = STOP_DISTANCE * 0.5 * fastest * np.where(fastest > 0.0, stop, 0.0)
            worst = np.maximum(worst, [*values.max(axis=0), STOP_TIME * stop.max(), way.max()])
    found = []
    for (name, limit), value in zip(limits.items(), worst, strict=True):
        if limit is not None:
            found += over(name.replace(" ", "_"), name, float(value), limit, limit * LIMIT_SLACK)
    return found


def _watched(
    problem: ThrowProblem, with_object: bool, q: Vector, qd: Vector, qdd: Vector
) -> tuple[Vector, Vector, Vector, Vector]:
    """Returns speeds of flange and elbow, momentum, power (n, 4); the fastest point (n,); drift and M qd (n, 6)."""
    cell = problem.cell
    model = arm_model(cell, with_object)
    data = model.createData()
    power, momentum = np.empty(len(q)), np.empty(len(q))
    drift, turning = np.empty((len(q), 6)), np.empty((len(q), 6))
    for k in range(len(q)):
        power[k] = abs(pin.rnea(model, data, q[k], qd[k], qdd[k]) @ qd[k])
        drift[k] = pin.nonLinearEffects(model, data, q[k], qd[k])
        turning[k] = pin.crba(model, data, q[k]) @ qd[k]
        momentum[k] = np.linalg.norm(pin.computeCentroidalMomentum(model, data, q[k], qd[k]).linear)
    arm = ArmPath.of(cell, model, q, qd)
    flange_W = np.einsum("nij,j->ni", arm.R[:, 6], cell.tool.X_FT[:3, 3])
    flange = np.linalg.norm(arm.v - np.cross(arm.w, flange_W), axis=1)
    elbow_body = next(shape for shape in shapes(cell) if shape.name == "elbow")
    later, before = (ArmPath.of(cell, model, q + s * DIFFERENCE_S * qd, qd) for s in (1.0, -1.0))
    ends = later.points(elbow_body.frame, elbow_body.ends) - before.points(elbow_body.frame, elbow_body.ends)
    elbow = np.linalg.norm(ends, axis=2).max(axis=1) / (2.0 * DIFFERENCE_S)
    fastest = np.max([elbow, flange, np.linalg.norm(arm.v, axis=1)], axis=0)
    return np.column_stack([flange, elbow, momentum, power]), fastest, drift, turning


def _stopping_times(drift: Vector, momentum: Vector, tau_max: Vector) -> Vector:
    """Returns the least times (n,) in which the rated torques stop the joints in proportion, by bisection [s].

    The torques drift - momentum / T are tried until they are just within the rated ones.
    """

    def within(rate: Vector) -> NDArray[np.bool_]:
        return np.all(np.abs(drift - momentum * rate[:, None]) <= tau_max, axis=1)

    low = np.zeros(len(drift))
    high = np.full(len(drift), 1e4)
    for _ in range(50):
        middle = 0.5 * (low + high)
        good = within(middle)
        low = np.where(good, middle, low)
        high = np.where(good, high, middle)
    with np.errstate(divide="ignore"):
        return np.where(within(np.zeros(len(drift))), 1.0 / low, np.inf)


def grip_faults(problem: ThrowProblem, motion: Trajectory) -> list[AuditFault]:
    """Returns whether the object accelerates against free fall by more than the grip withstands.

    The acceleration is the second difference of the tool centre point, in the axes of the tool.
    """
    limit = problem.cell.gripper.hold_acceleration_m_s2
    cell = problem.cell
    if limit is None:
        return []
    model = arm_model(cell, True)
    spline = CubicHermiteSpline(motion.t, motion.q, motion.qd)
    until = min(object_times(problem, motion)[1], motion.duration_s)
    t = np.arange(DIFFERENCE_S, until - DIFFERENCE_S, STEP_S)
    times = (t - DIFFERENCE_S, t + DIFFERENCE_S, t)
    before, after, now = (ArmPath.of(cell, model, spline(each), spline(each, 1)) for each in times)
    felt = (after.v - before.v) / (2.0 * DIFFERENCE_S) + [0.0, 0.0, problem.gravity]
    along = np.einsum("nij,ni->nj", now.R[:, 6] @ cell.tool.X_FT[:3, :3], felt)
    share = np.linalg.norm(felt, axis=1) / limit[0] if len(limit) == 1 else np.max(np.abs(along) / limit, axis=1)
    worst = float(share.max(initial=0.0))
    slack = LIMIT_SLACK + 0.01  # the jerk within two differences of an instant
    return over("grip_acceleration", "grip acceleration, as a share of what it withstands", worst, 1.0, slack)
