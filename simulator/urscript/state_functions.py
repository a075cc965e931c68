"""The functions of URScript that read the arm's state, and read or write registers, outputs and the installation.

Source of names and parameters: Universal Robots, "The URScript Programming Language".
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from simulator.physics import Transform, kinematics
from simulator.program import ProgramContext
from simulator.urscript.motion_functions import solved
from simulator.urscript.signatures import Signature, signature
from simulator.urscript.values import ScriptPose, number, six

CONTACT_STEPS_MAX = 500  # chosen: cycles that tool_contact looks back
STEADY_RAD_S = 1e-6  # [rad/s] commanded speed below which the arm is steady
OUTPUT_FIRST = {"standard_digital": 0, "configurable_digital": 8, "tool_digital": 16}  # source: RTDE guide, output bits
SOLVER = "maxPositionError=1e-10 maxOrientationError=1e-10 tcp=0"  # taken as they are: what is solved is exact
TOOL_OUTPUTS = 8  # set_digital_out counts the tool's outputs from here on; source: URScript manual
ANALOG_OUTPUTS = 2
TOOL_VOLTAGES_V = (0, 12, 24)  # source: URScript manual, set_tool_voltage
INPUT_REGISTER = "input_int_register_"


def _pose(c: ProgramContext, q: list[float], tool: Transform) -> ScriptPose:
    return ScriptPose(kinematics.pose_of(c.arm.chain.forward(q, tool)))


def _inverse(c: ProgramContext, x: Any, near: Any, *rest: Any) -> list[float]:
    return solved(c, x, near)


def _has_inverse(c: ProgramContext, x: Any, near: Any, *rest: Any) -> bool:
    return c.solve(ScriptPose(x), six(near) if isinstance(near, list) else None) is not None


def _forward(c: ProgramContext, q: Any, tcp: Any) -> ScriptPose:
    tool = kinematics.transform(ScriptPose(tcp)) if isinstance(tcp, list) else c.tcp
    joints = six(q) if isinstance(q, list) else c.arm.measured_q
    return ScriptPose(kinematics.pose_of(c.arm.chain.forward(joints, tool)))


def _twist(c: ProgramContext) -> list[float]:
    return list(c.arm.chain.motion(c.arm.measured_q, c.arm.measured_qd, c.tcp)[1])


# -- outputs and registers
def _set(c: ProgramContext, kind: str, index: Any, level: Any) -> None:
    bit = 1 << _index(index, 8 if kind != "tool_digital" else 2)
    c.set_outputs({f"{kind}_output_mask": bit, f"{kind}_output": bit if level is True else 0})


def _set_any(c: ProgramContext, n: Any, b: Any) -> None:
    if _index(n, TOOL_OUTPUTS + 2) >= TOOL_OUTPUTS:
        _set(c, "tool_digital", n - TOOL_OUTPUTS, b)
    else:
        _set(c, "standard_digital", n, b)


def _set_analog(c: ProgramContext, n: Any, f: Any) -> None:
    line = _index(n, ANALOG_OUTPUTS)
    level = float(number(f))
    if not 0.0 <= level <= 1.0:
        raise ValueError("the level must be within 0 and 1")
    c.set_outputs({"standard_analog_output_mask": 1 << line, f"standard_analog_output_{line}": level})


def _set_tool_voltage(c: ProgramContext, voltage: Any) -> None:
    if number(voltage) not in TOOL_VOLTAGES_V:
        raise ValueError("the voltage must be 0, 12 or 24")
    c.installation.tool_voltage_v = int(voltage)


def _index(value: Any, count: int) -> int:
    """Returns a number of a register or line.

    Raises:
        ValueError: there is none of that number.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < count:
        raise ValueError(f"the number must be within 0 and {count - 1}")
    return value


def _setter(kind: str) -> Signature:
    return signature("n b", lambda c, n, b: _set(c, kind, n, b))


def _getter(kind: str) -> Signature:
    first = OUTPUT_FIRST[kind]
    return signature("n", lambda c, n: bool(c.output_bits() >> first + _index(n, 8) & 1))


def _sensor(kind: str) -> Signature:
    first = OUTPUT_FIRST[kind]  # inputs are in the order of the outputs
    return signature("n", lambda c, n: bool(c.input_bits() >> first + _index(n, 8) & 1))


def _register(values: Callable[[ProgramContext], Any], read: Callable[[Any], Any]) -> Signature:
    return signature("address", lambda c, address: read(values(c)[_index(address, len(values(c)))]))


def _write_bit(c: ProgramContext, address: Any, value: Any) -> None:
    c.registers.bit_out[_index(address, len(c.registers.bit_out))] = value is True


def _write_int(c: ProgramContext, address: Any, value: Any) -> None:
    whole = int(number(value))
    c.registers.int_out[_index(address, len(c.registers.int_out))][0] = (whole + 2**31) % 2**32 - 2**31


def _write_float(c: ProgramContext, address: Any, value: Any) -> None:
    c.registers.double_out[_index(address, len(c.registers.double_out))][0] = float(number(value))


def _set_watchdog(c: ProgramContext, variable: Any, frequency: Any, action: Any) -> None:
    name = str(variable)
    if not name.startswith(INPUT_REGISTER):
        raise ValueError(f"only {INPUT_REGISTER}N can be watched here, not {name}")
    c.set_watchdog(_index(int(name.removeprefix(INPUT_REGISTER)), len(c.registers.int_in)), number(frequency))


# -- installation
def _set_tcp(c: ProgramContext, pose: Any) -> None:
    c.installation.set_tcp(kinematics.transform(ScriptPose(pose)))


def _set_payload(c: ProgramContext, mass: Any, cog: Any) -> None:
    c.installation.payload_kg = float(number(mass))
    if isinstance(cog, list):
        c.installation.payload_cog_m = [float(number(x)) for x in cog[:3]]


