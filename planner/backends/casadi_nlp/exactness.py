"""The release made exact: a solver's answer obeys the release to its tolerance, a certificate asks for more.

Newton's iteration with least change of joint positions and velocities (scaled), on the rows that the request fixes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.backends.casadi_nlp import buffered, numbers, throw
from planner.backends.casadi_nlp.layout import NZ, QD, QD_SCALE, Q
from planner.errors import SolverFailed
from planner.flight import fly
from planner.kinematics import forward, jacobian
from planner.problem import JointRelease, PointRelease, PoseRelease, ThrowProblem
from planner.seeds.candidates import Candidate

Vector = NDArray[np.float64]

ITERATIONS = 6
CLOSE = 1e-9  # [m, m/s] where the iteration stops: a ten-thousandth of what a certificate tolerates
FAR = 0.05  # [m, m/s] a solution this far off its release is none


def exact_release(
    problem: ThrowProblem, candidate: Candidate, slope: Any, state: tuple[Vector, Vector], aim: Vector
) -> tuple[Vector, Vector]:
    """Returns q and qd (6,) of the release next to `state` that do exactly what was asked.

    Args:
        problem: what is asked.
        candidate: the answer for `joint` and `pose`.
        slope: the function of the block "release" that gives rows and Jacobian.
        state: the solver's q and qd.
        aim: where the drag-free flight is to land (3,) [m].

    Raises:
        SolverFailed: the state is too far off.
    """
    if isinstance(problem.release, JointRelease | PoseRelease):
        return candidate.q, candidate.qd
    parameters = np.concatenate(
        [numbers.arm_numbers(problem.cell, problem.limits), numbers.release_numbers(problem, aim)]
    )
    x = np.concatenate([state[0], state[1] / QD_SCALE])
    for _ in range(ITERATIONS):
        rows, jacobian = _asked(problem, slope, x, parameters)
        if np.abs(rows).max() < CLOSE:
            break
        if np.abs(rows).max() > FAR:
            raise SolverFailed("the solution misses its release")
        x = x - np.linalg.lstsq(jacobian, rows, rcond=None)[0]
    return x[:6], x[6:] * QD_SCALE


def _asked(problem: ThrowProblem, slope: Any, x: Vector, parameters: Vector) -> tuple[Vector, Vector]:
    """Returns the residuals that must vanish (m,), and their Jacobian (m, 12) by q and scaled qd."""
    z = np.zeros(NZ)
    z[Q], z[QD] = x[:6], x[6:]
    rows, jacobian = buffered.evaluate(slope, z, parameters)
    values, slopes = throw.ROWS.split(rows.ravel()), throw.ROWS.split(jacobian[:, :12])
    release = problem.release
    if isinstance(release, PointRelease):
        if problem.ends_at_rest:
            rows = [values["position"] - release.p_WT, x[6:]]
            return np.concatenate(rows), np.concatenate([slopes["position"], np.eye(12)[6:]])
        rows = [values["position"] - release.p_WT, values["velocity"] - release.v_WT]
        return np.concatenate(rows), np.concatenate([slopes["position"], slopes["velocity"]])
    assert not isinstance(release, JointRelease | PoseRelease)
    if release.release_position is None:
        return values["landing"], slopes["landing"]
    rows = [values["landing"], values["position"] - release.release_position]
    return np.concatenate(rows), np.concatenate([slopes["landing"], slopes["position"]])


def drag_free_aim(problem: ThrowProblem, goal: Vector, p: Vector, v: Vector) -> Vector:
    """Returns where the drag-free flight from `p` with `v` must land so that the real one lands on `goal` (3,) [m]."""
    if problem.drag <= 0.0:
        return goal
    ideal = fly(p, v, float(goal[2]), problem.gravity)
    real = fly(p, v, float(goal[2]), problem.gravity, problem.drag)
    if ideal is None or real is None:
        return goal
    return goal + ideal.landing_point - real.landing_point


def tool_point(problem: ThrowProblem, q: Vector, qd: Vector) -> tuple[Vector, Vector]:
    """Returns position [m] and velocity [m/s] of the tool centre in the world, each (..., 3), for states (..., 6)."""
    cell = problem.cell
    p = (cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT))[..., :3, 3]
    v_B = (jacobian(cell.robot, q, cell.tool.X_FT)[..., :3, :] @ qd[..., None])[..., 0]
    return p, v_B @ cell.X_WB[:3, :3].T
