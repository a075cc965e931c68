"""The program that ur_rtde uploads, `rtde_control`: its loop, its threads and its handshake.

The text is not interpreted: the script is rewritten here by hand, from scripts/rtde_control.script of the ur_rtde 1.6.5
source. Register offsets, an injected path and the names of the functions it calls are read from the text.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from simulator.physics import kinematics
from simulator.program import motions
from simulator.program.context import OffsetRegisters, ProgramContext
from simulator.program.threads import Program, ProgramError, Thread

NAME = "rtde_control"
HEADER = f"def {NAME}()"  # first words of the text
READY = 1
DONE = 2  # output integer register 0
NO_COMMAND = 0
STOP_SCRIPT = 255
REALTIME = frozenset({6, 9, 10, 11, 24, 25, 26, 27, 38, 58, 66, 67, 68, 69, 70, 71})  # source: the script's main loop
FINISHED = -1  # of an asynchronous operation

_OFFSET = "# {} register offset\n"
_WAYPOINT = re.compile(r"(movej|movel|movep)\((p?)\[([^\]]*)\],a=([^,]+),v=([^,]+),r=([^)]+)\)")

Process = Callable[["ControlProgram", int], Thread | None]


@dataclass(frozen=True)
class Waypoint:
    """One entry of an injected path: pose or joints, acceleration, speed, blend radius [m]."""

    joints_move: bool
    is_pose: bool
    target: Sequence[float]
    acceleration: float
    speed: float
    blend_m: float = 0.0


class ControlProgram(Program):
    """State of `rtde_control`; the commands themselves are in `commands`."""

    def __init__(self, context: ProgramContext, text: str, process: Process) -> None:
        """Reads offsets and path from the text; `process` carries out a command by its number."""
        super().__init__(NAME, self._main())
        self.arm = context.arm
        self.context = context
        self.text = text
        self.process = process
        self.registers = OffsetRegisters(context.registers, offset_in(text, "int"), offset_in(text, "float"))
        self.path = path_in(text)
        self.speed: list[float] = []  # speedj, speedl: speeds or twist, acceleration, time
        self.speeds_tool = True  # whether the last speed command was speedl
        self.servo: list[float] = []  # servoj, servol: joint positions, time, lookahead time, gain
        self.circle: list[float] = []  # servoc: pose, speed, acceleration, blend radius
        self.stops_with_tool = False  # the script's stop_type: stopj until the first asynchronous stop
        self.jog: list[float] = []
        self.writes = self.operation = 0
        self.contact_steps = 0
        self.internal_command = NO_COMMAND

    def has(self, function: str) -> bool:
        """Whether the text calls a script function: the client omits functions unknown to the version."""
        return function + "(" in self.text

    # -- the loop
    def _main(self) -> Thread:
        self.progress(FINISHED)
        self.registers.int_out(0, READY)
        executing = False
        while True:
            command = self._next_command()
            if command in REALTIME:
                yield from self.process(self, command) or ()
                self.registers.int_out(0, READY)
            elif command == NO_COMMAND:
                executing = False
                self.registers.int_out(0, READY)
            elif not executing:
                if command == STOP_SCRIPT:
                    return
                yield from self.process(self, command) or ()
                self.registers.int_out(0, DONE)
                executing = True
            yield

    def _next_command(self) -> int:
        """Returns the command in the register; without one, the internal command left by a thread."""
        command = self.registers.int_in(0)
        if command == NO_COMMAND:
            command = self.internal_command
            self.internal_command = NO_COMMAND
        return command

    # -- the asynchronous progress register
    def progress(self, value: int) -> None:
        """Writes output integer register 2: 0 starts an operation, FINISHED ends it, other values are its progress."""
        self.writes = (self.writes + 1) % 128
        if value == 0:
            self.operation = (self.operation + 1) % 128
        running = 32768 + min(value, 32767) if value >= 0 else 0
        self.registers.int_out(2, self.writes * 65536 + self.operation * 16777216 + running)

    def kill_move(self) -> None:
        """Ends an asynchronous move and publishes its end."""
        if self.kill("move"):
            self.progress(FINISHED)

    # -- moves
    def move_thread(self, motion: Thread) -> Thread:
        """Runs an asynchronous move."""
        self.progress(0)
        yield from motion
        self.progress(FINISHED)

    def follow_path(self) -> Thread:
        """Follows the injected path."""
        for number, point in enumerate(self.path):
            self.progress(number)
            yield from self.move_to(point)

    def move_to(self, point: Waypoint) -> Thread:
        """Returns the move to a waypoint: movej or movel."""
        c = self.context
        target = point.target
        pace = motions.Pace(point.speed, point.acceleration, blend_m=point.blend_m)
        if point.joints_move:
            goal = self.solve(target) if point.is_pose else target
            return motions.move_joints(c, goal, pace)
        pose = kinematics.transform(target) if point.is_pose else self.arm.chain.forward(target, c.tcp)
        return motions.move_tool(c, pose, pace)

    def solve(self, pose: Sequence[float], near: list[float] | None = None) -> list[float]:
        """Returns the joint angles (6,) [rad] of a pose, nearest to `near` (default: the commanded ones).

        Raises:
            ProgramError: there are none.
        """
        q = self.context.solve(pose, near)
        if q is None:
            raise ProgramError("get_inverse_kin: no solution")
        return q


def offset_in(text: str, kind: str) -> int:
    """Returns the register offset on the line after its marker, 0 or 24."""
    _, found, rest = text.partition(_OFFSET.format(kind))
    number = re.match(r"\s*(\d+)", rest) if found else None
    return 24 if number and number.group(1) == "24" else 0


def path_in(text: str) -> list[Waypoint]:
    """Returns the path injected into the text."""
    body = text.partition("# inject move path")[2].partition("\n    end")[0]
    return [_waypoint(match) for match in _WAYPOINT.findall(body)]


def _waypoint(match: tuple[str, ...]) -> Waypoint:
    move, pose, numbers, acceleration, speed, blend_m = match
    try:
        target = tuple(float(x) for x in numbers.split(","))
        point = Waypoint(move == "movej", bool(pose), target, float(acceleration), float(speed), float(blend_m))
    except ValueError as error:
        raise ProgramError(f"path: {error}") from error
    if len(target) != 6:
        raise ProgramError(f"path: {len(target)} numbers instead of six")
    return point
