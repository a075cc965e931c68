"""Safety state of the controller: modes, status bits, robot mode, and the limits that are monitored.

Source of modes and bits: Universal Robots, RTDE guide, `safety_mode`, `safety_status_bits`, `robot_mode`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

NORMAL, REDUCED, PROTECTIVE_STOPPED, RECOVERY, SAFEGUARD_STOPPED = (1 << bit for bit in range(5))
SYSTEM_EMERGENCY, ROBOT_EMERGENCY, EMERGENCY_STOPPED, VIOLATION, FAULT, STOPPED_DUE_TO_SAFETY = (
    1 << bit for bit in range(5, 11)
)

MODE_NORMAL = 1
MODE_PROTECTIVE_STOP = 3
MODE_SAFEGUARD_STOP = 5
MODE_ROBOT_EMERGENCY_STOP = 7

AT_REST = 1e-9  # [rad/s] speed below which a joint stands
HARDEST = 2.0  # [-] chosen: deceleration before a joint's limit over the greatest commanded one

ROBOT_POWER_OFF = 3
ROBOT_IDLE = 5
ROBOT_RUNNING = 7


class SafetyState:
    """Safety mode and power of the robot.

    Attributes:
        mode: RTDE's safety_mode.
        bits: RTDE's safety_status_bits.
        reason: cause of the stop in force, empty without one.
        stopped_at: controller time of the last stop [s].
        robot_mode: RTDE's robot_mode.
        deceleration: braking of the leading axis in cycles without a commanded motion [rad/s^2].
    """

    def __init__(self, deceleration: float) -> None:
        self.robot_mode = ROBOT_RUNNING
        self.stopped_at = 0.0
        self.deceleration = deceleration
        self.clear()

    def clear(self) -> None:
        """Returns to normal operation from any stop."""
        self.mode = MODE_NORMAL
        self.bits = NORMAL
        self.reason = ""

    def power_on(self) -> None:
        """Powers the arm, unless a stop is in force; the brakes stay engaged."""
        if not self.stopped and self.robot_mode < ROBOT_IDLE:
            self.robot_mode = ROBOT_IDLE

    def release_brakes(self) -> None:
        """Releases the brakes, unless a stop is in force; an arm without power gets it before."""
        self.power_on()
        if not self.stopped and self.robot_mode == ROBOT_IDLE:
            self.robot_mode = ROBOT_RUNNING

    @property
    def powered(self) -> bool:
        """Whether the arm has power."""
        return self.robot_mode >= ROBOT_IDLE

    @property
    def stopped(self) -> bool:
        """Whether a safety stop is in force."""
        return self.mode != MODE_NORMAL

    @property
    def may_move(self) -> bool:
        """Whether programs may run and move the arm."""
        return not self.stopped and self.robot_mode == ROBOT_RUNNING


@dataclass(frozen=True)
class SafetyLimits:
    """Limits monitored on the commanded motion; a violation is a protective stop."""

    q_lower: Sequence[float]  # [rad]
    q_upper: Sequence[float]  # [rad]
    qd_max: Sequence[float]  # [rad/s], tolerance included
    qdd_max: Sequence[float]  # [rad/s^2]
    tcp_speed_max: float  # [m/s]

    def violation(self, q: Sequence[float], qd: Sequence[float], qdd: Sequence[float], tcp_speed: float) -> str | None:
        """Returns a description of the first violated limit, None if there is none."""
        for i in range(6):
            if self._stopping(q[i], qd[i], i) > self.qdd_max[i]:
                return f"joint position limit of joint {i}: {q[i]:.4g} rad"
            if not abs(qd[i]) <= self.qd_max[i]:
                return f"joint speed limit of joint {i}: {qd[i]:.4g} rad/s"
            if not abs(qdd[i]) <= self.qdd_max[i]:
                return f"joint acceleration limit of joint {i}: {qdd[i]:.4g} rad/s2"
        if not tcp_speed <= self.tcp_speed_max:
            return f"tool speed limit: {tcp_speed:.4g} m/s above {self.tcp_speed_max:.4g} m/s"
        return None

    def _stopping(self, q: float, qd: float, joint: int) -> float:
        """Returns the deceleration that brings a joint to rest at the limit that it moves to [rad/s^2].

        A joint beyond its limit may move back. Rounding counts for nothing: a joint that stands moves to no limit.
        """
        left = self.q_upper[joint] - q if qd > 0.0 else q - self.q_lower[joint]
        if abs(qd) < AT_REST:
            return 0.0
        return 0.5 * qd * qd / left if left > 0.0 else math.inf

    def stopping(self, q: Sequence[float], qd: Sequence[float]) -> float:
        """Returns the deceleration of the leading axis that stops every joint before its limit, within reason.

        [rad/s^2]; twice what a joint may do on command at most, for one that is only just too late.
        """
        leading = max(map(abs, qd))
        needed = [self._stopping(q[i], qd[i], i) * leading / abs(qd[i]) for i in range(6) if abs(qd[i]) > AT_REST]
        return min(max(needed, default=0.0), HARDEST * max(self.qdd_max))

    def allows(self, q: Sequence[float]) -> bool:
        """Whether joint positions (6,) [rad] are within the limits."""
        return all(a <= x <= b for a, x, b in zip(self.q_lower, q, self.q_upper, strict=True))
