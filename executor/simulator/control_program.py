"""The program that ur_rtde uploads, `rtde_control`: its loop, its threads and its handshake, as the script has them.

The text itself is not interpreted: what it says is written here by hand, from scripts/rtde_control.script of the
ur_rtde 1.6.5 source. Its register offsets and an injected path are read from the text.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from executor.simulator import motions
from executor.simulator.kinematics import transform
from executor.simulator.program import Program, ProgramError, Thread

if TYPE_CHECKING:
    from executor.simulator.controller import Controller

NAME = "rtde_control"
READY, DONE = 1, 2  # output integer register 0
NO_COMMAND, STOP_SCRIPT = 0, 255
REALTIME = frozenset({6, 9, 10, 11, 24, 25, 26, 27, 38, 58, 66, 67, 68, 69, 70, 71})  # source: the script's main loop
SPEEDL, SPEEDJ = 0, 1
FINISHED = -1  # of an asynchronous operation

_OFFSET = "# {} register offset\n"
_WAYPOINT = re.compile(r"(movej|movel|movep)\((p?)\[([^\]]*)\],a=([^,]+),v=([^,]+),r=([^)]+)\)")


Process = Callable[["ControlProgram", int], Thread | None]


@dataclass(frozen=True)
class Waypoint:
    """One entry of an injected path: pose or joints, acceleration, speed. The blend radius is not followed."""

    joints_move: bool
    is_pose: bool
    target: tuple[float, ...]
    acceleration: float
    speed: float


@dataclass
class Speeding:
    """What the speed thread reads: SPEEDL or SPEEDJ, target, acceleration and time."""

    kind: int = SPEEDL
    target: list[float] = field(default_factory=lambda: [0.0] * 6)
    acceleration: float = 0.5
    time_s: float = 0.5


@dataclass
class Servoing:
    """What the servo thread reads."""

    target: list[float] = field(default_factory=lambda: [0.0] * 6)
    time_s: float = 0.002
    lookahead_s: float = 0.1
    gain: float = 300.0


class ControlProgram(Program):
    """State of `rtde_control`; the commands themselves are in `commands`."""

    def __init__(self, controller: Controller, text: str, process: Process) -> None:
        """`process` carries out a command by its number: `commands.process`."""
        super().__init__(NAME, self._main())
        self.process = process
        self.controller = controller
        self.arm = controller.arm
        self.text = text
        self.offset_int, self.offset_double = offset_in(text, "int"), offset_in(text, "float")
        self.path = path_in(text)
        self.speeding, self.servoing = Speeding(), Servoing()
        self.is_speeding = self.is_servoing = False
        self.stops_with_tool = False  # the script's stop_type: stopj until the first asynchronous stop
        self.jog: list[float] = []
        self.writes = self.operation = 0
        self.circle: list[float] = []  # servoc: pose, speed, acceleration, blend radius
        self.contact_steps = 0
        self.internal_command = NO_COMMAND

    # -- registers, through the offsets
    def int_in(self, index: int) -> int:
        """Returns an input integer register."""
        return self.controller.registers.int_in[index + self.offset_int]

    def double_in(self, index: int) -> float:
        """Returns an input double register."""
        return self.controller.registers.double_in[index + self.offset_double]

    def doubles_in(self, index: int, count: int = 6) -> list[float]:
        """Returns `count` input double registers."""
        first = index + self.offset_double
        return self.controller.registers.double_in[first : first + count]

    def int_out(self, index: int, value: int) -> None:
        """Writes an output integer register."""
        self.controller.registers.write_int(index + self.offset_int, value)

    def doubles_out(self, values: list[float], index: int = 0) -> None:
        """Writes output double registers from `index` on."""
        for i, value in enumerate(values):
            self.controller.registers.write_double(index + i + self.offset_double, value)

    def has(self, function: str) -> bool:
        """Whether the text calls a script function: the client leaves out what the version does not know."""
        return function + "(" in self.text

    # -- the loop
    def _main(self) -> Thread:
        self.progress(FINISHED)
        self.int_out(0, READY)
        executing = False
        while True:
            command = self._next_command()
            if command in REALTIME:
                motion = self.process(self, command)
                if motion is not None:
                    yield from motion
                self.int_out(0, READY)
            elif command == NO_COMMAND:
                executing = False
                self.int_out(0, READY)
            elif not executing:
                if command == STOP_SCRIPT:
                    return
                motion = self.process(self, command)
                if motion is not None:
                    yield from motion
                self.int_out(0, DONE)
                executing = True
            yield

    def _next_command(self) -> int:
        """Returns the command in the register; while there is none, what a thread has left to do."""
        command = self.int_in(0)
        if command == NO_COMMAND:
            command, self.internal_command = self.internal_command, NO_COMMAND
        return command

    # -- the asynchronous progress register
    def progress(self, value: int) -> None:
        """Writes output integer register 2: 0 starts an operation, FINISHED ends it, else how far it is."""
        self.writes = (self.writes + 1) % 128
        if value == 0:
            self.operation = (self.operation + 1) % 128
        running = 32768 + min(value, 32767) if value >= 0 else 0
        self.int_out(2, self.writes * 65536 + self.operation * 16777216 + running)

    def kill_move(self) -> None:
        """Ends an asynchronous move, in whose place its end is then told."""
        if self.kill("move"):
            self.progress(FINISHED)

    # -- threads
    def speed_thread(self) -> Thread:
        """Repeats the last target for ever: speedj or speedl, one call after another."""
        controller = self.controller
        while True:
            s = self.speeding
            if s.kind == SPEEDJ:
                yield from motions.speed_joints(self.arm, s.target, s.acceleration, s.time_s, controller.scaling)
            else:
                yield from motions.speed_tool(
                    self.arm, s.target, s.acceleration, s.time_s, controller.scaling, controller.tcp
                )

    def servo_thread(self) -> Thread:
        """Repeats the last servo target for ever."""
        while True:
            s = self.servoing
            yield from motions.servo_joints(
                self.arm, s.target, s.time_s, s.lookahead_s, s.gain, self.controller.limits.qd_max
            )

    def move_thread(self, motion: Iterator[None]) -> Thread:
        """An asynchronous move."""
        self.progress(0)
        yield from motion
        self.progress(FINISHED)

    def follow_path(self) -> Thread:
        """The injected path, waypoint by waypoint, resting at each."""
        for number, point in enumerate(self.path):
            self.progress(number)
            yield from self._to(point)

    def _to(self, point: Waypoint) -> Thread:
        c = self.controller
        if point.joints_move:
            goal = self.solve(list(point.target)) if point.is_pose else list(point.target)
            yield from motions.move_joints(self.arm, goal, point.speed, point.acceleration, c.scaling)
        else:
            goal = transform(point.target) if point.is_pose else self.arm.chain.forward(point.target, c.tcp)
            yield from motions.move_tool(self.arm, goal, point.speed, point.acceleration, c.scaling, c.tcp)

    def solve(self, pose: list[float], near: list[float] | None = None) -> list[float]:
        """Returns the joint angles of a pose, nearest to `near` (default: where the arm is).

        Raises:
            ProgramError: there are none.
        """
        q = self.controller.solve(pose, near)
        if q is None:
            raise ProgramError("get_inverse_kin: no solution")
        return q


def offset_in(text: str, kind: str) -> int:
    """Returns the register offset that the client wrote on the line after its marker, 0 or 24."""
    _, found, rest = text.partition(_OFFSET.format(kind))
    number = re.match(r"\s*(\d+)", rest) if found else None
    return 24 if number and number.group(1) == "24" else 0


def path_in(text: str) -> list[Waypoint]:
    """Returns the path injected in the text."""
    body = text.partition("# inject move path")[2].partition("\n    end")[0]
    return [_waypoint(match) for match in _WAYPOINT.findall(body)]


def _waypoint(match: tuple[str, ...]) -> Waypoint:
    move, pose, numbers, acceleration, speed, _ = match
    try:
        target = tuple(float(x) for x in numbers.split(","))
        point = Waypoint(move == "movej", bool(pose), target, float(acceleration), float(speed))
    except ValueError as error:
        raise ProgramError(f"path: {error}") from error
    if len(target) != 6:
        raise ProgramError(f"path: {len(target)} numbers where six belong")
    return point
