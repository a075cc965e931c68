"""The commands of `rtde_control` that set something: payload, tool, gravity, watchdog; and those without effect."""

from __future__ import annotations

from collections.abc import Callable

from executor.simulator.control_program import ControlProgram
from executor.simulator.kinematics import transform


def _set_payload(program: ControlProgram) -> None:
    program.controller.payload_kg = program.double_in(0)
    if any(program.doubles_in(1, 3)):
        program.controller.payload_cog_m = program.doubles_in(1, 3)


def _set_target_payload(program: ControlProgram) -> None:
    _set_payload(program)
    program.controller.payload_inertia = program.doubles_in(4, 6)


def _set_tcp(program: ControlProgram) -> None:
    program.controller.set_tcp(transform(program.doubles_in(0)))


def _set_gravity(program: ControlProgram) -> None:
    program.controller.gravity_m_s2 = program.doubles_in(0, 3)


def _set_watchdog(program: ControlProgram) -> None:
    program.controller.execution.set_watchdog(24 if program.offset_int == 24 else 0, program.double_in(0))


def _protective_stop(program: ControlProgram) -> None:
    if program.has("protective_stop"):
        program.controller.stops.protective("triggered by the program")


def _nothing(program: ControlProgram) -> None:
    """Accepted without effect: this arm feels no force and cannot be pushed."""


SETTINGS: dict[int, Callable[[ControlProgram], None]] = {
    17: _set_payload, 65: _set_target_payload, 29: _set_tcp, 59: _set_gravity, 35: _set_watchdog, 31: _protective_stop,
    6: _nothing, 8: _nothing, 18: _nothing, 19: _nothing, 20: _nothing, 21: _nothing,
    52: _nothing, 53: _nothing, 56: _nothing, 57: _nothing,
}  # fmt: skip
