"""The commands of `rtde_control` that only query: kinematics, safety limits, torques, state."""

from __future__ import annotations

from collections.abc import Callable

from executor.simulator.physics import Transform, kinematics
from executor.simulator.program.control_program import ControlProgram

Query = Callable[[ControlProgram], None]
STEADY_RAD_S = 1e-6  # [rad/s] commanded speed below which the arm is steady


def _step_time(program: ControlProgram) -> None:
    if program.has("get_steptime"):
        program.registers.doubles_out([program.arm.dt])


def _history(program: ControlProgram) -> None:
    if program.has("get_actual_joint_positions_history"):
        program.registers.doubles_out(program.arm.measured_before(program.registers.int_in(1)))


def _tool_pose(program: ControlProgram, q: list[float], tool: Transform) -> None:
    """Writes the pose of a tool at joint positions `q` (6,) [rad]."""
    program.registers.doubles_out(kinematics.pose_of(program.arm.chain.forward(q, tool)))


def _target_waypoint(program: ControlProgram) -> None:
    if program.has("get_target_waypoint"):
        _forward(program)


def _tcp_offset(program: ControlProgram) -> None:
    if program.has("get_tcp_offset"):
        program.registers.doubles_out(program.context.installation.tcp_pose)


def _flange_pose(program: ControlProgram) -> None:
    _tool_pose(program, program.arm.true_q, kinematics.IDENTITY)


def _forward(program: ControlProgram) -> None:
    _tool_pose(program, program.arm.q, program.context.tcp)


def _forward_of(program: ControlProgram) -> None:
    q, tool = _two_vectors(program)
    _tool_pose(program, q, kinematics.transform(tool))


def _two_vectors(program: ControlProgram) -> tuple[list[float], list[float]]:
    """Returns the first two arguments of six numbers."""
    return program.registers.doubles_in(0), program.registers.doubles_in(6)


def _inverse(program: ControlProgram) -> None:
    program.registers.doubles_out(program.solve(program.registers.doubles_in(0)))


def _inverse_near(program: ControlProgram) -> None:
    program.registers.doubles_out(program.solve(*_two_vectors(program)))


def _has_solution(program: ControlProgram) -> None:
    if program.has("get_inverse_kin_has_solution"):
        program.registers.int_out(1, program.context.solve(program.registers.doubles_in(0)) is not None)


def _has_solution_near(program: ControlProgram) -> None:
    if program.has("get_inverse_kin_has_solution"):
        program.registers.int_out(1, program.context.solve(*_two_vectors(program)) is not None)


def _pose_is_safe(program: ControlProgram) -> None:
    q = program.context.solve(program.registers.doubles_in(0))
    program.registers.int_out(1, q is not None and program.context.limits.allows(q))


def _joints_are_safe(program: ControlProgram) -> None:
    program.registers.int_out(1, program.context.limits.allows(program.registers.doubles_in(0)))


def _joint_torques(program: ControlProgram) -> None:
    """get_joint_torques: external torques, zero because nothing touches this arm."""
    program.registers.doubles_out([0.0] * 6)


def _pose_trans(program: ControlProgram) -> None:
    a, b = map(kinematics.transform, _two_vectors(program))
    program.registers.doubles_out(kinematics.pose_of(kinematics.product(a, b)))


def _is_steady(program: ControlProgram) -> None:
    program.registers.int_out(1, max(map(abs, program.arm.qd)) < STEADY_RAD_S)


def _tool_contact(program: ControlProgram) -> None:
    if program.has("tool_contact"):
        program.registers.int_out(1, program.context.in_contact())


def _read_contact(program: ControlProgram) -> None:
    program.registers.int_out(1, program.contact_steps)


def _freedrive_status(program: ControlProgram) -> None:
    """0: nothing limits freedrive."""
    program.registers.int_out(1, 0)


QUERIES: dict[int, Query] = {
    25: _tool_contact, 26: _step_time, 27: _history, 28: _target_waypoint, 40: _tcp_offset, 58: _flange_pose,
    43: _forward, 44: _forward_of, 46: _inverse, 30: _inverse_near, 60: _has_solution, 61: _has_solution_near,
    36: _pose_is_safe, 37: _joints_are_safe, 38: _joint_torques, 39: _pose_trans, 47: _is_steady,
    54: _freedrive_status, 64: _read_contact,
}  # fmt: skip
