"""Life of a program in the controller: uploaded, playing, paused, stopped; and the RTDE watchdog over it."""

from __future__ import annotations

import re
from collections.abc import Callable

from simulator.clock import StreamCounts, Timeline
from simulator.physics import MotionConflict
from simulator.program import messages
from simulator.program.context import Registers
from simulator.program.safety import SafetyState
from simulator.program.threads import Program, ProgramError
from simulator.settings import SimulatorSettings

STOPPED = 1
PLAYING = 2
PAUSED = 4  # runtime_state; source: RTDE guide

SECONDARY = re.compile(r"\s*sec\s")  # beginning of a script that runs beside the program; source: URScript manual
Load = Callable[[str], Program]  # text -> program; raises ProgramError for a text that does not compile


class ProgramRunner:
    """Runs at most one program.

    Attributes:
        safety: safety state, which decides whether programs may run.
        registers: registers between clients and the program.
        stream: counts of the client's commands.
        program: the loaded program, None without one.
        runtime: RTDE's runtime_state.
        secondary: programs that run beside it.
        board: messages to the clients.
        due: (cycle, program) of an uploaded program that is about to start.
        watchdog: (register, longest silence [s]), None while it is off.
        remote_control: False in local control, where uploads are refused.
    """

    def __init__(
        self,
        load: Load,
        at_rest: Callable[[], bool],
        timeline: Timeline,
        settings: SimulatorSettings,
        coast: Callable[[], None] = lambda: None,
    ) -> None:
        """Begins without a program.

        Args:
            load: returns the program of a text.
            at_rest: whether the arm is at rest.
            timeline: of the controller.
            settings: of the simulator.
            coast: goes on with a motion that the program has left to itself, after its turn.
        """
        self.load = load
        self.at_rest = at_rest
        self.coast = coast
        self.timeline = timeline
        self.settings = settings
        self.safety = SafetyState(settings.decelerations.program_end)
        self.registers, self.stream = Registers(), StreamCounts()
        self.board = messages.MessageBoard()
        self.program: Program | None = None
        self.secondary: list[Program] = []
        self.runtime = STOPPED
        self.due: tuple[int, Program] | None = None
        self.watchdog: tuple[int, float] | None = None
        self.remote_control = True

    @property
    def playing(self) -> bool:
        """Whether a program runs."""
        return self.runtime == PLAYING

    @property
    def in_remote_control(self) -> bool:
        """Whether remote control is switched on at all, and not local control."""
        return self.remote_control and self.settings.remote_control_enabled

    def upload(self, text: str) -> None:
        """Takes a script: it ends what runs, and starts a little later in its place, if it compiles.

        A secondary program (`sec`) runs beside what runs instead. In a state in which no program may run, a script is
        refused, and nothing changes.
        """
        refusal = self._refusal()
        if refusal is not None:
            self.timeline.note(f"script refused: {refusal.text}")
            self.board.post(refusal)
            return
        self.timeline.note(f"script received, {len(text)} characters")
        if SECONDARY.match(text):
            self._start_secondary(text)
            return
        self.stop("replaced by a new script")
        program = self._loaded(text)
        if program is not None:
            self.due = (self.timeline.cycles + self.timeline.cycles_in(self.settings.program_start_s), program)

    def _refusal(self) -> messages.ErrorCode | None:
        if not self.remote_control:
            code = messages.READ_ONLY_CODE
            reason = "the robot is in local control"
        elif not self.safety.may_move:
            code = 0
            reason = f"the robot is not in normal operation ({self.safety.reason or 'no power'})"
        else:
            return None
        return messages.ErrorCode(code, 0, messages.VIOLATION, reason)

    def stop(self, reason: str) -> None:
        """Ends the program, if there is one; the arm brakes."""
        ended = self.program or (self.due[1] if self.due else None)
        self.program = self.watchdog = self.due = None
        if ended is not None:
            ended.close()
            self.timeline.note(f"program stopped: {reason}")
            self.board.post(messages.KeyMessage(messages.STOPPED_TITLE, ended.name))
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
        if self.secondary and self.safety.may_move:
            self._run_secondary()

    def _start(self, program: Program) -> None:
        self.due = None
        self.program = program
        self.runtime = PLAYING
        self.timeline.note(f"program {program.name} plays")
        self.board.post(messages.KeyMessage(messages.STARTED, program.name))

    def _start_secondary(self, text: str) -> None:
        program = self._loaded(text)
        if program is not None:
            self.secondary.append(program)

    def _loaded(self, text: str) -> Program | None:
        """Returns the program of a text; None, and a message, if it does not compile."""
        try:
            return self.load(text)
        except ProgramError as error:
            self.timeline.note(f"script refused: {error}")
            self._post_exception(error)
            return None

    def _post_exception(self, error: ProgramError) -> None:
        self.board.post(messages.RuntimeException(max(error.line, 1), max(error.column, 1), str(error)))

    def _run(self, program: Program) -> None:
        try:
            if program.step():
                self.coast()
            else:
                self.stop("it has come to its end")
        except MotionConflict:
            conflict = "another thread is already controlling the robot"
            self._post_exception(ProgramError(conflict))
            self.stop(conflict)
        except (ProgramError, ArithmeticError, ValueError) as error:
            self._post_exception(ProgramError(str(error), *_place_of(error)))
            self.stop(f"runtime error: {error}")

    def _run_secondary(self) -> None:
        for program in list(self.secondary):
            try:
                ended = not program.step()
            except (MotionConflict, ProgramError, ArithmeticError, ValueError) as error:
                self.timeline.note(f"secondary program {program.name}: {error}")
                self._post_exception(ProgramError(f"SECONDARY_PROGRAM_EXCEPTION_XXX{error}", *_place_of(error)))
                ended = True
            if ended:
                program.close()
                self.secondary.remove(program)


def _place_of(error: Exception) -> tuple[int, int]:
    return (error.line, error.column) if isinstance(error, ProgramError) else (0, 0)
