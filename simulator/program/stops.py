"""Stops from outside the program: protective, safeguard and emergency stop, loss of power; and recovery from them."""

from __future__ import annotations

from simulator.program import messages, safety
from simulator.program.runner import ProgramRunner

CODES = {  # words of a reason -> code
    "target": messages.SUDDEN_TARGET_CODE,
    "position limit": messages.JOINT_LIMIT_CODE,
    "by the program": messages.BY_PROGRAM_CODE,
}
PROGRAM_FATES = ("paused", "stopped", "playing")  # state of the program after a protective stop


class Stops:
    """Each stop sets safety state and deceleration, and pauses or ends the program."""

    def __init__(self, runner: ProgramRunner) -> None:
        self.safety = runner.safety
        self.timeline = runner.timeline
        self.settings = runner.settings
        self.runner = runner
        self.decelerations = self.settings.decelerations

    def protective(self, reason: str, program: str | None = None, deceleration: float = 0.0) -> None:
        """Category 2. The program is `paused`, `stopped`, or left `playing` as some versions leave it.

        Args:
            reason: what is told.
            program: its fate; None: as the settings have it.
            deceleration: what is needed at least [rad/s^2].
        """
        if self.safety.stopped:
            return
        self.timeline.note(f"protective stop: {reason}")
        code = next((code for word, code in CODES.items() if word in reason), 0)
        self.runner.board.post(messages.ErrorCode(code, 0, messages.WARNING, f"Protective stop: {reason}"))
        self._enter(
            safety.MODE_PROTECTIVE_STOP,
            safety.PROTECTIVE_STOPPED,
            reason,
            max(deceleration, self.decelerations.protective_stop),
        )
        fate = program or self.settings.protective_stop_runtime
        if fate == "stopped":
            self.runner.stop(reason)
        elif fate == "paused":
            self.runner.pause()

    def safeguard(self) -> None:
        """Category 2, from the safeguard input; the program is paused."""
        if self.safety.stopped:
            return
        reason = "safeguard stop"
        self.timeline.note(reason)
        self._enter(safety.MODE_SAFEGUARD_STOP, safety.SAFEGUARD_STOPPED, reason, self.decelerations.safeguard_stop)
        self.runner.pause()

    def emergency(self) -> None:
        """Category 1: the arm brakes and loses power; the program ends."""
        reason = "emergency stop"
        bits = safety.ROBOT_EMERGENCY | safety.EMERGENCY_STOPPED
        self.timeline.note(reason)
        self._enter(safety.MODE_ROBOT_EMERGENCY_STOP, bits, reason, self.decelerations.emergency_stop)
        self.safety.robot_mode = safety.ROBOT_POWER_OFF
        self.runner.stop(reason)

    def _enter(self, mode: int, bits: int, reason: str, deceleration: float) -> None:
        s = self.safety
        s.mode = mode
        s.bits = bits | safety.STOPPED_DUE_TO_SAFETY
        s.reason = reason
        s.stopped_at = self.timeline.t
        s.deceleration = deceleration

    def power_loss(self) -> None:
        """Category 0: the brakes engage; the program ends."""
        self.timeline.note("power off")
        self.safety.robot_mode = safety.ROBOT_POWER_OFF
        self.runner.stop("power off")
        self.safety.deceleration = self.decelerations.power_loss

    def unlock(self, at_once: bool = False) -> bool:
        """Ends a protective stop; returns False if it is too recent to be unlocked, unless `at_once`."""
        if self.safety.mode == safety.MODE_PROTECTIVE_STOP:
            recent = self.timeline.t - self.safety.stopped_at < self.settings.protective_stop_lock_s
            if recent and not at_once:
                return False
            self.safety.clear()
        return True

    def restart_safety(self) -> None:
        """Restarts the safety system: the arm loses power, and the cause of a stop is removed."""
        self.power_loss()
        self.safety.clear()
