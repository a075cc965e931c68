"""The commands of `rtde_control` that only ask: kinematics, safety limits, torques, state."""

from __future__ import annotations

from collections.abc import Callable

from executor.simulator.control_program import ControlProgram
from executor.simulator.kinematics import IDENTITY, Transform, pose_of, product, transform

Query = Callable[[ControlProgram], None]
STEADY_RAD_S = 1e-6  # [rad/s] commanded speed below which the arm is steady


def _step_time(program: ControlProgram) -> None:
    if program.has("get_steptime"):
        program.doubles_out([program.controller.dt])


def _history(program: ControlProgram) -> None:
    if program.has("get_actual_joint_positions_history"):
        program.doubles_out(program.controller.measured_before(program.int_in(1)))


def _tool_pose(program: ControlProgram, q: list[float], tool: Transform) -> list[float]:
    return pose_of(program.arm.chain.forward(q, tool))


def _target_waypoint(program: ControlProgram) -> None:
    if program.has("get_target_waypoint"):
        program.doubles_out(_tool_pose(program, program.arm.q, program.controller.tcp))


def _tcp_offset(program: ControlProgram) -> None:
    if program.has("get_tcp_offset"):
        program.doubles_out(program.controller.tcp_pose)


def _flange_pose(program: ControlProgram) -> None:
    program.doubles_out(_tool_pose(program, program.arm.true_q, IDENTITY))


def _forward(program: ControlProgram) -> None:
    program.doubles_out(_tool_pose(program, program.arm.q, program.controller.tcp))


def _forward_of(program: ControlProgram) -> None:
    program.doubles_out(_tool_pose(program, program.doubles_in(0), transform(program.doubles_in(6))))


def _inverse(program: ControlProgram) -> None:
    program.doubles_out(program.solve(program.doubles_in(0)))


def _inverse_near(program: ControlProgram) -> None:
    program.doubles_out(program.solve(program.doubles_in(0), program.doubles_in(6)))


def _has_solution(program: ControlProgram) -> None:
    if program.has("get_inverse_kin_has_solution"):
        program.int_out(1, program.controller.solve(program.doubles_in(0)) is not None)


def _has_solution_near(program: ControlProgram) -> None:
    if program.has("get_inverse_kin_has_solution"):
        program.int_out(1, program.controller.solve(program.doubles_in(0), program.doubles_in(6)) is not None)


def _pose_is_safe(program: ControlProgram) -> None:
    q = program.controller.solve(program.doubles_in(0))
    program.int_out(1, q is not None and program.controller.limits.allows(q))


def _joints_are_safe(program: ControlProgram) -> None:
    program.int_out(1, program.controller.limits.allows(program.doubles_in(0)))


def _joint_torques(program: ControlProgram) -> None:
    """get_joint_torques tells what is left beyond moving the arm itself: nothing touches this one."""
    program.doubles_out([0.0] * 6)


def _pose_trans(program: ControlProgram) -> None:
    program.doubles_out(pose_of(product(transform(program.doubles_in(0)), transform(program.doubles_in(6)))))


def _is_steady(program: ControlProgram) -> None:
    program.int_out(1, max(map(abs, program.arm.qd)) < STEADY_RAD_S)


def _tool_contact(program: ControlProgram) -> None:
    if program.has("tool_contact"):
        program.int_out(1, program.controller.in_contact())


def _read_contact(program: ControlProgram) -> None:
    program.int_out(1, program.contact_steps)


def _freedrive_status(program: ControlProgram) -> None:
    """0: freedrive is not limited by anything."""
    program.int_out(1, 0)


QUERIES: dict[int, Query] = {
    25: _tool_contact, 26: _step_time, 27: _history, 28: _target_waypoint, 40: _tcp_offset, 58: _flange_pose,
    43: _forward, 44: _forward_of, 46: _inverse, 30: _inverse_near, 60: _has_solution, 61: _has_solution_near,
    36: _pose_is_safe, 37: _joints_are_safe, 38: _joint_torques, 39: _pose_trans, 47: _is_steady,
    54: _freedrive_status, 64: _read_contact,
}  # fmt: skip