def _set_target_payload(c: ProgramContext, mass: Any, cog: Any, inertia: Any, transition_time: Any) -> None:
    _set_payload(c, mass, cog)
    if isinstance(inertia, list):
        c.installation.payload_inertia = six(inertia)


# -- contact
def _contact_steps(c: ProgramContext, direction: Any) -> int:
    """Returns how many cycles ago the tool touched what it touches now; 0 where it touches nothing."""
    steps = 0
    while steps < CONTACT_STEPS_MAX and c.in_contact(c.arm.measured_before(steps)):
        steps += 1
    return steps


def _nothing(c: ProgramContext, *arguments: Any) -> None:
    """Accepted without effect: this arm feels no force and cannot be pushed."""


def _set_gravity(c: ProgramContext, d: Any) -> None:
    x, y, z = d
    c.installation.gravity_m_s2 = [float(number(x)), float(number(y)), float(number(z))]


STATE_FUNCTIONS: dict[str, Signature] = {
    "get_actual_joint_positions": signature("", lambda c: list(c.arm.measured_q)),
    "get_target_joint_positions": signature("", lambda c: list(c.arm.q)),
    "get_actual_joint_speeds": signature("", lambda c: list(c.arm.measured_qd)),
    "get_target_joint_speeds": signature("", lambda c: list(c.arm.qd)),
    "get_actual_tcp_pose": signature("", lambda c: _pose(c, c.arm.measured_q, c.tcp)),
    "get_target_tcp_pose": signature("", lambda c: _pose(c, c.arm.q, c.tcp)),
    "get_actual_tcp_speed": signature("", _twist),
    "get_tcp_force": signature("", lambda c: [0.0] * 6),
    "get_tcp_offset": signature("", lambda c: ScriptPose(c.installation.tcp_pose)),
    "get_forward_kin": signature("q=0 tcp=0", _forward),
    "get_inverse_kin": signature(f"x qnear=0 {SOLVER}", _inverse),
    "get_inverse_kin_has_solution": signature(f"x qnear=0 {SOLVER}", _has_inverse),
    "get_joint_positions": signature("", lambda c: list(c.arm.q)),
    "get_actual_joint_positions_history": signature("steps=0", lambda c, n: list(c.arm.measured_before(int(n)))),
    "get_actual_tool_flange_pose": signature("", lambda c: _pose(c, c.arm.measured_q, kinematics.IDENTITY)),
    "get_target_tcp_speed": signature("", lambda c: list(c.arm.chain.motion(c.arm.q, c.arm.qd, c.tcp)[1])),
    "get_steptime": signature("", lambda c: c.arm.dt),
    "tool_contact": signature("direction=0", _contact_steps),
    "zero_ftsensor": signature("", _nothing),
    "force_mode": signature("task_frame selection_vector wrench type limits", _nothing),
    "end_force_mode": signature("", _nothing),
    "force_mode_set_damping": signature("damping", _nothing),
    "force_mode_set_gain_scaling": signature("scaling", _nothing),
    "freedrive_mode": signature("freeAxes=0 feature=0", _nothing),
    "end_freedrive_mode": signature("", _nothing),
    "teach_mode": signature("", _nothing),
    "end_teach_mode": signature("", _nothing),
    "ft_rtde_input_enable": signature("enable sensor_mass=0 sensor_measuring_offset=0 sensor_cog=0", _nothing),
    "enable_external_ft_sensor": signature("enable sensor_mass=0 sensor_measuring_offset=0 sensor_cog=0", _nothing),
    "is_steady": signature("", lambda c: max(map(abs, c.arm.qd)) < STEADY_RAD_S),
    "is_within_safety_limits": signature("q", lambda c, q: c.limits.allows(six(q))),
    "set_digital_out": signature("n b", _set_any),
    "set_analog_out": signature("n f", _set_analog),
    "set_standard_analog_out": signature("n f", _set_analog),
    "set_tool_voltage": signature("voltage", _set_tool_voltage),
    "set_standard_digital_out": _setter("standard_digital"),
    "set_configurable_digital_out": _setter("configurable_digital"),
    "set_tool_digital_out": _setter("tool_digital"),
    "get_standard_digital_out": _getter("standard_digital"),
    "get_configurable_digital_out": _getter("configurable_digital"),
    "get_tool_digital_out": _getter("tool_digital"),
    "get_standard_digital_in": _sensor("standard_digital"),
    "get_configurable_digital_in": _sensor("configurable_digital"),
    "get_tool_digital_in": _sensor("tool_digital"),
    "read_input_boolean_register": _register(lambda c: c.registers.bit_in, bool),
    "read_input_integer_register": _register(lambda c: c.registers.int_in, int),
    "read_input_float_register": _register(lambda c: c.registers.double_in, float),
    "read_output_boolean_register": _register(lambda c: c.registers.bit_out, bool),
    "read_output_integer_register": _register(lambda c: c.registers.int_out, lambda box: int(box[0])),
    "read_output_float_register": _register(lambda c: c.registers.double_out, lambda box: float(box[0])),
    "write_output_boolean_register": signature("address value", _write_bit),
    "write_output_integer_register": signature("address value", _write_int),
    "write_output_float_register": signature("address value", _write_float),
    "rtde_set_watchdog": signature("variable frequency action=0", _set_watchdog),
    "set_tcp": signature("pose tcp_name=0", lambda c, pose, tcp_name: _set_tcp(c, pose)),
    "set_payload": signature("m cog=0", _set_payload),
    "set_target_payload": signature("m cog=0 inertia=0 transition_time=0", _set_target_payload),
    "set_gravity": signature("d", _set_gravity),
}
