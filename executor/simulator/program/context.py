"""Context of a running program: the parts of the controller it may use, handed in as one object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from executor.simulator.physics import Arm, Transform, kinematics
from executor.simulator.program.registers import Registers
from executor.simulator.program.safety import SafetyLimits
from planner.kinematics import inverse
from planner.robots import Robot


@dataclass
class Installation:
    """Tool, payload and mounting as the controller believes them; a client may change them, the true ones stay.

    Attributes:
        payload_kg: mass of the payload [kg].
        payload_cog_m: its centre of mass in the flange's frame [m].
        gravity_m_s2: against the fall, in the base (UR's sign) [m/s2].
        payload_inertia: inertia of the payload (6,) [kg m2].
        tcp: pose of the tool centre point in the flange.
        tcp_pose: the same as UR's pose (6,) [m, rad].
    """

    payload_kg: float
    payload_cog_m: list[float]
    gravity_m_s2: list[float]
    payload_inertia: list[float] = field(default_factory=lambda: [0.0] * 6)
    tcp: Transform = kinematics.IDENTITY
    tcp_pose: list[float] = field(default_factory=lambda: [0.0] * 6)

    def set_tcp(self, tcp: Transform) -> None:
        """Changes the tool centre point."""
        self.tcp, self.tcp_pose = tcp, kinematics.pose_of(tcp)


@dataclass(frozen=True)
class ProgramContext:
    """Parts of the controller that script functions read or act on.

    Attributes:
        robot: constants of the arm, for the closed-form inverse kinematics.
        arm: the arm the program moves.
        registers: registers shared with the client.
        installation: tool, payload and mounting.
        limits: safety limits.
        speed_scaling: returns the present speed scaling, 0 to 1.
        in_contact: returns whether the tool touches something.
        set_watchdog: sets the RTDE watchdog: register, least frequency [Hz].
        protective_stop: triggers a protective stop with a reason.
    """

    robot: Robot
    arm: Arm
    registers: Registers
    installation: Installation
    limits: SafetyLimits
    speed_scaling: Callable[[], float]
    in_contact: Callable[[], bool]
    set_watchdog: Callable[[int, float], None]
    protective_stop: Callable[[str], None]

    @property
    def tcp(self) -> Transform:
        """Pose of the tool centre point in the flange, as the controller believes it."""
        return self.installation.tcp

    def solve(self, pose: list[float], near: list[float] | None = None) -> list[float] | None:
        """Returns the joint angles of a tool pose, or None if there are none.

        Args:
            pose: UR's pose of the tool in the base (6,) [m, rad].
            near: joint angles (6,) [rad] that the solution is to be nearest to; the commanded ones by default.
        """
        near = list(self.arm.q) if near is None else near
        goal = kinematics.transform(pose)
        q = self.arm.chain.solve(goal, near, self.tcp)
        if q is not None and self.limits.allows(q):
            return q
        found = inverse(self.robot, _matrix(goal), X_FT=_matrix(self.tcp)).q
        if not len(found):
            return None
        return found[int(np.argmin(np.abs(found - near).max(axis=1)))].tolist()


def _matrix(t: Transform) -> np.ndarray:
    return np.array([*t, 0.0, 0.0, 0.0, 1.0]).reshape(4, 4)
