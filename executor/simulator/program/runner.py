"""Life of a program in the controller: uploaded, playing, paused, stopped; and the RTDE watchdog over it."""

from __future__ import annotations

from collections.abc import Callable

from executor.simulator.clock import StreamCounts, Timeline
from executor.simulator.physics import MotionConflict
from executor.simulator.program.context import Registers
from executor.simulator.program.control_program import HEADER
from executor.simulator.program.safety import SafetyState
from executor.simulator.program.threads import Program, ProgramError
from executor.simulator.settings import SimulatorSettings

STOPPED, PLAYING, PAUSED = 1, 2, 4  # runtime_state; source: RTDE guide

Load = Callable[[str], Program]  # text -> program; raises ProgramError for a text that does not compile


class ProgramRunner:
    """Runs at most one program.

    Attributes:
        safety: safety state, which decides whether programs may run.
        registers: registers between clients and the program.
        stream: counts of the client's commands.
        program: the loaded program, None without one.
        runtime: RTDE's runtime_state.
        due: (cycle, text) of an uploaded program that is about to start.
        watchdog: (register, longest silence [s]), None while it is off.
        remote_control: False in local control, where uploads are refused.
    """

    def __init__(
        self, load: Load, at_rest: Callable[[], bool], timeline: Timeline, settings: SimulatorSettings
    ) -> None:
        """`load` returns the program of a text, `at_rest` whether the arm is at rest; the timeline is shared."""
        self.load, self.at_rest, self.timeline, self.settings = load, at_rest, timeline, settings
        self.safety = SafetyState(settings.decelerations.program_end)
        self.registers, self.stream = Registers(), StreamCounts()
        self.program: Program | None = None
        self.runtime = STOPPED
        self.due: tuple[int, str] | None = None
        self.watchdog: tuple[int, float] | None = None
        self.remote_control = True

    @property
    def playing(self) -> bool:
        """Whether a program runs."""
        return self.runtime == PLAYING

    def upload(self, text: str) -> None:
        """Replaces the running program by a script, which starts a little later; or notes why it is refused."""
        refusal = self._refusal(text)
        if refusal:
            self.timeline.note(f"script refused: {refusal}")
            return
        self.stop("replaced by a new script")
        self.due = (self.timeline.cycles + self.timeline.cycles_in(self.settings.program_start_s), text)
        self.timeline.note(f"script received, {len(text)} characters")

    def _refusal(self, text: str) -> str | None:
        if not self.safety.may_move:
            return f"the robot is not in normal operation ({self.safety.reason or 'no power'})"
        if not self.remote_control:
            return "the robot is in local control"
        if not text.lstrip().startswith(HEADER):
            return "compile error: this controller knows the program of ur_rtde only"
        return None

    def stop(self, reason: str) -> None:
        """Ends the program, if there is one; the arm brakes."""
        if self.program is not None:
            self.timeline.note(f"program stopped: {reason}")
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
        self.stream.stream_ended()
        if not self.safety.stopped:
            self.safety.deceleration = self.settings.decelerations.program_end

    def resume(self) -> bool:
        """Resumes a paused program once the arm is at rest; returns whether it did."""
        if self.runtime != PAUSED or not self.safety.may_move or not self.at_rest():
            return False
        self.runtime = PLAYING
        return True

    def set_watchdog(self, register: int, frequency_hz: float) -> None:
        """Stops the program once `register` was not written for 1 / `frequency_hz` seconds; 0 or less: never."""
        self.watchdog = (register, 1.0 / frequency_hz) if frequency_hz > 0.0 else None
        self.registers.written_at[register] = self.timeline.cycles

    def cycle(self) -> None:
        """Starts a due program, applies the watchdog, and gives the program its turn.

        Raises:
            SuddenTargetChange: the program demands an impossible motion; a protective stop is to follow.
        """
        if self.due and self.timeline.cycles >= self.due[0]:
            self._start(self.due[1])
        if self.watchdog and self.playing:
            register, silence_s = self.watchdog
            if (self.timeline.cycles - self.registers.written_at[register]) * self.timeline.dt > silence_s:
                self.stop("the RTDE watchdog expired")
        if self.playing and self.program is not None and self.safety.may_move:
            self._run(self.program)

    def _start(self, text: str) -> None:
        self.due = None
        try:
            self.program = self.load(text)
        except ProgramError as error:
            self.timeline.note(f"script refused: {error}")
            return
        self.runtime = PLAYING
        self.timeline.note(f"program {self.program.name} plays")

    def _run(self, program: Program) -> None:
        try:
            if not program.step():
                self.stop("it has come to its end")
        except MotionConflict:
            self.stop("another thread is already controlling the robot")
        except (ProgramError, ArithmeticError, ValueError) as error:
            self.stop(f"runtime error: {error}")
