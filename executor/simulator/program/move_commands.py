"""The commands of `rtde_control` that move the arm or stop it: moves, streaming, stops."""

from __future__ import annotations

from collections.abc import Callable

from executor.simulator.physics import Transform, kinematics
from executor.simulator.program import motions
from executor.simulator.program.control_program import SPEEDJ, SPEEDL, ControlProgram, ServoTarget, SpeedTarget
from executor.simulator.program.threads import Thread

FORCE_STOP_DECELERATION = 10.0  # [m/s^2] source: the script, force_mode_stop


def _move_joints(program: ControlProgram) -> Thread | None:
    return _run_move(program, _to_joints(program, program.registers.doubles_in(0)))


def _move_joints_to_pose(program: ControlProgram) -> Thread | None:
    return _run_move(program, _to_joints(program, program.solve(program.registers.doubles_in(0))))


def _move_tool(program: ControlProgram) -> Thread | None:
    return _run_move(program, _to_pose(program, kinematics.transform(program.registers.doubles_in(0))))


def _move_tool_to_joints(program: ControlProgram) -> Thread | None:
    goal = program.arm.chain.forward(program.registers.doubles_in(0), program.context.tcp)
    return _run_move(program, _to_pose(program, goal))


def _move_path(program: ControlProgram) -> Thread | None:
    return _run_move(program, program.follow_path())


def _to_joints(program: ControlProgram, goal: list[float]) -> Thread:
    speed, acceleration = program.registers.doubles_in(6, 2)
    return motions.move_joints(program.arm, goal, speed, acceleration, program.context.speed_scaling)


def _to_pose(program: ControlProgram, goal: Transform) -> Thread:
    speed, acceleration = program.registers.doubles_in(6, 2)
    c = program.context
    return motions.move_tool(program.arm, goal, speed, acceleration, c.speed_scaling, c.tcp)


def _run_move(program: ControlProgram, motion: Thread) -> Thread | None:
    """Runs a move in its own thread if input integer register 1 requests it."""
    program.kill_move()
    if program.registers.int_in(1) == 1:
        program.start("move", program.move_thread(motion))
        return None
    return motion


# -- streaming
def _speed_joints(program: ControlProgram) -> None:
    _speed(program, SPEEDJ)


def _speed_tool(program: ControlProgram) -> None:
    _speed(program, SPEEDL)


def _speed(program: ControlProgram, kind: int) -> None:
    program.speed_target = SpeedTarget(kind, program.registers.doubles_in(0), *program.registers.doubles_in(6, 2))
    if not program.is_speeding:
        program.is_speeding = True
        program.start("speed", program.speed_thread())


def _servo_joints(program: ControlProgram) -> None:
    _servo(program, program.registers.doubles_in(0))


def _servo_tool(program: ControlProgram) -> None:
    _servo(program, program.solve(program.registers.doubles_in(0)))


def _servo(program: ControlProgram, target: list[float]) -> None:
    program.servo_target = ServoTarget(target, *program.registers.doubles_in(8, 3))
    if not program.is_servoing:
        program.is_servoing = True
        program.start("servo", program.servo_thread())


def _servo_circular(program: ControlProgram) -> None:
    program.circle = program.registers.doubles_in(0, 9)
    if not program.is_servoing:
        program.is_servoing = True
        program.start("servoc", _circular_thread(program))


def _circular_thread(program: ControlProgram) -> Thread:
    """servoc, as a straight move to each target; the blend radius is ignored."""
    c = program.context
    while True:
        pose, (speed, acceleration) = program.circle[:6], program.circle[6:8]
        yield from motions.move_tool(
            program.arm, kinematics.transform(pose), speed, acceleration, c.speed_scaling, c.tcp
        )


# -- stops
def _speed_stop(program: ControlProgram) -> Thread:
    program.is_speeding = False
    program.kill("speed")
    return _stop(program, program.registers.double_in(0), tool=program.speed_target.kind == SPEEDL)


def _servo_stop(program: ControlProgram) -> Thread:
    program.is_servoing = False
    program.kill("servo")
    program.kill("servoc")
    return _stop(program, program.registers.double_in(0), tool=True)


def _stop_move(program: ControlProgram) -> Thread | None:
    """stopL and stopJ: the script goes by its stop type, not by the command."""
    if program.kill("stop"):
        program.progress(-1)
    else:
        program.kill_move()
    deceleration = program.registers.double_in(0)
    if program.registers.int_in(1) != 1:
        return _stop(program, deceleration, tool=program.stops_with_tool)
    program.stops_with_tool = True
    program.start("stop", program.move_thread(_stop(program, deceleration, tool=True)))
    return None


def _stop(program: ControlProgram, deceleration: float, tool: bool) -> Thread:
    if tool:
        return motions.stop_tool(program.arm, deceleration, program.context.tcp)
    return motions.stop_joints(program.arm, deceleration)


def _force_mode_stop(program: ControlProgram) -> Thread:
    return _stop(program, FORCE_STOP_DECELERATION, tool=True)


MOVES: dict[int, Callable[[ControlProgram], Thread | None]] = {
    1: _move_joints, 2: _move_joints_to_pose, 3: _move_tool, 4: _move_tool_to_joints, 45: _move_path,
    9: _speed_joints, 10: _speed_tool, 11: _servo_joints, 24: _servo_tool, 12: _servo_circular,
    15: _speed_stop, 16: _servo_stop, 33: _stop_move, 34: _stop_move, 7: _force_mode_stop,
}  # fmt: skip
