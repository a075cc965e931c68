"""The commands of `rtde_control` that only query: kinematics, safety limits, torques, state."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from simulator.physics import Transform, kinematics
from simulator.program.control_program import ControlProgram

RATE_S = 1e-4  # [s] step of the derivative of the Jacobian
LOWER = 24  # doubles of a matrix in the lower range of the registers
UPPER = 36  # register at which the others begin; source of both: the script
STEADY_RAD_S = 1e-6  # [rad/s] commanded speed below which the arm is steady


def _arguments(program: ControlProgram) -> tuple[list[float], list[float]]:
    """Returns the first two arguments of six numbers."""
    return program.registers.doubles_in(0), program.registers.doubles_in(6)


def _tool_pose(program: ControlProgram, q: list[float], tool: Transform) -> list[float]:
    """Returns the pose of a tool at joint positions `q` (6,) [rad]."""
    return kinematics.pose_of(program.arm.chain.forward(q, tool))


def _forward(program: ControlProgram) -> list[float]:
    return _tool_pose(program, program.arm.q, program.context.tcp)


def _forward_of(program: ControlProgram) -> list[float]:
    q, tool = _arguments(program)
    return _tool_pose(program, q, kinematics.transform(tool))


def _pose_trans(program: ControlProgram) -> list[float]:
    a, b = map(kinematics.transform, _arguments(program))
    return kinematics.pose_of(kinematics.product(a, b))


def _pose_is_safe(program: ControlProgram) -> bool:
    q = program.context.solve(program.registers.doubles_in(0))
    return q is not None and program.context.limits.allows(q)


def _jacobian(program: ControlProgram, at_s: float = 0.0) -> np.ndarray:
    """Returns the Jacobian (6, 6) of the tool where the present speed leads within `at_s` [s]."""
    q = [a + at_s * b for a, b in zip(program.arm.q, program.arm.qd, strict=True)]
    return program.arm.chain.jacobian(q, program.context.tcp)[0]


def _jacobian_rate(program: ControlProgram) -> np.ndarray:
    return (_jacobian(program, RATE_S) - _jacobian(program, -RATE_S)) / (2.0 * RATE_S)


_MATRICES: dict[int, Callable[[ControlProgram], np.ndarray]] = {  # column by column, in two ranges of registers
    67: lambda p: p.context.inertia(),
    70: _jacobian,
    71: _jacobian_rate,
}
_VECTORS: dict[int, Callable[[ControlProgram], list[float]]] = {  # answered in the double registers
    26: lambda p: [p.arm.dt],
    27: lambda p: p.arm.measured_before(p.registers.int_in(1)),
    28: _forward,
    30: lambda p: p.solve(*_arguments(p)),
    38: lambda p: [0.0] * 6,  # get_joint_torques: the external torques, and nothing touches this arm
    39: _pose_trans,
    40: lambda p: p.context.installation.tcp_pose,
    43: _forward,
    44: _forward_of,
    46: lambda p: p.solve(p.registers.doubles_in(0)),
    68: lambda p: p.context.coriolis().tolist(),
    69: lambda p: p.arm.qdd,
    58: lambda p: _tool_pose(p, p.arm.true_q, kinematics.IDENTITY),  # of the flange
}
_NUMBERS: dict[int, Callable[[ControlProgram], int]] = {  # answered in integer register 1
    25: lambda p: p.context.in_contact(),
    36: _pose_is_safe,
    37: lambda p: p.context.limits.allows(p.registers.doubles_in(0)),
    47: lambda p: max(map(abs, p.arm.qd)) < STEADY_RAD_S,
    54: lambda p: 0,  # nothing limits freedrive
    60: lambda p: p.context.solve(p.registers.doubles_in(0)) is not None,
    61: lambda p: p.context.solve(*_arguments(p)) is not None,
    64: lambda p: p.contact_steps,
}


def answer(program: ControlProgram, number: int) -> None:
    """Writes the answer to the query `number`; there is none to any other command."""
    if number in _MATRICES:
        columns = _MATRICES[number](program).T.ravel().tolist()
        program.registers.doubles_out(columns[:LOWER])
        program.registers.doubles_out(columns[LOWER:], UPPER)
    elif number in _VECTORS:
        program.registers.doubles_out(_VECTORS[number](program))
    elif number in _NUMBERS:
        program.registers.int_out(1, _NUMBERS[number](program))
