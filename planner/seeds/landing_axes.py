"""Joint velocities that throw a body so that it first touches what it is to land on at the target, turned as asked.

The tool's velocity leaves its rotation free: of the rotations that bring the body's axis about in the time of the
flight, to either end, the one that can be reached soonest counts, or the rotation of the least joint velocities where
that happens to do. How the body is turned then tells how high its centre is as it touches, and that the velocity.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.arrays import Array, Mask
from planner.cell import ThrownBody
from planner.flight import landing_states, launch_velocity
from planner.geometry import tool_pose
from planner.kinematics import jacobian
from planner.problem import ThrowProblem
from planner.releases import LandingAxis, Target
from planner.seeds.launches import allowed_velocity
from planner.seeds.soonest_states import penalised_bound
from planner.seeds.velocity_allocation import allocate_velocity, largest_share
from planner.spin import turned
from planner.touchdown import Touchdowns

ROUNDS = 4  # of the iteration for bodies that do not turn evenly; round ones need one
HEIGHT_ROUNDS = 6  # of that for the height at which a body touches which turns as its tool's velocity makes it
SHARE = 0.5  # [-] of the tolerance that a release in time may take: what is left is for one that is early or late
STEP_RAD = 0.25  # [rad] of an integration: errors are below a thousandth of a radian
FASTER = 1.2  # [-] share of a joint's limit: the least velocity changes a little with the height of the touch
SHORTEST_S = 1e-3  # [s] of a flight: keeps one that ends at once from having no rate
HIT_M = 2e-4  # [m] from the target at which a body is to touch: half of what the certificate allows
TINY = 1e-12  # [-] sine below which two axes have no plane


def aimed_at(problem: ThrowProblem, target: Target) -> Target:
    """Returns a target for the centre of a body that is to touch at another: as much higher as it may well be there.

    In the middle between the least and the most that the centre can be above what it lands on. That of a ball, or in
    the air, is the target itself.
    """
    body = problem.body
    touched_z = problem.touched_z
    if body is None or touched_z is None:
        return target
    middle = 0.5 * (body.inner_radius_m + body.outer_radius_m)
    return replace(target, p_W=np.array([*target.p_W[:2], touched_z + middle]))


def thrown_velocity(problem: ThrowProblem, target: Target, q: Array, J: Array, v_B: Array, drag: float = 0.0) -> Array:
    """Returns joint velocities (n, 6) [rad/s] that throw at a target; NaN where no body lands there as it is asked to.

    Args:
        problem: its cell and limits.
        target: of the throw.
        q: postures (n, 6) [rad].
        J: their linear Jacobians (n, 3, 6) [m/rad], in the base.
        v_B: velocities of the tool centre point (n, 3) [m/s], in the base; of a body those that throw its centre to
            where `aimed_at` has it.
        drag: k of `planner.flight.drag_constant` [1/m]; most states are looked for without.
    """
    least = allocate_velocity(J, v_B, problem.limits.qd_max)
    if problem.body is None:
        return least
    # What is too fast without a spin is so with any.
    rows = np.flatnonzero(largest_share(least, problem.limits.qd_max) <= FASTER)
    found = np.full(least.shape, np.nan)
    if len(rows) > 0:
        found[rows] = _Throws(problem, problem.body, target, q[rows], J[rows], v_B[rows], drag).best(least[rows])
    return found


class _Throws:
    """Throws of a body from n postures, each in a given time."""

    def __init__(
        self, problem: ThrowProblem, body: ThrownBody, target: Target, q: Array, J: Array, v_B: Array, drag: float
    ) -> None:
        """Takes what `thrown_velocity` does."""
        cell = problem.cell
        self._drag = drag
        self._problem = problem
        self._body = body
        self._target = target
        self._q = q
        self._J = J
        self._X_WT = tool_pose(cell, q)
        self._R_WB = cell.X_WB[:3, :3]
        self._J_B = jacobian(cell.robot, q, cell.tool.X_FT)
        leaves = problem.release_speed_factor * v_B @ self._R_WB.T
        aim = aimed_at(problem, target)
        flown = landing_states(self._p_WT, leaves, float(aim.p_W[2]), problem.gravity, drag)
        self._time_s = np.maximum(np.nan_to_num(flown.time_s), SHORTEST_S)

    @property
    def _p_WT(self) -> Array:
        return self._X_WT[:, :3, 3]

    @property
    def _R_WO(self) -> Array:
        return self._X_WT[:, :3, :3] @ self._body.R_TO

    def best(self, least: Array) -> Array:
        """Returns the joint velocities (n, 6) that a launch reaches soonest, see `thrown_velocity`.

        Args:
            least: joint velocities (n, 6) [rad/s] that are least for a velocity about as it needs to be.
        """
        ways = [self._least(least)]
        asked = self._target.orientation
        if asked is not None:
            for end in (asked.axis_W, -asked.axis_W):
                w_W = _spin(self._R_WO, end, self._body.inertia_kg_m2, self._time_s)
                V_B = np.concatenate([self._velocity(w_W) @ self._R_WB, w_W @ self._R_WB], axis=1)
                ways.append(np.asarray(np.linalg.solve(self._J_B, V_B[..., None])[..., 0], np.float64))
        qd = np.stack(ways)
        bound = penalised_bound(self._problem, self._q, np.nan_to_num(qd, nan=1e3))
        for row, each in enumerate(qd):
            bound[row, ~self._hits(each)] = np.inf
        first = bound.argmin(axis=0), np.arange(len(self._q))
        return np.where(np.isfinite(bound[first])[:, None], qd[first], np.nan)

    def _least(self, qd: Array) -> Array:
        """Returns the least joint velocities (n, 6) for bodies that turn as these make them; from others near them."""
        for _ in range(HEIGHT_ROUNDS):
            v_B = self._velocity(self._spin_of(qd)) @ self._R_WB
            qd = allocate_velocity(self._J, v_B, self._problem.limits.qd_max)
        return qd

    def _spin_of(self, qd: Array) -> Array:
        """Returns the angular velocities (n, 3) [rad/s] in the world of joint velocities (n, 6) [rad/s]."""
        return np.asarray((self._J_B[:, 3:] @ qd[..., None])[..., 0] @ self._R_WB.T)

    def _velocity(self, w_W: Array) -> Array:
        """Returns the tool's velocities (n, 3) [m/s] with which bodies of spin w_W (n, 3) are down in their time."""
        problem = self._problem
        R_WO = turned(self._R_WO, w_W, self._body.inertia_kg_m2, self._time_s, STEP_RAD)
        aim = np.broadcast_to(aimed_at(problem, self._target).p_W, w_W.shape).copy()
        if problem.touched_z is not None:
            aim[:, 2] = problem.touched_z + self._body.below(R_WO)
        leaves = launch_velocity(self._p_WT, aim, self._time_s, problem.gravity, self._drag)
        return leaves / problem.release_speed_factor

    def _hits(self, qd: Array) -> Mask:
        """Returns which joint velocities (n, 6) throw the body so that its first touch is where and as it is asked."""
        problem = self._problem
        hits: Mask = np.asarray(np.isfinite(qd).all(axis=1))
        rows = np.flatnonzero(hits)
        v_W = ((self._J[rows] @ qd[rows, :, None])[..., 0]) @ self._R_WB.T
        landings: Touchdowns = problem.touchdowns(
            self._p_WT[rows], v_W, self._X_WT[rows, :3, :3], self._spin_of(qd)[rows]
        )
        landings = replace(landings, drag=self._drag)
        x = landings.centres_at(landings.time_s)
        kept: Mask = np.asarray(np.linalg.norm(x[:, :2] - self._target.p_W[:2], axis=1) <= HIT_M)
        kept &= allowed_velocity(problem, self._target, v_W)
        if (asked := self._target.orientation) is not None:
            kept &= _is_along(asked, landings)
        hits[rows] = kept
        return hits


def _is_along(asked: LandingAxis, landings: Touchdowns) -> Mask:
    """Returns which bodies (n,) land well within the tolerance of an axis."""
    axes = landings.axes_at(landings.time_s)[:, :, 2]
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
