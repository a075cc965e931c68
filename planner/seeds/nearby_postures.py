"""Postures at a point that are near to given ones, for a passage between others."""

from __future__ import annotations

import numpy as np

from planner.arrays import Array
from planner.errors import Infeasible
from planner.problem import ThrowProblem
from planner.releases import PointState
from planner.seeds.candidates import Candidate, usable_candidates
from planner.seeds.sampling import with_velocity
from planner.seeds.velocity_allocation import least_norm, tool_motion

STEPS = 12  # of Newton's method: a step squares the error, once it is small
STEP_M = 0.1  # of one step: beyond it the Jacobian is another
REACHED_M = 1e-9


def near_candidates(problem: ThrowProblem, point: PointState, near: Array) -> list[Candidate]:
    """Returns the release states that pass a point, from postures nearby, as far as they keep every limit.

    From each posture the tool goes to the point with the least joint motion, in shares of the joints' speeds: Newton's
    method with the weighted pseudoinverse (Whitney, Resolved Motion Rate Control, 1969).

    Args:
        problem: of passing the point alone.
        point: what is passed.
        near: postures (n, 6) [rad].
    """
    q = np.array(near)
    limits = problem.limits
    X_WB = problem.cell.X_WB
    goal = X_WB[:3, :3].T @ (point.p_WT - X_WB[:3, 3])
    for _ in range(STEPS):
        p, J = tool_motion(problem, q)
        error = goal - p
        far = np.maximum(np.linalg.norm(error, axis=1, keepdims=True) / STEP_M, 1.0)
        q += least_norm(J, error / far, limits.qd_max)
    p, _ = tool_motion(problem, q)
    good = (np.linalg.norm(goal - p, axis=1) < REACHED_M) & ((q > limits.q_lower) & (q < limits.q_upper)).all(axis=1)
    q = q[good]
    if len(q) == 0:
        return []
    try:
        return usable_candidates(problem, q, with_velocity(problem, q, point.v_WT))
    except Infeasible:
        return []
