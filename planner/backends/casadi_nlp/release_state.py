"""The release state: made exactly what is asked, for a calibrated arm by its measured chain.

The formulas' arm is the published one. By how much a calibrated one differs at a release is taken from what is asked of
the formulas there, and what is left is corrected by Newton's iteration on the state itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.backends.casadi_nlp.functions import all_blocks, evaluate
from planner.backends.casadi_nlp.instance import Instance
from planner.backends.casadi_nlp.layout import NZ, QD, Q, Vector
from planner.backends.casadi_nlp.release_rows import ROOM, aim_from, release_bounds, release_parameters
from planner.backends.casadi_nlp.symbols import FORMULAS, RELEASE_ROWS
from planner.backends.casadi_nlp.tuning import CORRECTIONS
from planner.errors import SolverFailed
from planner.flight import landing_points
from planner.geometry import tool_state
from planner.problem import ThrowProblem

ROUNDS = 12  # [-] Newton iterations on the state; of a calibrated arm each leaves a hundredth of the error or less
REFINED = 1e-9  # [m, m/s] residual at which it stops: a ten-thousandth of the certificate's tolerance
MISSED = 0.05  # [m, m/s] a solution this far from its release has none

State = tuple[Vector, Vector]  # q [rad] and qd [rad/s], each (6,)


def corrected(instance: Instance, state: State) -> Instance:
    """Returns the instance whose release fulfils the request if its drag and calibration are those at another state."""
    problem = instance.problem
    if problem.fixes_joints:
        return instance
    aim = aim_from(problem, *state)
    if problem.cell.robot.fixed is None:
        return replace(instance, aim=aim)
    rows, _ = _formula_rows(instance, _stage(instance, state), aim)
    offsets = rows - _measured_rows(problem, rows, state, aim)
    landing = offsets[RELEASE_ROWS.slices["landing"]].copy()
    offsets[RELEASE_ROWS.slices["landing"]] = 0.0  # the aim is that of every release in a window
    return replace(instance, aim=aim + np.append(landing, 0.0), release_offsets=offsets)


def is_close(instance: Instance, state: State) -> bool:
    """Returns whether a solution's release is hardly off, so that `refined_release` corrects it."""
    if instance.problem.fixes_joints:
        return True
    residual, _ = _residual(instance, _stage(instance, state), aim_from(instance.problem, *state))
    return bool(np.abs(residual).max() < ROOM)


def refined_release(instance: Instance, state: State) -> State:
    """Returns the release state q, qd (6,) next to `state` that fulfils the request exactly.

    A solver fulfils it to its tolerance, the certificate asks for more: Newton's iteration with the least change of
    joint positions and scaled velocities. With drag the aim follows the state.

    Args:
        instance: as it was solved.
        state: q and qd (6,) of the solution.

    Raises:
        SolverFailed: the state is too far off.
    """
    if instance.problem.fixes_joints:
        return instance.candidate.q, instance.candidate.qd
    for _ in range(1 + CORRECTIONS * (instance.problem.drag > 0.0)):
        state = _refined(instance, state, aim_from(instance.problem, *state))
    return state


def _refined(instance: Instance, state: State, aim: Vector) -> State:
    """Returns the release state next to `state` that fulfils the request for an aim (3,) [m]."""
    z = _stage(instance, state)
    for _ in range(ROUNDS):
        residual, gradient = _residual(instance, z, aim)
        if np.abs(residual).max() < REFINED:
            break
        if np.abs(residual).max() > MISSED:
            raise SolverFailed("the solution misses its release")
        z[:12] = z[:12] - np.linalg.lstsq(gradient, residual, rcond=None)[0]
    return _state(instance, z)


def _stage(instance: Instance, state: State) -> Vector:
    """Returns the scaled variables (NZ,) of a stage that begins at q, qd (6,)."""
    z = np.zeros(NZ)
    z[Q] = state[0]
    z[QD] = state[1] / instance.scales[QD]
    return z


def _state(instance: Instance, z: Vector) -> State:
    return z[Q], z[QD] * instance.scales[QD]


def _residual(instance: Instance, z: Vector, aim: Vector) -> tuple[Vector, Vector]:
    """Returns what is to vanish at a release (m,), and its Jacobian (m, 12) with respect to q and scaled qd.

    Args:
        instance: its request.
        z: variables of the release's stage (NZ,).
        aim: landing point of the drag-free flight (3,) [m].
    """
    problem = instance.problem
    rows, jacobian = _formula_rows(instance, z, aim)
    if problem.cell.robot.fixed is not None:
        rows = _measured_rows(problem, rows, _state(instance, z), aim)
    lower, upper = release_bounds(problem)
    exact = np.isfinite(lower) & (lower == upper)
    residual = rows[exact] - lower[exact]
    gradient = jacobian[exact, :12]
    if problem.ends_at_rest:
        return np.append(residual, z[QD]), np.concatenate([gradient, np.eye(12)[6:]])
    return residual, gradient


def _formula_rows(instance: Instance, z: Vector, aim: Vector) -> tuple[Vector, Vector]:
    """Returns `RELEASE_ROWS` of the published arm at z (NZ,) for an aim (3,) [m], and their Jacobian (m, NZ)."""
    given = {**instance.shared_parameters, "release": release_parameters(instance.problem, aim)}
    parameters = np.concatenate([given[piece] for piece in FORMULAS["release"].parameters])
    rows, jacobian = evaluate(all_blocks()["release"].slope, z, parameters)
    return rows.ravel(), jacobian


def _measured_rows(problem: ThrowProblem, rows: Vector, state: State, aim: Vector) -> Vector:
    """Returns `RELEASE_ROWS` with position, velocity and landing of a calibrated arm's measured chain."""
    tool = tool_state(problem.cell, *state)
    rows = rows.copy()
    at = RELEASE_ROWS.slices
    rows[at["position"]] = tool.p_WT
    rows[at["velocity"]] = tool.v_WT
    landed = landing_points(tool.p_WT, tool.v_WT, float(aim[2]), problem.gravity_at_tool_speed)
    rows[at["landing"]] = landed[:2] - aim[:2]
    return rows
