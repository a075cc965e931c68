"""Candidates for a target from the releases of plans for other targets, as a rule of nearby ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.arrays import Array
from planner.flight import fly
from planner.geometry import tool_state
from planner.problem import ThrowProblem
from planner.seeds.candidates import Candidate, usable_candidates
from planner.seeds.landing_axes import aimed_at, thrown_velocity
from planner.seeds.velocity_allocation import tool_jacobian

ReleaseState = tuple[Sequence[float], Sequence[float]]  # q (6) [rad], qd (6) [rad/s]


def neighbour_candidates(problem: ThrowProblem, releases: Sequence[ReleaseState]) -> list[Candidate]:
    """Returns candidates that have the postures of other plans' releases, and velocities that throw to this target.

    A flight that takes T and lands at L lands at the target if its velocity changes by (target - L) / T; exactly so
    without drag. The joint velocities change by the least that does it.

    Args:
        problem: of a target.
        releases: of the other plans.

    Raises:
        Infeasible: none of them keeps every limit.
    """
    q, qd = (np.array([release[i] for release in releases], float).reshape(-1, 6) for i in (0, 1))
    moved = [_redirected(problem, *state) for state in zip(q, qd, strict=True)]
    lands = np.array([state is not None for state in moved], dtype=bool)
    return usable_candidates(problem, q[lands], np.array([x for x in moved if x is not None]).reshape(-1, 6))


def _redirected(problem: ThrowProblem, q: Array, qd: Array) -> Array | None:
    """Returns joint velocities (6,) near `qd` whose flight ends at the target; None where the throw does not land."""
    assert problem.target is not None
    state = tool_state(problem.cell, q, qd)
    R_WB = problem.cell.X_WB[:3, :3]
    aim = aimed_at(problem, problem.target).p_W
    flight = fly(state.p_WT, state.v_WT, float(aim[2]), problem.gravity_at_tool_speed, problem.drag)
    if flight is None:
        return None
    change_W = (aim - flight.landing_point) / flight.time_of_flight_s
    J_v_BT = tool_jacobian(problem, q[None])[0]
    moved = qd + np.linalg.pinv(J_v_BT) @ (R_WB.T @ change_W)
    if problem.body is None:
        return moved
    thrown = thrown_velocity(problem, problem.target, q[None], J_v_BT[None], (J_v_BT @ moved)[None], problem.drag)[0]
    return thrown if np.isfinite(thrown).all() else None
