"""Names and types of the RTDE variables, as the controller announces them.

Source: Universal Robots, RTDE guide, "Robot controller outputs" and "Robot controller inputs".
"""

from __future__ import annotations

from executor.simulator.settings import REGISTERS

DOUBLE, INT32, UINT32, UINT64, UINT8 = "DOUBLE", "INT32", "UINT32", "UINT64", "UINT8"
VECTOR6D, VECTOR3D, VECTOR6INT32 = "VECTOR6D", "VECTOR3D", "VECTOR6INT32"
NOT_FOUND, IN_USE = "NOT_FOUND", "IN_USE"

FORMAT = {  # type -> struct format of its value, big-endian on the wire
    DOUBLE: "d",
    INT32: "i",
    UINT32: "I",
    UINT64: "Q",
    UINT8: "B",
    VECTOR6D: "6d",
    VECTOR3D: "3d",
    VECTOR6INT32: "6i",
}
WIDTH = {kind: int(form[:-1] or 1) for kind, form in FORMAT.items()}  # numbers in a value

_OUTPUTS = {
    DOUBLE: "timestamp actual_execution_time speed_scaling target_speed_fraction actual_momentum actual_main_voltage "
    "actual_robot_voltage actual_robot_current standard_analog_input0 standard_analog_input1 "
    "standard_analog_output0 standard_analog_output1 payload tcp_force_scalar",
    VECTOR6D: "target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_current "
    "joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose "
    "target_TCP_speed joint_temperatures actual_joint_voltage ft_raw_wrench payload_inertia "
    "actual_current_as_torque tcp_offset",
    VECTOR3D: "actual_tool_accelerometer payload_cog elbow_position elbow_velocity",
    VECTOR6INT32: "joint_mode",
    INT32: "robot_mode safety_mode",
    UINT32: "runtime_state robot_status_bits safety_status_bits safety_status output_bit_registers0_to_31 "
    "output_bit_registers32_to_63",
    UINT64: "actual_digital_input_bits actual_digital_output_bits",
}
_INPUTS = {
    UINT32: "speed_slider_mask",
    DOUBLE: "speed_slider_fraction standard_analog_output_0 standard_analog_output_1",
    UINT8: "standard_digital_output_mask standard_digital_output configurable_digital_output_mask "
    "configurable_digital_output tool_digital_output_mask tool_digital_output standard_analog_output_mask "
    "standard_analog_output_type",
    VECTOR6D: "external_force_torque",
}
SINCE = {  # variable -> generation -> first version that has it; source: what ur_rtde 1.6.5 requests
    "ft_raw_wrench": {5: (5, 9)},
    "payload": {3: (3, 11), 5: (5, 5)},
    "payload_cog": {3: (3, 11), 5: (5, 5)},
    "payload_inertia": {3: (3, 15), 5: (5, 11)},
    "actual_current_as_torque": {5: (5, 23)},
    "external_force_torque": {3: (3, 3), 5: (5, 0)},
}


def _table(named: dict[str, str], prefix: str) -> dict[str, str]:
    table = {name: kind for kind, names in named.items() for name in names.split()}
    for i in range(REGISTERS):
        table[f"{prefix}_int_register_{i}"] = INT32
        table[f"{prefix}_double_register_{i}"] = DOUBLE
    return table


OUTPUT_TYPES = _table(_OUTPUTS, "output")
INPUT_TYPES = _table(_INPUTS, "input")


def exists(name: str, version: tuple[int, ...]) -> bool:
    """Whether a controller of `version` has the variable `name` of one of the tables."""
    since = SINCE.get(name)
    if since is None:
        return True
    first = since.get(version[0])
    return version[0] > 5 or (first is not None and version[:2] >= first)
