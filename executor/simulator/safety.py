"""Safety state: modes, bits, limits, and what a stop does to the arm and its program.

Source of modes and bits: Universal Robots, RTDE guide, `safety_mode`, `safety_status_bits`, `robot_mode`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

NORMAL, REDUCED, PROTECTIVE_STOPPED, RECOVERY, SAFEGUARD_STOPPED = (1 << bit for bit in range(5))
SYSTEM_EMERGENCY, ROBOT_EMERGENCY, EMERGENCY_STOPPED, VIOLATION, FAULT, STOPPED_DUE_TO_SAFETY = (
    1 << bit for bit in range(5, 11)
)

MODE_NORMAL, MODE_PROTECTIVE_STOP, MODE_SAFEGUARD_STOP, MODE_ROBOT_EMERGENCY_STOP = 1, 3, 5, 7
MODE_NAMES = {1: "NORMAL", 3: "PROTECTIVE_STOP", 5: "SAFEGUARD_STOP", 7: "ROBOT_EMERGENCY_STOP"}

ROBOT_POWER_OFF, ROBOT_IDLE, ROBOT_RUNNING = 3, 5, 7
ROBOT_MODE_NAMES = {3: "POWER_OFF", 5: "IDLE", 7: "RUNNING"}


class Safety:
    """The safety state of the controller: `mode`, `bits`, `robot_mode`, and the deceleration in force."""

    def __init__(self) -> None:
        self.robot_mode = ROBOT_RUNNING
        self.stopped_at = 0.0
        self.reason = ""
        self.clear()

    def clear(self) -> None:
        """Back to normal operation, whatever it was."""
        self.mode, self.bits, self.reason = MODE_NORMAL, NORMAL, ""

    def set(self, mode: int, bits: int, t: float, reason: str) -> None:
        """Enters a stop at `t` [s]."""
        self.mode, self.bits, self.stopped_at, self.reason = mode, bits | STOPPED_DUE_TO_SAFETY, t, reason

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
    """What the arm's safety system watches; a violation is a protective stop."""

    q_lower: Sequence[float]
    q_upper: Sequence[float]
    qd_max: Sequence[float]  # [rad/s], tolerance included
    qdd_max: Sequence[float]  # [rad/s^2]
    tcp_speed_max: float  # [m/s]

    def violation(self, q: Sequence[float], qd: Sequence[float], qdd: Sequence[float], tcp_speed: float) -> str | None:
        """Returns which limit the commanded motion violates, None where it keeps them all."""
        for i in range(6):
            if not self.q_lower[i] <= q[i] <= self.q_upper[i]:
                return f"joint position limit of joint {i}: {q[i]:.4g} rad"
            if not abs(qd[i]) <= self.qd_max[i]:
                return f"joint speed limit of joint {i}: {qd[i]:.4g} rad/s"
            if not abs(qdd[i]) <= self.qdd_max[i]:
                return f"joint acceleration limit of joint {i}: {qdd[i]:.4g} rad/s2"
        if not tcp_speed <= self.tcp_speed_max:
            return f"tool speed limit: {tcp_speed:.4g} m/s above {self.tcp_speed_max:.4g} m/s"
        return None

    def allows(self, q: Sequence[float]) -> bool:
        """Returns whether a joint position is within the limits."""
        return all(a <= x <= b for a, x, b in zip(self.q_lower, q, self.q_upper, strict=True))
