"""The joint motions of a line: a branch of the inverse kinematics at every tick, joined by one jerk a tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.errors import Infeasible, Violation
from planner.geometry import body_model, twist_in_base
from planner.kinematics import SINGULARITIES, inverse_branches, inverse_velocity, jacobian, signed_singularity_distances
from planner.problem import ThrowProblem
from planner.releases import SteadyLine
from planner.rotations import invert_pose
from planner.trajectory import interpolate

CLEAR_M = 0.02  # [m] of a line between postures that are looked at; the certificate proves what is between them
SLACK = 1e-9  # [-] of a limit, [rad] of a position: rounding
REGULAR = 1e-6  # [-] least distance from a singularity of postures whose Jacobian is inverted
FULL_TURN = 2.0 * np.pi
Motion = tuple[Array, Array, Array]  # q, qd, qdd (n, 6) at the ticks of a line


class LineObstacle(NamedTuple):
    """What stands in the way along a line, and from which tick on."""

    tick: int
    violation: Violation


def line_motions(problem: ThrowProblem, starts: Sequence[Array]) -> list[Motion]:
    """Returns the motions along a line that keep the joints' limits, and are clear of everything where that is seen.

    Args:
        problem: of passing the line alone.
        starts: joint positions (6,) in which it may begin [rad].

    Raises:
        Infeasible: there is none; names what ends the motion that leads farthest, with the place.
    """
    branches = _Branches.of(problem)
    made = cache(branches.along)
    found = []
    obstacles = []
    for start in starts:
        branch, turns = branches.of_start(start)
        motion = made(branch)
        if not isinstance(motion, LineObstacle):
            q, qd, qdd = motion
            motion = branches.beyond_position(q + turns) or (q + turns, qd, qdd)
        (obstacles if isinstance(motion, LineObstacle) else found).append(motion)
    if not found:
        raise Infeasible([max(obstacles, key=lambda each: each.tick).violation])
    return found


@dataclass(frozen=True, eq=False)
class _Branches:
    """The branches of the inverse kinematics along a line.

    Attributes:
        problem: of passing the line alone.
        line: to be passed.
        q: postures at the ticks (n, 8, 6) [rad], without jumps of full turns; NaN from where one is out of reach.
        excess: by how much they are out of reach (n, 8) [m].
    """

    problem: ThrowProblem
    line: SteadyLine
    q: Array
    excess: Array

    @classmethod
    def of(cls, problem: ThrowProblem) -> _Branches:
        """Returns the branches of a problem."""
        line = problem.release
        assert isinstance(line, SteadyLine)
        cell = problem.cell
        t = problem.dt * np.arange(problem.passages[0].ticks(1.0 / problem.dt) + 1, dtype=np.float64)
        q, excess = inverse_branches(cell.robot, invert_pose(cell.X_WB) @ line.poses(t), cell.tool.X_FT)
        return cls(problem, line, np.unwrap(q, axis=0), excess)

    def of_start(self, start: Array) -> tuple[int, Array]:
        """Returns the branch of joint positions (6,) at the line's start, and their full turns beside it [rad]."""
        turns = FULL_TURN * np.round((start - self.q[0]) / FULL_TURN)
        branch = int(np.nanargmin(np.abs(self.q[0] + turns - start).max(axis=1)))
        return branch, turns[branch]

    def along(self, branch: int) -> Motion | LineObstacle:
        """Returns the motion on a branch, whatever full turns it makes; or what ends it."""
        obstacle = _first_of(self._beyond_reach(branch), self._near_singularity(branch))
        if obstacle is not None:
            return obstacle
        cell = self.problem.cell
        q = self.q[:, branch]
        V_BT = twist_in_base(cell, self.line.V_WT)
        qd_first, qd_last = inverse_velocity(jacobian(cell.robot, q[[0, -1]], cell.tool.X_FT), np.tile(V_BT, (2, 1)))
        motion = interpolate(q, qd_first, qd_last, self.problem.dt)
        return self._beyond_rates(motion) or self._too_fast_beside(motion) or self._blocked(q) or motion

    def _beyond_reach(self, branch: int) -> LineObstacle | None:
        lost = np.isnan(self.q[:, branch]).any(axis=1)
        if not lost.any():
            return None
        tick = int(lost.argmax())
        X_WB = self.problem.cell.X_WB
        away = float(np.linalg.norm(self.line.poses(np.array([self.problem.dt * tick]))[0, :3, 3] - X_WB[:3, 3]))
        reach = away - float(self.excess[tick, branch])
        violation = Violation("reach", away, reach, "m", detail="distance from the arm's base")
        return LineObstacle(tick, self._at(tick, violation))

    def _near_singularity(self, branch: int) -> LineObstacle | None:
        """Returns where a branch is too near to a singularity, or passes one between two ticks."""
        signed = signed_singularity_distances(self.problem.cell.robot, self.q[:, branch])
        distances = signed * np.sign(signed[0])
        limit = max(self.problem.limits.singularity_distance_min, REGULAR)
        return self._first("singularity_distance", -distances, np.full(3, -limit), "1", SINGULARITIES, -1.0)

    def _beyond_rates(self, motion: Motion) -> LineObstacle | None:
        limits = self.problem.limits
        names = self.problem.cell.robot.joint_names
        jerk = np.diff(motion[2], axis=0) / self.problem.dt
        rows = (
            ("joint_velocity", motion[1], limits.qd_max, "rad/s"),
            ("joint_acceleration", motion[2], limits.qdd_max, "rad/s^2"),
            ("joint_jerk", jerk, limits.jerk_max, "rad/s^3"),
        )
        return _first_of(*(self._first(name, np.abs(values), limit, unit, names) for name, values, limit, unit in rows))

    def _too_fast_beside(self, motion: Motion) -> LineObstacle | None:
        """Returns the end of the line beside which a joint is too fast, whatever motion leads there or goes on.

        An acceleration a takes |a| / j to build up or fade, in which the velocity changes by a^2 / 2j.
        """
        limits = self.problem.limits
        _, qd, qdd = motion
        change = qdd * np.abs(qdd) / (2.0 * limits.jerk_max)
        found = []
        for end, sign, what in ((0, -1.0, "as its acceleration builds up"), (-1, 1.0, "as its acceleration fades")):
            speeds = np.zeros_like(qd)
            speeds[end] = np.abs(qd[end] + sign * change[end])
            names = [f"{joint} {what}" for joint in self.problem.cell.robot.joint_names]
            found.append(self._first("joint_velocity", speeds, limits.qd_max, "rad/s", names))
        return _first_of(*found)

    def beyond_position(self, q: Array) -> LineObstacle | None:
        """Returns where joint positions (n, 6) [rad] leave their limits."""
        limits = self.problem.limits
        names = self.problem.cell.robot.joint_names
        above = self._first("joint_position", q, limits.q_upper, "rad", names)
        below = self._first("joint_position", -q, -limits.q_lower, "rad", names, -1.0)
        return _first_of(above, below)

    def _blocked(self, q: Array) -> LineObstacle | None:
        """Returns the first of the postures looked at that is not clear of everything."""
        body = body_model(self.problem.cell_with_bin)
        holds = self.problem.holds_object
        step = max(1, int(CLEAR_M / (self.line.speed_m_s * self.problem.dt)))
        looked_at = np.append(np.arange(0, len(q) - 1, step), len(q) - 1)
        hit = np.flatnonzero(body.clearances(q[looked_at], holds).least < 0.0)
        if len(hit) == 0:
            return None
        tick = int(looked_at[hit[0]])
        return LineObstacle(tick, self._at(tick, body.violations_at(q[tick], holds)[0].in_passing()))

    def _first(
        self, name: str, values: Array, limits: Array, unit: str, names: Sequence[str], sign: float = 1.0
    ) -> LineObstacle | None:
        """Returns which of `values` (n, m) is above its limit (m,) first, and the largest of it; None where none is.

        Values and limits are told times `sign`.
        """
        over = values > limits + SLACK * np.abs(limits)
        ticks = np.where(over.any(axis=0), over.argmax(axis=0), len(values))
        which = int(ticks.argmin())
        if ticks[which] == len(values):
            return None
        worst = int(np.nanargmax(values[:, which]))
        violation = Violation(
            name, sign * float(values[worst, which]), sign * float(limits[which]), unit, detail=names[which]
        )
        return LineObstacle(int(ticks[which]), self._at(worst, violation))

    def _at(self, tick: int, violation: Violation) -> Violation:
        """Returns a violation with its place on the line."""
        along_m = min(tick * self.problem.dt * self.line.speed_m_s, self.line.length_m)
        return replace(violation, detail=f"{violation.detail}, {along_m:.3f} m along the line")


def _first_of(*found: LineObstacle | None) -> LineObstacle | None:
    """Returns the obstacle that comes first."""
    return min(filter(None, found), key=lambda each: each.tick, default=None)
