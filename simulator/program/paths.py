"""Paths of a move: joint positions, and their change with the distance, at every distance from the start."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from simulator.physics import Arm, Transform, kinematics
from simulator.program.threads import ProgramError

ROTATION_LEVER_M = 0.3  # [m/rad] chosen: length that a pure rotation counts along a move of the tool
RATE_DAMPING = 1e-6  # chosen: of the inverse Jacobian, so that a singular arm moves slowly instead of jumping
LOOKS = (0.0, 0.25, 0.5, 0.75, 1.0)  # chosen: shares of a path that are solved before it begins
COLLINEAR = 1e-6  # [-] sine of the angle between the chords of an arc below which they are one line

Joints = list[float]


class Path(Protocol):
    """A path from where the arm stands to a goal.

    Attributes:
        length: of the path [rad or m].
        goal: joint positions (6,) [rad] at its end, or at the last place that could be solved.
        reaches_goal: whether that is its end.
        rates: changes of the joints per unit of distance, (6,) each, at some places of it.
    """

    length: float
    goal: Joints
    reaches_goal: bool
    rates: list[Joints]

    def at(self, distance: float) -> tuple[Joints, Joints]:
        """Returns joint positions (6,) [rad] at a distance from the start, and their change per unit of distance."""
        ...


class JointPath:
    """All joints in proportion; the length is that of the leading one [rad]."""

    reaches_goal = True

    def __init__(self, start: Sequence[float], goal: Sequence[float]) -> None:
        self.start = list(start)
        offset = [b - a for a, b in zip(start, goal, strict=True)]
        self.length = max(map(abs, offset))
        self.goal = list(goal)
        self.slope = [w / self.length if self.length > 0.0 else 0.0 for w in offset]
        self.rates = [self.slope]

    def at(self, distance: float) -> tuple[Joints, Joints]:
        """See `Path`."""
        return [a + w * distance for a, w in zip(self.start, self.slope, strict=True)], self.slope


class ToolPath:
    """A path of the tool; each point is solved from the joint angles of the one before.

    Attributes:
        start: pose of the tool in the base at the start.
        length: of the way of its point [m], or of its turn times a lever where that is longer.
    """

    def __init__(self, arm: Arm, q: Sequence[float], tool: Transform) -> None:
        self.arm = arm
        self.tool = tool
        self.near = list(q)
        self.goal = list(q)
        self.reaches_goal = True
        self.rates: list[Joints] = []
        self.start = arm.chain.forward(q, tool)
        self.length = 0.0

    def _look_ahead(self) -> None:
        """Solves some places of the path, up to the first where the arm cannot be: told when it gets there."""
        first = self.near
        for share in LOOKS if self.length > 0.0 else ():
            try:
                self.goal, rates = self.at(share * self.length)
            except ProgramError:
                self.reaches_goal = False
                break
            self.rates.append(rates)
        self.near = first

    def pose(self, share: float) -> Transform:
        """Returns the pose at a share of the length."""
        raise NotImplementedError

    def twist(self, share: float) -> list[float]:
        """Returns the twist (6,) [m, rad] over the whole path, as it is at a share of it."""
        raise NotImplementedError

    def at(self, distance: float) -> tuple[Joints, Joints]:
        """See `Path`.

        Raises:
            ProgramError: the arm cannot be there.
        """
        share = distance / self.length
        q = self.arm.chain.solve(self.pose(share), self.near, self.tool)
        if q is None:
            raise ProgramError("get_inverse_kin: unable to find an inverse kinematics solution")
        self.near = q
        J, _ = self.arm.chain.jacobian(q, self.tool)
        return q, joint_rates(J, np.array(self.twist(share)) / self.length)


class StraightLine(ToolPath):
    """A straight line; the rotation in proportion."""

    def __init__(self, arm: Arm, q: Sequence[float], goal: Transform, tool: Transform) -> None:
        super().__init__(arm, q, tool)
        self.offset = [goal[i] - self.start[i] for i in (3, 7, 11)]
        self.turn = kinematics.rotation_vector(kinematics.product(goal, kinematics.inverse(self.start)))
        self.length = max(math.hypot(*self.offset), math.hypot(*self.turn) * ROTATION_LEVER_M)
        self._look_ahead()

    def pose(self, share: float) -> Transform:
        """See `ToolPath`."""
        point = [self.start[i] + share * w for i, w in zip((3, 7, 11), self.offset, strict=True)]
        return _placed(_turned(self.start, self.turn, share), point)

    def twist(self, share: float) -> list[float]:
        """See `ToolPath`."""
        return [*self.offset, *self.turn]


class Arc(ToolPath):
    """A circular arc through a point to a goal."""

    def __init__(
        self, arm: Arm, q: Sequence[float], via: Transform, goal: Transform, tool: Transform, fixed: bool
    ) -> None:
        """With `fixed` the tool keeps its orientation to the tangent, otherwise it turns to that of the goal.

        Raises:
            ProgramError: the three points lie on one line.
        """
        super().__init__(arm, q, tool)
        begin, middle, end = (np.array([t[3], t[7], t[11]]) for t in (self.start, via, goal))
        normal = np.cross(middle - begin, end - begin)
        size = float(np.linalg.norm(normal))
        if size <= COLLINEAR * float(np.linalg.norm(middle - begin) * np.linalg.norm(end - begin)):
            raise ProgramError("movec: the three points lie on one line")
        self.axis = normal / size
        self.center = _circumcenter(begin, middle, end)
        self.radius = begin - self.center
        side = np.cross(self.axis, self.radius)
        self.angle = math.atan2((end - self.center) @ side, (end - self.center) @ self.radius) % (2.0 * math.pi)
        turn = kinematics.rotation_vector(kinematics.product(goal, kinematics.inverse(self.start)))
        self.turn = tuple(map(float, self.angle * self.axis)) if fixed else turn
        radius_m = float(np.linalg.norm(self.radius))
        self.length = max(self.angle * radius_m, math.hypot(*turn) * ROTATION_LEVER_M)
        self._look_ahead()

    def pose(self, share: float) -> Transform:
        """See `ToolPath`."""
        return _placed(_turned(self.start, self.turn, share), (self.center + self._spoke(share)).tolist())

    def twist(self, share: float) -> list[float]:
        """See `ToolPath`."""
        return [*(self.angle * np.cross(self.axis, self._spoke(share))).tolist(), *self.turn]

    def _spoke(self, share: float) -> np.ndarray:
        """Returns the vector from the center to the point of the arc."""
        angle = share * self.angle
        return math.cos(angle) * self.radius + math.sin(angle) * np.cross(self.axis, self.radius)


def _circumcenter(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Returns the center of the circle through three points."""
    u = b - a
    v = c - a
    normal = np.cross(u, v)
    return a + np.cross((u @ u) * v - (v @ v) * u, normal) / (2.0 * (normal @ normal))


def _turned(pose: Transform, turn: Sequence[float], share: float) -> Transform:
    return kinematics.product(kinematics.transform([0.0, 0.0, 0.0, *(share * x for x in turn)]), pose)


def _placed(pose: Transform, point: Sequence[float]) -> Transform:
    x, y, z = point
    return (*pose[:3], x, *pose[4:7], y, *pose[8:11], z)


def joint_rates(jacobian: np.ndarray, twist: np.ndarray) -> Joints:
    """Returns the joint speeds (6,) [rad/s] of a twist (6,) [m/s, rad/s], lightly damped."""
    J = jacobian
    return (J.T @ np.linalg.solve(J @ J.T + RATE_DAMPING * np.eye(6), twist)).tolist()
