"""The commands of `rtde_control` for contact detection and jogging."""

from __future__ import annotations

from collections.abc import Callable

from simulator.physics import Transform, kinematics
from simulator.program import motions
from simulator.program.control_program import ControlProgram
from simulator.program.threads import Thread

CONTACT_DECELERATION = 3.0  # [m/s^2] source: the script, move_until_contact
MOVEL_SPEED = 0.25
MOVEL_ACCELERATION = 1.2  # [m/s, m/s^2] source: URScript manual, movel's defaults
CONTACT = 254  # internal command; source: the script
JOG_STOP_DECELERATION = 1.2  # [m/s^2] source: the script, stop_jog
JOG_TIME_S = 0.01  # source: the script, jog_speed_thread


def _move_until_contact(program: ControlProgram) -> Thread:
    """Moves at a twist until the tool touches something, then stops and returns to the first contact."""
    c = program.context
    twist = program.registers.doubles_in(0)
    acceleration = program.registers.double_in(12)
    while not c.in_contact():
        yield from motions.speed_tool(c, twist, acceleration, program.arm.dt)
    yield from _return_to_contact(program)


def _return_to_contact(program: ControlProgram) -> Thread:
    c = program.context
    goal = program.arm.chain.forward(program.arm.true_q, c.tcp)
    yield from motions.stop_tool(c, CONTACT_DECELERATION)
    yield from motions.move_tool(c, goal, motions.Pace(MOVEL_SPEED, MOVEL_ACCELERATION))


def _start_contact_detection(program: ControlProgram) -> None:
    program.contact_steps = 0
    program.kill("contact")
    if program.has("tool_contact"):
        program.start("contact", _contact_thread(program))


def _contact_thread(program: ControlProgram) -> Thread:
    """Waits until the tool is free, then for a contact, which the main thread handles."""
    c = program.context
    while c.in_contact():
        yield
    while not c.in_contact():
        yield
    program.contact_steps = 1
    program.internal_command = CONTACT


def _contact(program: ControlProgram) -> Thread:
    program.kill_move()
    return _return_to_contact(program)


def _stop_contact_detection(program: ControlProgram) -> None:
    program.kill("contact")
    program.registers.int_out(1, program.contact_steps)


def _start_jog(program: ControlProgram) -> None:
    program.jog = program.registers.doubles_in(0, 14)
    program.start_once("jog", _jog_thread(program))


def _jog_thread(program: ControlProgram) -> Thread:
    c = program.context
    feature = round(program.jog[6])
    frame = {1: program.arm.chain.forward(program.arm.q, c.tcp), 2: kinematics.transform(program.jog[8:14])}.get(
        feature
    )
    while True:
        twist = _turned(frame, program.jog[:6]) if frame else program.jog[:6]
        yield from motions.speed_tool(c, twist, program.jog[7], JOG_TIME_S)


def _turned(frame: Transform, twist: list[float]) -> list[float]:
    rows = (frame[0:3], frame[4:7], frame[8:11])
    return [sum(r * x for r, x in zip(row, part, strict=True)) for part in (twist[:3], twist[3:]) for row in rows]


def _stop_jog(program: ControlProgram) -> Thread:
    program.kill("jog")
    return motions.stop_tool(program.context, JOG_STOP_DECELERATION)


CONTACTS: dict[int, Callable[[ControlProgram], Thread | None]] = {
    51: _move_until_contact, 62: _start_contact_detection, 63: _stop_contact_detection, CONTACT: _contact,
    41: _start_jog, 42: _stop_jog,
}  # fmt: skip
