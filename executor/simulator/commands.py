"""The commands of `rtde_control`: what the script does with each number of input integer register 0.

One function a command; a generator where it takes time. The table is at the end of the file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from executor.simulator import motions, queries
from executor.simulator.control_program import DONE, SPEEDJ, SPEEDL, ControlProgram, Servoing, Speeding
from executor.simulator.kinematics import transform
from executor.simulator.program import ProgramError, Thread

Command = Callable[[ControlProgram], Iterator[None] | None]
JOG_STOP_DECELERATION = 1.2  # [m/s^2] source: the script, stop_jog
FORCE_STOP_DECELERATION = 10.0  # [m/s^2] source: the script, force_mode_stop
JOG_TIME_S = 0.01  # source: the script, jog_speed_thread


def process(program: ControlProgram, number: int) -> Thread:
    """Carries out one command and signals that it is done; an unknown number is done at once, as in the script.

    Raises:
        ProgramError: an argument is not finite.
    """
    if not all(map(math.isfinite, program.doubles_in(0, 18))):
        raise ProgramError(f"command {number}: an argument is not finite")
    command = COMMANDS.get(number)
    motion = command(program) if command else None
    if motion is not None:
        yield from motion
    program.int_out(0, DONE)


# -- moves
def _move_joints(program: ControlProgram) -> Iterator[None] | None:
    return _run_move(program, _to_joints(program, program.doubles_in(0)))


def _move_joints_to_pose(program: ControlProgram) -> Iterator[None] | None:
    return _run_move(program, _to_joints(program, program.solve(program.doubles_in(0))))


def _move_tool(program: ControlProgram) -> Iterator[None] | None:
    return _run_move(program, _to_pose(program, transform(program.doubles_in(0))))


def _move_tool_to_joints(program: ControlProgram) -> Iterator[None] | None:
    goal = program.arm.chain.forward(program.doubles_in(0), program.controller.tcp)
    return _run_move(program, _to_pose(program, goal))


def _move_path(program: ControlProgram) -> Iterator[None] | None:
    return _run_move(program, program.follow_path())


def _to_joints(program: ControlProgram, goal: list[float]) -> Iterator[None]:
    speed, acceleration = program.doubles_in(6, 2)
    return motions.move_joints(program.arm, goal, speed, acceleration, program.controller.scaling)


def _to_pose(program: ControlProgram, goal: motions.Transform) -> Iterator[None]:
    speed, acceleration = program.doubles_in(6, 2)
    c = program.controller
    return motions.move_tool(program.arm, goal, speed, acceleration, c.scaling, c.tcp)


def _run_move(program: ControlProgram, motion: Iterator[None]) -> Iterator[None] | None:
    """Runs a move in its own thread where input integer register 1 asks for it."""
    program.kill_move()
    if program.int_in(1) == 1:
        program.start("move", program.move_thread(motion))
        return None
    return motion


# -- streaming
def _speed_joints(program: ControlProgram) -> None:
    _speed(program, SPEEDJ)


def _speed_tool(program: ControlProgram) -> None:
    _speed(program, SPEEDL)


def _speed(program: ControlProgram, kind: int) -> None:
    program.speeding = Speeding(kind, program.doubles_in(0), program.double_in(6), program.double_in(7))
    if not program.is_speeding:
        program.is_speeding = True
        program.start("speed", program.speed_thread())


def _servo_joints(program: ControlProgram) -> None:
    _servo(program, program.doubles_in(0))


def _servo_tool(program: ControlProgram) -> None:
    _servo(program, program.solve(program.doubles_in(0)))


def _servo_circular(program: ControlProgram) -> None:
    """servoc, followed as servoj to the inverse kinematics of the pose."""
    _servo(program, program.solve(program.doubles_in(0)), streamed=False)


def _servo(program: ControlProgram, target: list[float], streamed: bool = True) -> None:
    program.servoing = Servoing(target, *program.doubles_in(8, 3)) if streamed else Servoing(target)
    if not program.is_servoing:
        program.is_servoing = True
        program.start("servo", program.servo_thread())


# -- stops
def _speed_stop(program: ControlProgram) -> Iterator[None]:
    program.is_speeding = False
    program.kill("speed")
    return _stop(program, program.double_in(0), tool=program.speeding.kind == SPEEDL)


def _servo_stop(program: ControlProgram) -> Iterator[None]:
    program.is_servoing = False
    program.kill("servo")
    return _stop(program, program.double_in(0), tool=True)


def _stop_move(program: ControlProgram) -> Iterator[None] | None:
    """stopL and stopJ: the script looks at its stop type, not at the command."""
    if program.kill("stop"):
        program.progress(-1)
    else:
        program.kill_move()
    deceleration = program.double_in(0)
    if program.int_in(1) != 1:
        return _stop(program, deceleration, tool=program.stops_with_tool)
    program.stops_with_tool = True
    program.start("stop", program.move_thread(_stop(program, deceleration, tool=True)))
    return None


def _stop(program: ControlProgram, deceleration: float, tool: bool) -> Iterator[None]:
    if tool:
        return motions.stop_tool(program.arm, deceleration, program.controller.tcp)
    return motions.stop_joints(program.arm, deceleration)


def _force_mode_stop(program: ControlProgram) -> Iterator[None]:
    return _stop(program, FORCE_STOP_DECELERATION, tool=True)


# -- jogging
def _start_jog(program: ControlProgram) -> None:
    program.jog = program.doubles_in(0, 14)
    if "jog" not in program.threads:
        program.start("jog", _jog_thread(program))


def _jog_thread(program: ControlProgram) -> Thread:
    c = program.controller
    feature = round(program.jog[6])
    frame = {1: program.arm.chain.forward(program.arm.q, c.tcp), 2: transform(program.jog[8:14])}.get(feature)
    while True:
        twist = _turned(frame, program.jog[:6]) if frame else program.jog[:6]
        yield from motions.speed_tool(program.arm, twist, program.jog[7], JOG_TIME_S, c.scaling, c.tcp)


def _turned(frame: motions.Transform, twist: list[float]) -> list[float]:
    rows = (frame[0:3], frame[4:7], frame[8:11])
    return [sum(r * x for r, x in zip(row, part, strict=True)) for part in (twist[:3], twist[3:]) for row in rows]


def _stop_jog(program: ControlProgram) -> Iterator[None]:
    program.kill("jog")
    return _stop(program, JOG_STOP_DECELERATION, tool=True)


# -- set-up
def _set_payload(program: ControlProgram) -> None:
    program.controller.payload_kg = program.double_in(0)
    if any(program.doubles_in(1, 3)):
        program.controller.payload_cog_m = program.doubles_in(1, 3)


def _set_target_payload(program: ControlProgram) -> None:
    _set_payload(program)
    program.controller.payload_inertia = program.doubles_in(4, 6)


def _set_tcp(program: ControlProgram) -> None:
    program.controller.tcp = transform(program.doubles_in(0))


def _set_gravity(program: ControlProgram) -> None:
    program.controller.gravity_m_s2 = program.doubles_in(0, 3)


def _set_watchdog(program: ControlProgram) -> None:
    program.controller.execution.set_watchdog(24 if program.offset_int == 24 else 0, program.double_in(0))


def _protective_stop(program: ControlProgram) -> None:
    if program.has("protective_stop"):
        program.controller.stops.protective("triggered by the program")


def _nothing(program: ControlProgram) -> None:
    """Accepted without effect: this arm feels no force and cannot be pushed."""


COMMANDS: dict[int, Command] = {
    1: _move_joints, 2: _move_joints_to_pose, 3: _move_tool, 4: _move_tool_to_joints, 45: _move_path,
    9: _speed_joints, 10: _speed_tool, 11: _servo_joints, 24: _servo_tool, 12: _servo_circular,
    15: _speed_stop, 16: _servo_stop, 33: _stop_move, 34: _stop_move, 41: _start_jog, 42: _stop_jog,
    17: _set_payload, 65: _set_target_payload, 29: _set_tcp, 59: _set_gravity, 35: _set_watchdog, 31: _protective_stop,
    6: _nothing, 7: _force_mode_stop, 8: _nothing, 18: _nothing, 19: _nothing, 20: _nothing, 21: _nothing,
    52: _nothing, 53: _nothing, 56: _nothing, 57: _nothing, 62: _nothing, 66: _nothing,
    **queries.QUERIES,
}  # fmt: skip
