"""The release state: made exactly what is asked, for a calibrated arm by its measured chain.

The formulas' arm is close to a calibrated one around a release (`parameters.closest_arm`). What is left between the two
is corrected by another fit or another aim, and at last by Newton's iteration on the state itself.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from planner.backends.casadi_nlp.functions import evaluate
from planner.backends.casadi_nlp.instance import Instance
from planner.backends.casadi_nlp.layout import NZ, QD, Q, Vector
from planner.backends.casadi_nlp.object_path import drag_free_aim
from planner.backends.casadi_nlp.parameters import release_parameters
from planner.backends.casadi_nlp.symbols import FORMULAS, RELEASE_ROWS
from planner.errors import SolverFailed
from planner.flight import landing_points
from planner.geometry import tool_state
from planner.problem import PointRelease, TargetRelease, ThrowProblem

REFINEMENT_ROUNDS = 6  # Newton iterations on the release state
# [-] of a calibrated arm, whose Jacobian is known to a hundredth: each leaves a hundredth of the error or less
CALIBRATED_ROUNDS = 12
CLOSE = 3e-3  # [m, m/s] error of a solution that is not corrected at once: solving on ticks corrects it as well
ROOM = 3e-3  # [m, m/s, rad] that a correction moves place, speed and elevation of the release, at most as a rule
REFINED = 1e-9  # [m, m/s] residual at which they stop: a ten-thousandth of the certificate's tolerance
MISSED = 0.05  # [m, m/s] a solution this far from its release has none


def with_room(problem: ThrowProblem) -> ThrowProblem:
    """Returns the problem, for a calibrated arm with room in the bounds on the release.

    The refined release keeps what is asked exactly, such as the landing, and moves within this room else.
    """
    release = problem.release
    if problem.cell.robot.fixed is None or not isinstance(release, TargetRelease):
        return problem
    low = release.min_elevation_rad
    high = release.max_elevation_rad
    room = min(ROOM, max(high - low, 0.0) / 4.0)
    inner = replace(
        release,
        max_speed_m_s=release.max_speed_m_s - min(ROOM, release.max_speed_m_s / 4.0),
        min_elevation_rad=low + room if low > -math.pi / 2 else low,
        max_elevation_rad=high - room if high < math.pi / 2 else high,
        min_horizontal_distance_m=release.min_horizontal_distance_m + ROOM * (release.min_horizontal_distance_m > 0.0),
    )
    return replace(problem, release=inner)


def is_free_release_of_measured_arm(problem: ThrowProblem) -> bool:
    """Returns whether a release state has to be found for a calibrated arm, and is not given."""
    return problem.cell.robot.fixed is not None and not problem.fixes_joints


def only_lands(problem: ThrowProblem) -> bool:
    """Returns whether nothing but the landing is asked of the release."""
    return isinstance(problem.release, TargetRelease) and problem.release.release_position is None


def corrected_at(instance: Instance, state: tuple[Vector, Vector]) -> Instance | None:
    """Returns the instance with its arm fitted, then its aim moved, at a release q, qd (6,); None if that is close.

    The arm is fitted once: the soonest throw among many like it moves with each fit.
    """
    problem = instance.problem
    aim = measured_aim(problem, state, instance.aim)
    z = _stage(instance, state)
    rows, jacobian = _release_rows(instance, z, aim)
    residual, _ = _release_residual(problem, z, _measured_rows(problem, rows, state, aim), jacobian)
    if np.abs(residual).max() < CLOSE:
        return None
    if instance.fitted_at is None or not only_lands(problem):
        return replace(instance, fitted_at=state, aim=aim)
    return aimed(instance, state, aim)


def measured_aim(problem: ThrowProblem, state: tuple[Vector, Vector], otherwise: Vector) -> Vector:
    """Returns the aim (3,) [m] of the flight without drag from a state q, qd (6,); `otherwise` without a target."""
    if not isinstance(problem.release, TargetRelease):
        return otherwise
    tool = tool_state(problem.cell, *state)
    return drag_free_aim(problem, problem.release.p_W, tool.p_WT, tool.v_WT)


def aimed(instance: Instance, state: tuple[Vector, Vector], aim: Vector) -> Instance:
    """Returns the instance whose arm, aiming there from a state q, qd (6,), makes the calibrated one land on `aim`."""
    rows, _ = _release_rows(instance, _stage(instance, state), aim)
    apart = rows - _measured_rows(instance.problem, rows, state, aim)
    return replace(instance, aim=aim + np.append(apart[RELEASE_ROWS.slices["landing"]], 0.0))


def refined_release(instance: Instance, state: tuple[Vector, Vector], aim: Vector) -> tuple[Vector, Vector]:
    """Returns the release state q, qd (6,) next to `state` that fulfils the request exactly.

    A solver fulfils it to its tolerance, the certificate asks for more: Newton's iteration with the least change of
    joint positions and scaled velocities.

    Args:
        instance: as it was solved.
        state: q and qd (6,) of the solution.
        aim: landing point of the drag-free flight (3,) [m].

    Raises:
        SolverFailed: the state is too far off.
    """
    problem = instance.problem
    if problem.fixes_joints:
        return instance.candidate.q, instance.candidate.qd
    z = _stage(instance, state)
    is_measured = problem.cell.robot.fixed is not None
    for _ in range(CALIBRATED_ROUNDS if is_measured else REFINEMENT_ROUNDS):
        rows, jacobian = _release_rows(instance, z, aim)
        if is_measured:
            rows = _measured_rows(problem, rows, (z[Q], z[QD] * instance.scales[QD]), aim)
        residual, gradient = _release_residual(problem, z, rows, jacobian)
        if np.abs(residual).max() < REFINED:
            break
        if np.abs(residual).max() > MISSED:
            raise SolverFailed("the solution misses its release")
        z[:12] = z[:12] - np.linalg.lstsq(gradient, residual, rcond=None)[0]
    return z[Q], z[QD] * instance.scales[QD]


def _stage(instance: Instance, state: tuple[Vector, Vector]) -> Vector:
    """Returns the scaled variables (NZ,) of a stage that begins at q, qd (6,)."""
    z = np.zeros(NZ)
    z[Q] = state[0]
    z[QD] = state[1] / instance.scales[QD]
    return z


def _release_rows(instance: Instance, z: Vector, aim: Vector) -> tuple[Vector, Vector]:
    """Returns `RELEASE_ROWS` at z (NZ,) for an aim (3,) [m], and their Jacobian (m, 12) by q and scaled qd."""
    given = {**instance.shared_parameters, "release": release_parameters(instance.problem, aim)}
    parameters = np.concatenate([given[piece] for piece in FORMULAS["release"].parameters])
    rows, jacobian = evaluate(instance.transcription.blocks["release"].slope, z, parameters)
    return rows.ravel(), jacobian[:, :12]


def _measured_rows(problem: ThrowProblem, rows: Vector, state: tuple[Vector, Vector], aim: Vector) -> Vector:
    """Returns `RELEASE_ROWS` with position, velocity and landing of a calibrated arm's measured chain."""
    tool = tool_state(problem.cell, *state)
    rows = rows.copy()
    at = RELEASE_ROWS.slices
    rows[at["position"]] = tool.p_WT
    rows[at["velocity"]] = tool.v_WT
    landed = landing_points(tool.p_WT, tool.v_WT, float(aim[2]), problem.gravity_at_tool_speed)
    rows[at["landing"]] = landed[:2] - aim[:2]
    return rows


def _release_residual(problem: ThrowProblem, z: Vector, rows: Vector, jacobian: Vector) -> tuple[Vector, Vector]:
    """Returns the residuals that must vanish (m,), and their Jacobian (m, 12) with respect to q and scaled qd.

    Args:
        problem: its release.
        z: variables of the release's stage (NZ,).
        rows: of `RELEASE_ROWS`.
        jacobian: theirs, with respect to q and scaled qd.
    """
    release = problem.release
    at = RELEASE_ROWS.slices
    if isinstance(release, PointRelease):
        required = {"position": release.p_WT, "velocity": release.v_WT}
        if problem.ends_at_rest:
            residual = np.concatenate([rows[at["position"]] - release.p_WT, z[QD]])
            return residual, np.concatenate([jacobian[at["position"]], np.eye(12)[6:]])
    else:
        assert isinstance(release, TargetRelease)
        required = {"landing": np.zeros(2), "position": release.release_position}
    required = {name: value for name, value in required.items() if value is not None}
    residual = np.concatenate([rows[at[name]] - value for name, value in required.items()])
    return residual, np.concatenate([jacobian[at[name]] for name in required])
