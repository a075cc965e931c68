"""The arm's own safety limits and the grip, by Pinocchio and finite differences."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from benchmarks.audit.distances import shapes
from benchmarks.audit.pinocchio_arm import arm_model, poses_and_velocity
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

STEP_S = 0.002  # [s] grid of speeds, momentum, power and stops
DIFFERENCE_S = 1e-4  # [s] of the finite differences
LIMIT_SLACK = 1e-4  # [-] of a limit: finite differences, and quarter turns rounded in the URDF
# [-] by which the stop of the model is lengthened; source: docs/safety-limits.md
STOP_TIME, STOP_DISTANCE = 1.85, 1.31


def object_times(problem: ThrowProblem, motion: Trajectory) -> tuple[float, float]:
    """Returns from when the object may be gone, and until when it may be held [s]."""
    if problem.ends_at_rest:
        return np.inf, np.inf
    window = problem.release_window_s if problem.is_robust else 0.0
    return motion.release_time_s - window, motion.release_time_s + window


def safety_faults(problem: ThrowProblem, motion: Trajectory) -> list[str]:
    """Returns the safety limits of the cell that a motion violates, in words."""
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
    gone_from, held_until = object_times(problem, motion)
    spline = CubicHermiteSpline(motion.t, motion.q, motion.qd)
    times = np.linspace(0.0, motion.duration_s, max(2, round(motion.duration_s / STEP_S) + 1))
    for with_object, rows in ((True, times <= held_until), (False, times >= gone_from)):
        watch = _Watch(problem, with_object)
        for t in times[rows]:
            worst = np.maximum(worst, watch.values(*(spline(t, order) for order in (0, 1, 2))))
    pairs = zip(limits.items(), worst, strict=True)
    return [f"{n} {value}" for (n, limit), value in pairs if limit is not None and value > limit * (1.0 + LIMIT_SLACK)]


class _Watch:
    """Pinocchio's arm of a problem, with the object or without it."""

    def __init__(self, problem: ThrowProblem, with_object: bool) -> None:
        self._cell, self._model = problem.cell, arm_model(problem.cell, with_object)
        self._data = self._model.createData()
        self._elbow = next(shape for shape in shapes(problem.cell) if shape.name == "elbow")

    def values(self, q: Vector, qd: Vector, qdd: Vector) -> Vector:
        """Returns the watched quantities, in the order of `safety_faults`."""
        model, data = self._model, self._data
        effort = pin.rnea(model, data, q, qd, qdd).copy()
        drift = pin.nonLinearEffects(model, data, q, qd).copy()
        stop = _stopping_time(drift, np.array(pin.crba(model, data, q)) @ qd, self._cell.robot.tau_max)
        _, tool = poses_and_velocity(self._cell, model, data, q, qd)
        flange = np.linalg.norm(pin.getVelocity(model, data, 6, pin.LOCAL_WORLD_ALIGNED).linear)
        later, _ = poses_and_velocity(self._cell, model, data, q + DIFFERENCE_S * qd, qd)
        before, _ = poses_and_velocity(self._cell, model, data, q - DIFFERENCE_S * qd, qd)
        pin.computeCentroidalMomentum(model, data, q, qd)
        frame, ends = self._elbow.frame, self._elbow.ends
        moved = [later[frame].act(end) - before[frame].act(end) for end in ends]
        elbow = max(float(np.linalg.norm(way)) for way in moved) / (2.0 * DIFFERENCE_S)
        fastest = max(elbow, float(flange), float(np.linalg.norm(tool)))
        momentum = np.linalg.norm(data.hg.linear)
        way = STOP_DISTANCE * 0.5 * fastest * stop if fastest > 0.0 else 0.0
        return np.array([flange, elbow, momentum, abs(effort @ qd), STOP_TIME * stop, way])


def _stopping_time(drift: Vector, momentum: Vector, tau_max: Vector) -> float:
    """Returns the least time in which the rated torques stop the joints in proportion, found by bisection [s]."""
    if np.any(np.abs(drift) > tau_max):
        return np.inf
    low, high = 0.0, 1e3  # braking rates [1/s] that the torques allow, and that they need not allow
    if np.all(np.abs(drift - momentum * high) <= tau_max):
        return 0.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        if np.all(np.abs(drift - momentum * middle) <= tau_max):
            low = middle
        else:
            high = middle
    return 1.0 / low if low > 0.0 else np.inf


def grip_faults(problem: ThrowProblem, motion: Trajectory) -> list[str]:
    """Returns whether the object accelerates against free fall by more than the grip withstands, in words.

    The acceleration is the second difference of the tool centre point, in the axes of the tool.
    """
    limit, cell = problem.cell.gripper.hold_acceleration_m_s2, problem.cell
    if limit is None:
        return []
    model = arm_model(cell, True)
    data, spline = model.createData(), CubicHermiteSpline(motion.t, motion.q, motion.qd)
    until, worst = min(object_times(problem, motion)[1], motion.duration_s), 0.0
    for t in np.arange(DIFFERENCE_S, until - DIFFERENCE_S, STEP_S / 2.0):
        velocities = []
        for time in (t - DIFFERENCE_S, t + DIFFERENCE_S, t):
            poses, v = poses_and_velocity(cell, model, data, spline(time), spline(time, 1))
            velocities.append(v)
        felt = (velocities[1] - velocities[0]) / (2.0 * DIFFERENCE_S) + [0.0, 0.0, problem.gravity]
        along = (poses[6].rotation @ cell.tool.X_FT[:3, :3]).T @ felt
        share = np.linalg.norm(felt) / limit[0] if len(limit) == 1 else np.max(np.abs(along) / limit)
        worst = max(worst, float(share))
    slack = LIMIT_SLACK + 0.01  # the jerk within two differences of an instant
    return [f"grip acceleration: {worst} of what it withstands"] if worst > 1.0 + slack else []
