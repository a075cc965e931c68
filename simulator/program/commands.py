"""The commands of `rtde_control`: their numbers in input integer register 0, and those that set something."""

from __future__ import annotations

import math
from collections.abc import Callable

from simulator.physics import kinematics
from simulator.program.contact_commands import CONTACTS
from simulator.program.context import ProgramContext
from simulator.program.control_program import ControlProgram
from simulator.program.move_commands import MOVES
from simulator.program.query_commands import answer
from simulator.program.threads import ProgramError, Thread


def _set_payload(program: ControlProgram) -> None:
    program.context.installation.payload_kg = program.registers.double_in(0)
    if any(program.registers.doubles_in(1, 3)):
        program.context.installation.payload_cog_m = program.registers.doubles_in(1, 3)


def _set_target_payload(program: ControlProgram) -> None:
    _set_payload(program)
    program.context.installation.payload_inertia = program.registers.doubles_in(4, 6)


def _set_tcp(program: ControlProgram) -> None:
    program.context.installation.set_tcp(kinematics.transform(program.registers.doubles_in(0)))


def _set_gravity(program: ControlProgram) -> None:
    program.context.installation.gravity_m_s2 = program.registers.doubles_in(0, 3)


def _set_watchdog(program: ControlProgram) -> None:
    program.context.set_watchdog(program.registers.offset_int, program.registers.double_in(0))


def _protective_stop(program: ControlProgram) -> None:
    program.context.protective_stop("triggered by the program")


def _nothing(program: ControlProgram) -> None:
    """Accepted without effect: this arm feels no force and cannot be pushed."""


COMMANDS: dict[int, Callable[[ControlProgram], Thread | None]] = {
    **MOVES, **CONTACTS,
    17: _set_payload, 65: _set_target_payload, 29: _set_tcp, 59: _set_gravity, 35: _set_watchdog, 31: _protective_stop,
    6: _nothing, 8: _nothing, 18: _nothing, 19: _nothing, 20: _nothing, 21: _nothing,
    52: _nothing, 53: _nothing, 56: _nothing, 57: _nothing,
}  # fmt: skip

FUNCTIONS = {  # command -> script function it calls; without it in the text, the command has no effect
    25: "tool_contact", 51: "tool_contact", 26: "get_steptime", 27: "get_actual_joint_positions_history",
    28: "get_target_waypoint", 31: "protective_stop", 40: "get_tcp_offset",
    67: "get_mass_matrix", 68: "get_coriolis_and_centrifugal_torques", 69: "get_target_joint_accelerations",
    70: "get_jacobian", 71: "get_jacobian_time_derivative",
    60: "get_inverse_kin_has_solution", 61: "get_inverse_kin_has_solution",
}  # fmt: skip
ARGUMENTS = {  # command -> number of double registers the script reads for it, from 0 on; others read none
    1: 8, 2: 8, 3: 8, 4: 8, 9: 8, 10: 8, 11: 11, 24: 11, 12: 9, 15: 1, 16: 1, 33: 1, 34: 1, 17: 4, 65: 10, 29: 6, 59: 3,
    35: 1, 25: 6, 30: 14, 46: 6, 60: 6, 61: 14, 36: 6, 37: 6, 39: 12, 41: 14, 44: 12, 51: 13, 62: 6,
}  # fmt: skip


def process(program: ControlProgram, number: int) -> Thread | None:
    """Carries out one command, or returns a thread that does; an unknown number has no effect, as in the script.

    Raises:
        ProgramError: an argument is not finite.
    """
    if not all(map(math.isfinite, program.registers.doubles_in(0, ARGUMENTS.get(number, 0)))):
        raise ProgramError(f"command {number}: an argument is not finite")
    if number in FUNCTIONS and not program.has(FUNCTIONS[number]):
        return None
    if number in COMMANDS:
        return COMMANDS[number](program)
    return answer(program, number)


def load_control_program(context: ProgramContext, text: str) -> ControlProgram:
    """Returns the program of an uploaded text.

    Raises:
        ProgramError: the path injected into the text is malformed.
    """
    return ControlProgram(context, text, process)
