"""The commands of `rtde_control` that move the arm or stop it: moves, streaming, stops."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from simulator.physics import kinematics
from simulator.program import motions
from simulator.program.control_program import ControlProgram, Waypoint
from simulator.program.threads import Thread

FORCE_STOP_DECELERATION = 10.0  # [m/s^2] source: the script, force_mode_stop


def _move(program: ControlProgram, joints_move: bool, is_pose: bool) -> Thread | None:
    speed, acceleration = program.registers.doubles_in(6, 2)
    point = Waypoint(joints_move, is_pose, program.registers.doubles_in(0), acceleration, speed)
    return _run_move(program, program.move_to(point))


def _run_move(program: ControlProgram, motion: Thread) -> Thread | None:
    """Runs a move in its own thread if input integer register 1 requests it."""
    program.kill_move()
    if program.registers.int_in(1) == 1:
        program.start("move", program.move_thread(motion))
        return None
    return motion


# -- streaming
def _speed(program: ControlProgram, with_tool: bool) -> None:
    program.speed = program.registers.doubles_in(0, 8)
    program.speeds_tool = with_tool
    program.start_once("speed", _speed_thread(program))


def _speed_thread(program: ControlProgram) -> Thread:
    """Repeats the last target for ever: speedj or speedl, one call after another."""
    c = program.context
    while True:
        target = program.speed[:6]
        (acceleration, time_s) = program.speed[6:]
        if program.speeds_tool:
            yield from motions.speed_tool(c, target, acceleration, time_s)
        else:
            yield from motions.speed_joints(c, target, acceleration, time_s)


def _servo(program: ControlProgram, to_pose: bool) -> None:
    target = program.registers.doubles_in(0)
    program.servo = [*(program.solve(target) if to_pose else target), *program.registers.doubles_in(8, 3)]
    program.start_once("servo", _servo_thread(program), "servoc")


def _servo_thread(program: ControlProgram) -> Thread:
    """Repeats the last servo target for ever."""
    while True:
        target = program.servo[:6]
        (time_s, lookahead_s, gain) = program.servo[6:]
        yield from motions.servo_joints(program.context, target, time_s, lookahead_s, gain)


def _servo_circular(program: ControlProgram) -> None:
    program.circle = program.registers.doubles_in(0, 9)
    program.start_once("servoc", _circular_thread(program), "servo")


def _circular_thread(program: ControlProgram) -> Thread:
    """servoc, as a straight move to each target; the blend radius is ignored."""
    while True:
        pose = program.circle[:6]
        (speed, acceleration) = program.circle[6:8]
        goal = kinematics.transform(pose)
        yield from motions.move_tool(program.context, goal, motions.Pace(speed, acceleration))


# -- stops
def _speed_stop(program: ControlProgram) -> Thread:
    program.kill("speed")
    return _stop(program, program.registers.double_in(0), tool=program.speeds_tool)


def _servo_stop(program: ControlProgram) -> Thread:
    program.kill("servo")
    program.kill("servoc")
    return _stop(program, program.registers.double_in(0), tool=True)


def _stop_move(program: ControlProgram) -> Thread | None:
    """Stops whichever of stopL and stopJ was sent: by stopj, but by stopl from the first asynchronous stop on."""
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
        return motions.stop_tool(program.context, deceleration)
    return motions.stop_joints(program.context, deceleration)


MOVES: dict[int, Callable[[ControlProgram], Thread | None]] = {
    1: partial(_move, joints_move=True, is_pose=False), 2: partial(_move, joints_move=True, is_pose=True),
    3: partial(_move, joints_move=False, is_pose=True), 4: partial(_move, joints_move=False, is_pose=False),
    45: lambda program: _run_move(program, program.follow_path()),
    9: partial(_speed, with_tool=False), 10: partial(_speed, with_tool=True),
    11: partial(_servo, to_pose=False), 24: partial(_servo, to_pose=True), 12: _servo_circular,
    15: _speed_stop, 16: _servo_stop, 33: _stop_move, 34: _stop_move,
    7: partial(_stop, deceleration=FORCE_STOP_DECELERATION, tool=True),
}  # fmt: skip
