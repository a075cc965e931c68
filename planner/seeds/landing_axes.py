"""Joint velocities that throw the object with a spin, so that it lands along the axis that a target asks for.

The tool's velocity leaves its rotation free: of the rotations that bring the object's axis about in the time of the
flight, to either end, the one that can be reached soonest counts, or the rotation of the least joint velocities where
that happens to do.
"""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, Mask
from planner.cell import ThrownBody
from planner.flight import landing_states
from planner.geometry import tool_pose
from planner.kinematics import jacobian
from planner.problem import ThrowProblem
from planner.releases import LandingAxis, Target
from planner.seeds.soonest_states import penalised_bound
from planner.seeds.velocity_allocation import allocate_velocity, largest_share
from planner.spin import turned

ROUNDS = 4  # of the iteration for bodies that do not turn evenly; round ones need one
SHARE = 0.5  # [-] of the tolerance that a release in time may take: what is left is for one that is early or late
STEP_RAD = 0.25  # [rad] of an integration: errors are below a thousandth of a radian
SHORTEST_S = 1e-3  # [s] of a flight: keeps one that ends at once from having no rate
TINY = 1e-12  # [-] sine below which two axes have no plane


def thrown_velocity(problem: ThrowProblem, target: Target, q: Array, J: Array, v_B: Array) -> Array:
    """Returns joint velocities (n, 6) [rad/s] that throw at a target; NaN where none lands along the axis asked for.

    Args:
        problem: its cell and limits.
        target: of the throw.
        q: postures (n, 6) [rad].
        J: their linear Jacobians (n, 3, 6) [m/rad], in the base.
        v_B: velocities of the tool centre point (n, 3) [m/s], in the base.
    """
    least = allocate_velocity(J, v_B, problem.limits.qd_max)
    if target.orientation is None:
        return least
    # What is too fast without a spin is so with any.
    rows = np.flatnonzero(largest_share(least, problem.limits.qd_max) <= 1.0)
    if len(rows) > 0:
        least[rows] = _spun(problem, target.orientation, q[rows], v_B[rows], least[rows])
    return least


def _spun(problem: ThrowProblem, asked: LandingAxis, q: Array, v_B: Array, least: Array) -> Array:
    """Returns what `thrown_velocity` does, with the least joint velocities (n, 6) [rad/s] for the tool's."""
    cell = problem.cell
    thing = cell.object
    assert isinstance(thing, ThrownBody)
    X_WT = tool_pose(cell, q)
    R_WB = cell.X_WB[:3, :3]
    leaves = problem.release_speed_factor * v_B @ R_WB.T
    flown = landing_states(X_WT[:, :3, 3], leaves, problem.plane_z, problem.gravity, problem.drag)
    time_s = np.maximum(np.nan_to_num(flown.time_s), SHORTEST_S)
    R_WO = X_WT[:, :3, :3] @ thing.R_TO
    J_B = jacobian(cell.robot, q, cell.tool.X_FT)
    ways = [least]
    for end in (asked.axis_W, -asked.axis_W):
        w_W = _spin(R_WO, end, thing.inertia_kg_m2, time_s)
        V_B = np.concatenate([v_B, w_W @ R_WB], axis=1)
        ways.append(np.asarray(np.linalg.solve(J_B, V_B[..., None])[..., 0], np.float64))
    qd = np.stack(ways)
    spins = (J_B[:, 3:] @ qd[..., None])[..., 0] @ R_WB.T
    bound = penalised_bound(problem, q, qd)
    for row, w_W in enumerate(spins):
        bound[row, ~_lands(asked, R_WO, w_W, thing, time_s)] = np.inf
    best = bound.argmin(axis=0), np.arange(len(q))
    return np.where(np.isfinite(bound[best])[:, None], qd[best], np.nan)


def _lands(asked: LandingAxis, R_WO: Array, w_W: Array, thing: ThrownBody, time_s: Array) -> Mask:
    """Returns which bodies (n,) with spins `w_W` (n, 3) [rad/s] land well within the tolerance of an axis."""
    axes = turned(R_WO, w_W, thing.inertia_kg_m2, time_s, STEP_RAD)[:, :, 2]
    return np.asarray(asked.angles(axes) <= SHARE * asked.tolerance_rad)


def _spin(R_WO: Array, goal: Array, inertia: Array, time_s: Array) -> Array:
    """Returns angular velocities (n, 3) [rad/s] that turn the z axes of bodies to `goal` (3,) in times (n,) [s]."""
    w = np.zeros((len(R_WO), 3))
    for _ in range(ROUNDS):
        axes = turned(R_WO, w, inertia, time_s, STEP_RAD)[:, :, 2]
        across = np.cross(axes, goal)
        sine = np.linalg.norm(across, axis=1)
        angle = np.arctan2(sine, axes @ goal)
        w = w + across * (angle / np.maximum(sine, TINY) / time_s)[:, None]
    return w
