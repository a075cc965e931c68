"""Names and types of the RTDE variables, as the controller announces them.

Source: Universal Robots, RTDE guide, "Robot controller outputs" and "Robot controller inputs".
"""

from __future__ import annotations

from simulator.settings import BIT_REGISTERS, BIT_WORDS_END, REGISTERS

DOUBLE = "DOUBLE"
INT32 = "INT32"
UINT32 = "UINT32"
UINT64 = "UINT64"
UINT8 = "UINT8"
BOOL = "BOOL"
VECTOR6D = "VECTOR6D"
VECTOR3D = "VECTOR3D"
VECTOR6INT32 = "VECTOR6INT32"
NOT_FOUND = "NOT_FOUND"
IN_USE = "IN_USE"

FORMAT = {  # type -> struct format of its value, big-endian on the wire
    DOUBLE: "d",
    INT32: "i",
    UINT32: "I",
    UINT64: "Q",
    UINT8: "B",
    BOOL: "?",
    VECTOR6D: "6d",
    VECTOR3D: "3d",
    VECTOR6INT32: "6i",
}
WIDTH = {kind: int(form[:-1] or 1) for kind, form in FORMAT.items()}  # numbers in a value

_OUTPUTS = {
    DOUBLE: "timestamp actual_execution_time target_execution_time speed_scaling target_speed_fraction actual_momentum "
    "actual_main_voltage actual_robot_voltage actual_robot_current standard_analog_input0 standard_analog_input1 "
    "standard_analog_output0 standard_analog_output1 io_current euromap67_24V_voltage euromap67_24V_current "
    "tool_analog_input0 tool_analog_input1 tool_output_current tool_temperature tcp_force_scalar payload "
    "joint_position_deviation_ratio collision_detection_ratio actual_robot_energy_consumed "
    "actual_robot_braking_energy_dissipated",
    VECTOR6D: "target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_current "
    "actual_current_window actual_current_as_torque joint_control_output actual_TCP_pose actual_TCP_speed "
    "actual_TCP_force actual_TCP_acceleration target_TCP_pose target_TCP_speed target_TCP_acceleration "
    "joint_temperatures actual_joint_voltage ft_raw_wrench wrench_calc_from_currents payload_inertia tcp_offset "
    "target_base_acceleration target_base_wrench",
    VECTOR3D: "actual_tool_accelerometer payload_cog elbow_position elbow_velocity target_gravity",
    VECTOR6INT32: "joint_mode",
    INT32: "robot_mode safety_mode safety_status tool_output_voltage encoder0_raw encoder1_raw time_scale_source",
    UINT32: "runtime_state robot_status_bits safety_status_bits analog_io_types tool_mode tool_analog_input_types "
    "euromap67_input_bits euromap67_output_bits output_bit_registers0_to_31 output_bit_registers32_to_63 "
    "script_control_line",
    UINT64: "actual_digital_input_bits actual_digital_output_bits actual_configurable_digital_input_bits "
    "actual_configurable_digital_output_bits control_step",
    UINT8: "tool_output_mode tool_digital_output0_mode tool_digital_output1_mode",
}
_INPUTS = {
    UINT32: "speed_slider_mask",
    DOUBLE: "speed_slider_fraction standard_analog_output_0 standard_analog_output_1",
    UINT8: "standard_digital_output_mask standard_digital_output configurable_digital_output_mask "
    "configurable_digital_output tool_digital_output_mask tool_digital_output standard_analog_output_mask "
    "standard_analog_output_type",
    VECTOR6D: "external_force_torque",
}
E_SERIES_ONLY = {5: (5, 0)}
SINCE = {  # variable -> generation -> first version that has it; source: RTDE guide, column "Introduced in version"
    "ft_raw_wrench": {5: (5, 9)},
    "payload": {3: (3, 11), 5: (5, 5)},
    "payload_cog": {3: (3, 11), 5: (5, 5)},
    "payload_inertia": {3: (3, 15), 5: (5, 11)},
    "elbow_position": {3: (3, 5), 5: (5, 0)},
    "elbow_velocity": {3: (3, 5), 5: (5, 0)},
    "safety_status": {3: (3, 10), 5: (5, 4)},
    "tool_output_mode": {5: (5, 2)},
    "tool_digital_output0_mode": {5: (5, 2)},
    "tool_digital_output1_mode": {5: (5, 2)},
    "external_force_torque": {3: (3, 3), 5: (5, 0)},
    # newer than the versions that cells present: every e-Series controller answers them here, so that a client written
    # for the guide's present table finds all of it
    "actual_current_as_torque": E_SERIES_ONLY,
    "collision_detection_ratio": E_SERIES_ONLY,
    "time_scale_source": E_SERIES_ONLY,
    "actual_robot_energy_consumed": E_SERIES_ONLY,
    "actual_robot_braking_energy_dissipated": E_SERIES_ONLY,
}


def _registers(direction: str) -> dict[str, str]:
    """Returns the general purpose registers of one direction: two words of 32 bits, 64 single bits, 48 of each type."""
    table = {f"{direction}_bit_registers{first}_to_{first + 31}": UINT32 for first in (0, 32)}
    table |= {f"{direction}_bit_register_{i}": BOOL for i in range(BIT_WORDS_END, BIT_REGISTERS)}
    for i in range(REGISTERS):
        table[f"{direction}_int_register_{i}"] = INT32
        table[f"{direction}_double_register_{i}"] = DOUBLE
    return table


def _table(named: dict[str, str]) -> dict[str, str]:
    return {name: kind for kind, names in named.items() for name in names.split()}


OUTPUT_TYPES = _table(_OUTPUTS) | _registers("output") | _registers("input")  # inputs can be read back
INPUT_TYPES = _table(_INPUTS) | _registers("input")


def exists(name: str, version: tuple[int, ...]) -> bool:
    """Whether a controller of `version` has the variable `name` of one of the tables."""
    since = SINCE.get(name)
    if since is None:
        return True
    first = since.get(version[0])
    return version[0] > 5 or (first is not None and version[:2] >= first)
