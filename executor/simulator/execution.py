"""The life of a program in the controller: uploaded, playing, paused, stopped; and the RTDE watchdog over it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from executor.simulator import commands
from executor.simulator.arm import TwoMotions
from executor.simulator.control_program import NAME, ControlProgram
from executor.simulator.motions import MotionError, SuddenChange
from executor.simulator.program import Program, ProgramError

if TYPE_CHECKING:
    from executor.simulator.controller import Controller

STOPPED, PLAYING, PAUSED = 1, 2, 4  # runtime_state; source: RTDE guide


class Execution:
    """At most one program; `runtime` is what RTDE calls runtime_state."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.program: Program | None = None
        self.runtime = STOPPED
        self.due: tuple[int, str] | None = None  # (cycle, text) of an uploaded program that starts soon
        self.watchdog: tuple[int, float] | None = None  # (register, longest silence [s])
        self.remote_control = True

    @property
    def playing(self) -> bool:
        """Whether a program runs."""
        return self.runtime == PLAYING

    def upload(self, text: str) -> None:
        """Takes a script: it replaces what runs, and starts a little later."""
        c = self.controller
        refusal = self._refusal(text)
        if refusal:
            c.note(f"script refused: {refusal}")
            return
        self.stop("replaced by a new script")
        self.due = (c.cycles + round(c.settings.program_start_s / c.dt), text)
        c.note(f"script received, {len(text)} characters")

    def _refusal(self, text: str) -> str | None:
        safety = self.controller.safety
        if not safety.may_move:
            return f"the robot is not in normal operation ({safety.reason or 'no power'})"
        if not self.remote_control:
            return "the robot is in local control"
        if not text.lstrip().startswith(f"def {NAME}()"):
            return "compile error: this controller knows the program of ur_rtde only"
        return None

    def stop(self, why: str) -> None:
        """Ends the program, if there is one; the arm brakes."""
        if self.program is not None:
            self.controller.note(f"program stopped: {why}")
        self.program = self.watchdog = self.due = None
        self._halt(STOPPED)

    def pause(self) -> bool:
        """Pauses the program; returns whether one was playing."""
        if not self.playing:
            return False
        self._halt(PAUSED)
        return True

    def _halt(self, runtime: int) -> None:
        self.runtime = runtime
        self.controller.commands.ended()
        if not self.controller.safety.stopped:
            self.controller.deceleration = self.controller.settings.decelerations.program_end

    def resume(self) -> bool:
        """Lets a paused program go on once the arm stands; returns whether it does."""
        if self.runtime != PAUSED or not self.controller.safety.may_move or not self.controller.arm.at_rest:
            return False
        self.runtime = PLAYING
        return True

    def set_watchdog(self, register: int, frequency_hz: float) -> None:
        """Stops the program once `register` was not written for 1 / `frequency_hz` seconds; zero or less: never."""
        self.watchdog = (register, 1.0 / frequency_hz) if frequency_hz > 0.0 else None
        self.controller.registers.written_at[register] = self.controller.cycles

    def cycle(self) -> None:
        """Starts what is due, stops what was silent for too long, and gives the program its turn."""
        if self.due and self.controller.cycles >= self.due[0]:
            self._start()
        if self.watchdog and self.playing:
            self._watch(*self.watchdog)
        if self.playing and self.program is not None and self.controller.safety.may_move:
            self._run(self.program)

    def _start(self) -> None:
        _, text = self.due or (0, "")
        self.due = None
        try:
            self.program = ControlProgram(self.controller, text, commands.process)
        except ProgramError as error:
            self.controller.note(f"script refused: {error}")
            return
        self.runtime = PLAYING
        self.controller.note(f"program {self.program.name} plays")

    def _watch(self, register: int, silence_s: float) -> None:
        c = self.controller
        if (c.cycles - c.registers.written_at[register]) * c.dt > silence_s:
            self.stop("the RTDE watchdog expired")

    def _run(self, program: Program) -> None:
        try:
            if not program.step():
                self.stop("it has come to its end")
        except TwoMotions:
            self.stop("another thread is already controlling the robot")
        except SuddenChange as change:
            self.controller.stops.protective(str(change))
        except (ProgramError, MotionError, ArithmeticError, ValueError) as error:
            self.stop(f"runtime error: {error}")
