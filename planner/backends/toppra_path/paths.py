"""Joint paths q(s) with their first two derivatives, to be timed by TOPP-RA.

`ProfilePath` is the curve of a velocity profile, parameterised by the profile's time. The profile itself is a timing
within the limits on velocity and acceleration, so a feasible timing exists.
`JointLine` is a straight line in joint space, `ToolLine` a straight line of the tool, which turns at a constant rate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.cell import Cell
from planner.errors import SolverFailed
from planner.kinematics import forward, inverse_branches, inverse_velocity, jacobian, jacobian_dot_qd
from planner.rotations import pose, rotation_vector_to_matrix
from planner.timing import CubicProfile, TrapezoidProfile

Vector = NDArray[np.float64]
Derivatives = tuple[Vector, Vector, Vector]

STEP_RAD = 0.7  # [rad] a larger step between neighbouring samples of a tool line is a jump past a singularity
SINGULAR = "the straight line passes a singularity"
LINE_SAMPLES = 33  # postures of a tool line, followed from the release outwards


@dataclass(frozen=True, eq=False)
class ProfilePath:
    """The curve of a velocity profile from `start` (6,) [rad], parameterised by the profile's time [s]."""

    start: Vector
    profile: CubicProfile | TrapezoidProfile
    begin: float = 0.0

    @property
    def end(self) -> float:
        """Duration of the profile [s]."""
        return self.profile.duration_s

    def at(self, s: Vector) -> Derivatives:
        """Returns q, dq/ds, d2q/ds2 (k, 6) at `s` (k,) [s]."""
        q, dq, ddq = self.profile.at(s)
        return self.start + q, dq, ddq


@dataclass(frozen=True, eq=False)
class JointLine:
    """Straight line in joint space: q = origin + s direction."""

    origin: Vector
    direction: Vector
    begin: float
    end: float

    def at(self, s: Vector) -> Derivatives:
        """Returns q, dq/ds, d2q/ds2 (k, 6) at `s` (k,)."""
        q = self.origin + np.asarray(s)[:, None] * self.direction
        return q, np.broadcast_to(self.direction, q.shape), np.zeros_like(q)


@dataclass(frozen=True, eq=False)
class ToolLine:
    """Straight line of the tool through the pose of `q` at s = 0, with the constant twist of (q, qd).

    At path speed ds/dt = 1 the tool moves and turns evenly. The arm stays on its branch of the inverse kinematics.
    `at` raises `SolverFailed` where the line leaves the arm's reach or passes a singularity.
    """

    cell: Cell
    q: Vector
    qd: Vector
    begin: float
    end: float

    def at(self, s: Vector) -> Derivatives:
        """Returns q, dq/ds, d2q/ds2 (k, 6) at `s` (k,) [s]."""
        robot = self.cell.robot
        X_FT = self.cell.tool.X_FT
        known_s, known_q = self._followed
        near = known_q[np.abs(np.asarray(s)[:, None] - known_s).argmin(axis=1)]
        q = _nearest_turn(self._postures(s), near)
        J = jacobian(robot, q, X_FT)
        try:
            dq = inverse_velocity(J, np.broadcast_to(self._V_BT, q.shape))
            ddq = -inverse_velocity(J, jacobian_dot_qd(robot, q, dq, X_FT))
        except np.linalg.LinAlgError as error:
            raise SolverFailed(SINGULAR) from error
        return q, dq, ddq

    @cached_property
    def _X_BT(self) -> Vector:
        """Pose of the tool in the base frame (4, 4) at s = 0."""
        return forward(self.cell.robot, self.q, self.cell.tool.X_FT)

    @cached_property
    def _V_BT(self) -> Vector:
        """Twist of the tool in the base frame (6,), the same for every s."""
        return jacobian(self.cell.robot, self.q, self.cell.tool.X_FT) @ self.qd

    @cached_property
    def _branch(self) -> int:
        """Index of the branch of the inverse kinematics that `q` lies on."""
        branches, _ = inverse_branches(self.cell.robot, self._X_BT, self.cell.tool.X_FT)
        return int(np.nanargmin(np.abs(_nearest_turn(branches, self.q) - self.q).max(axis=-1)))

    @cached_property
    def _followed(self) -> tuple[Vector, Vector]:
        """Samples s (k,) and their postures (k, 6), continuous in the full turns of every joint from `q` outwards."""
        back, ahead = (np.linspace(0.0, edge, LINE_SAMPLES) for edge in (self.begin, self.end))
        s = np.concatenate([back[:0:-1], ahead])
        return s, np.concatenate([self._follow(back)[:0:-1], self._follow(ahead)])

    def _follow(self, s: Vector) -> Vector:
        q = np.unwrap(np.concatenate([self.q[None], self._postures(s)[1:]]), axis=0)
        if np.abs(np.diff(q, axis=0)).max() > STEP_RAD:
            raise SolverFailed(SINGULAR)
        return q

    def _postures(self, s: Vector) -> Vector:
        """Returns the branch's postures (k, 6) at `s` (k,), up to full turns."""
        s = np.asarray(s)[:, None]
        R = rotation_vector_to_matrix(s * self._V_BT[3:]) @ self._X_BT[:3, :3]
        X_BT = pose(self._X_BT[:3, 3] + s * self._V_BT[:3], R)
        q = inverse_branches(self.cell.robot, X_BT, self.cell.tool.X_FT)[0][:, self._branch]
        if np.isnan(q).any():
            raise SolverFailed("the straight line leaves the arm's reach")
        return q


Path = ProfilePath | JointLine | ToolLine  # over s in [begin, end]; `at` returns q, dq/ds, d2q/ds2 at s


def _nearest_turn(q: Vector, near: Vector) -> Vector:
    """Returns the angles `q` plus the full turns that bring them closest to `near`."""
    return q - 2.0 * np.pi * np.round((q - near) / (2.0 * np.pi))
