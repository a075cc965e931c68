"""Run-ups: throws after a constant acceleration from the start, straight in joint space.

A joint is at a velocity soonest by accelerating all the time: in the time T it comes to v and gets v T / 2 far. So the
soonest throw is close to a posture v T / 2 from the start in which v throws to the target. Postures drawn around the
start are seldom near that one: their least time is twice the soonest throw's in the median, that of the run-ups 0.93 of
it.
"""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, read_only
from planner.flight import slowest_time
from planner.problem import ThrowProblem
from planner.releases import Target
from planner.rotations import invert_pose
from planner.seeds.soonest_states import TOO_FAST_S, penalised_bound
from planner.seeds.velocity_allocation import allocate_velocity, balanced_velocity, tool_motion, tool_velocity

FLIGHT_SHARES = read_only([0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.12, 1.25, 1.4, 1.6])  # [-] of the slowest throw's time
SHORTEST_FLIGHT_S = 1e-3  # [s] of the slowest throw to a target that is where the tool is
STEPS = 12  # of the iteration; most throws change by less than a tick after eight
ONES = read_only(np.ones(6))
CHANGE = 0.7  # [-] exponent of the largest share in the change of the duration: with 1 some iterations swing
# Machines, and the C kernel and numpy, differ in the last bits, which steps would multiply: each is rounded.
DECIMALS = 9
TIE_S = 1e-9


def run_ups(problem: ThrowProblem, target: Target) -> tuple[Array, Array]:
    """Returns run-ups q, qd (n, 6), one for each flight time that there is one for; drag is left out.

    For each flight time the velocity is found by iteration: linearised around the run-up of the velocity before, it is
    the one of least largest share of what the joints reach in the time, which then changes with that share. Of all
    steps the soonest counts. Requested bounds and the arm's surroundings are disregarded.

    Args:
        problem: its start, limits and cell.
        target: of the throw.
    """
    reachable = problem.reachable
    limits = problem.limits
    gravity = problem.gravity_at_tool_speed
    X_BW = invert_pose(problem.cell.X_WB)
    count = len(FLIGHT_SHARES)
    goal = X_BW[:3, :3] @ target.p_W + X_BW[:3, 3]
    up = X_BW[:3, 2]  # in the base, like p and v
    w = np.zeros((count, 6))
    T = np.full(count, float((limits.qd_max / limits.qdd_max).max()))  # to full speed, at first
    q_best = np.zeros((count, 6))
    qd_best = np.zeros((count, 6))
    least = np.full(count, np.inf)
    for step in range(STEPS):
        q = np.clip(problem.start + w * (T / 2.0)[:, None], reachable.q_lower, reachable.q_upper)
        p, J = tool_motion(problem, q)
        t = FLIGHT_SHARES * np.maximum(slowest_time(p, goal, gravity), SHORTEST_FLIGHT_S)
        v = (goal - p) / t[:, None] + np.multiply.outer(0.5 * gravity * t, up)
        moved = tool_velocity(J, w)
        if step > 0:
            qd = w + allocate_velocity(J, v - moved, limits.qd_max)
            bound = penalised_bound(problem, q, qd)
            sooner = bound < least - TIE_S
            q_best[sooner], qd_best[sooner], least[sooner] = q[sooner], qd[sooner], bound[sooner]
        # A velocity that differs by dw moves the tool by J dw T / 2, and what throws from there by as much less over t.
        share = (T / 2.0 / t)[:, None]
        reached = np.minimum(limits.qdd_max * T[:, None], limits.qd_max)
        J_scaled = J * ((1.0 + share) * reached)[:, None, :]
        y = balanced_velocity(J_scaled, v + share * moved, ONES)
        w = np.round(np.clip(y * reached, -limits.qd_max, limits.qd_max), DECIMALS)
        T = np.round(np.maximum(T * np.abs(y).max(axis=1) ** CHANGE, problem.dt), DECIMALS)
    found = least < TOO_FAST_S
    return q_best[found], qd_best[found]
