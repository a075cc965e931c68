"""The stops that no program commands: protective, safeguard, emergency, and loss of power."""

from __future__ import annotations

from typing import TYPE_CHECKING

from executor.simulator import safety

if TYPE_CHECKING:
    from executor.simulator.controller import Controller

PAUSED, STOPPED, PLAYING = "paused", "stopped", "playing"  # what becomes of the program


class Stops:
    """Each sets the safety state and the deceleration, and pauses or ends the program."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.decelerations = controller.settings.decelerations

    def protective(self, why: str, program: str | None = None) -> None:
        """Category 2. The program is paused, or stopped, or left `playing` as some versions do."""
        c = self.controller
        if c.safety.stopped:
            return
        c.note(f"protective stop: {why}")
        c.safety.set(safety.MODE_PROTECTIVE_STOP, safety.PROTECTIVE_STOPPED, c.t, why)
        c.deceleration = self.decelerations.protective_stop
        self._program(program or c.settings.protective_stop_runtime)

    def safeguard(self) -> None:
        """Category 2, from the safeguard input; the program is paused."""
        c = self.controller
        if c.safety.stopped:
            return
        c.note("safeguard stop")
        c.safety.set(safety.MODE_SAFEGUARD_STOP, safety.SAFEGUARD_STOPPED, c.t, "safeguard stop")
        c.deceleration = self.decelerations.safeguard_stop
        self._program(PAUSED)

    def emergency(self) -> None:
        """Category 1: the arm brakes and loses power; the program ends."""
        c = self.controller
        c.note("emergency stop")
        bits = safety.ROBOT_EMERGENCY | safety.EMERGENCY_STOPPED
        c.safety.set(safety.MODE_ROBOT_EMERGENCY_STOP, bits, c.t, "emergency stop")
        c.safety.robot_mode = safety.ROBOT_POWER_OFF
        c.deceleration = self.decelerations.emergency_stop
        self._program(STOPPED)

    def power_loss(self) -> None:
        """Category 0: the brakes fall in; the program ends."""
        c = self.controller
        c.note("power off")
        c.safety.robot_mode = safety.ROBOT_POWER_OFF
        c.execution.stop("power off")
        c.deceleration = self.decelerations.power_loss

    def _program(self, fate: str) -> None:
        if fate == STOPPED:
            self.controller.execution.stop(self.controller.safety.reason)
        elif fate == PAUSED:
            self.controller.execution.pause()
