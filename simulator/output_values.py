"""Values of the RTDE output variables at the end of a cycle."""

from __future__ import annotations

import math

import numpy as np

from planner.dynamics import Payload, joint_torques
from simulator.controller import Controller
from simulator.derived_values import DerivedValues
from simulator.interfaces import OUTPUT_TYPES, WIDTH
from simulator.physics import kinematics

JOINT_RUNNING = 253  # joint_mode; source: RTDE guide
JOINT_TEMPERATURE_C = 30.0  # chosen
VOLTAGE_V = 48.0  # source: UR user manual, robot supply
CURRENT_IDLE_A = 0.5  # chosen
CURRENT_WINDOW_A = 6.0  # chosen: allowed deviation of a joint's current
TOOL_RUNNING = 253  # tool_mode; source: UR client interfaces, "Tool Modes"
VOLTAGE_TYPES = 3  # both of a pair of analog lines are voltages; source: RTDE guide, analog_io_types
AMPERE_PER_NM = 0.1  # chosen: the joints' torque constants are not published


class OutputValues:
    """Fills in the output variables from the controller, cycle by cycle.

    Attributes:
        values: output variable -> list of its numbers; output registers are the program's own lists.
        derived: functions that return the numbers of variables which are computed on request only.
        torque_every: cycles between two computations of the joint torques.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.torque_every = max(1, controller.timeline.cycles_in(controller.settings.torque_every_s))
        self.values: dict[str, list[float]] = {name: [0] * WIDTH[kind] for name, kind in OUTPUT_TYPES.items()}
        registers = controller.registers
        self.values |= {f"output_int_register_{i}": output for i, output in enumerate(registers.int_out)}
        self.values |= {f"output_double_register_{i}": output for i, output in enumerate(registers.double_out)}
        # number, mass [kg] and centre of mass [m] of each link
        links = enumerate(controller.cell.robot.links, 1)
        self.links = [(i, float(link.mass), link.com.tolist()) for i, link in links]
        self.derived = DerivedValues(controller).functions
        self._constants()
        self.torques()
        self.cycle()

    def _constants(self) -> None:
        values = self.values
        values["joint_temperatures"] = [JOINT_TEMPERATURE_C] * 6
        values["joint_mode"] = [JOINT_RUNNING] * 6
        values["actual_main_voltage"] = values["actual_robot_voltage"] = [VOLTAGE_V]
        values["actual_joint_voltage"] = [VOLTAGE_V] * 6
        values["actual_robot_current"] = [CURRENT_IDLE_A]
        values["actual_current_window"] = [CURRENT_WINDOW_A] * 6
        values["tool_temperature"] = [JOINT_TEMPERATURE_C]
        values["tool_mode"] = [TOOL_RUNNING]
        values["tool_analog_input_types"] = [VOLTAGE_TYPES]
        values["analog_io_types"] = [VOLTAGE_TYPES | VOLTAGE_TYPES << 2]
        values["tool_digital_output0_mode"] = values["tool_digital_output1_mode"] = [1]  # sinking, the default

    def cycle(self) -> None:
        """Updates the values, except the joint torques."""
        self._state()
        self._motion()
        self._inputs_and_outputs()

    def _state(self) -> None:
        c = self.controller
        values = self.values
        values["timestamp"] = [c.timeline.t]
        values["runtime_state"] = [c.runner.runtime]
        values["safety_mode"] = [c.safety.mode]
        values["safety_status_bits"] = [c.safety.bits]
        values["safety_status"] = [c.safety.mode]
        values["robot_mode"] = [c.safety.robot_mode]
        values["robot_status_bits"] = [c.safety.powered + 2 * c.runner.playing]
        values["speed_scaling"] = [c.speed_scaling / c.slider if c.slider else 1.0]
        values["target_speed_fraction"] = [c.slider]

    def _motion(self) -> None:
        c = self.controller
        arm = self.controller.arm
        values = self.values
        values["target_q"] = arm.q
        values["target_qd"] = arm.qd
        values["target_qdd"] = arm.qdd
        values["actual_q"] = arm.measured_q
        values["actual_qd"] = arm.measured_qd
        if any(arm.qd) or not arm.at_rest or c.timeline.cycles % self.torque_every == 0:
            tcp = c.installation.tcp
            pose, values["actual_TCP_speed"] = arm.chain.motion(arm.measured_q, arm.measured_qd, tcp)
            values["actual_TCP_pose"] = kinematics.pose_of(pose)
            pose, values["target_TCP_speed"] = c.commanded_motion()
            values["target_TCP_pose"] = kinematics.pose_of(pose)

    def _inputs_and_outputs(self) -> None:
        workcell = self.controller.workcell
        outputs = workcell.outputs
        installation = self.controller.installation
        values = self.values
        values["actual_digital_output_bits"] = [outputs.bits]
        values["actual_digital_input_bits"] = [workcell.input_bits]
        values["standard_analog_output0"] = outputs.analog[:1]
        values["standard_analog_output1"] = outputs.analog[1:]
        values["payload"] = [installation.payload_kg]
        values["payload_cog"] = installation.payload_cog_m
        values["payload_inertia"] = installation.payload_inertia
        values["tcp_offset"] = installation.tcp_pose
        values["tool_output_voltage"] = [installation.tool_voltage_v]
        ux, uy, uz = installation.gravity_m_s2
        values["actual_tool_accelerometer"] = [-ux, -uy, -uz]

    def torques(self) -> None:
        """Updates joint torques and momentum; too expensive for every cycle, they are held in between."""
        arm = self.controller.arm
        installation = self.controller.installation
        values = self.values
        payload = Payload(installation.payload_kg, np.array(installation.payload_cog_m), np.zeros((3, 3)))
        gravity_B = -np.array(installation.gravity_m_s2)
        moments = joint_torques(self.controller.cell.robot, arm.q, arm.qd, arm.qdd, gravity_B, payload).tolist()
        values["target_moment"] = moments
        values["target_current"] = values["actual_current"] = [AMPERE_PER_NM * m for m in moments]
        values["joint_control_output"] = values["target_current"]
        values["actual_current_as_torque"] = moments
        values["actual_momentum"] = [self._momentum()]

    def _momentum(self) -> float:
        """Returns the norm of the linear momentum [kg m/s] of the links, and of the payload on the last one."""
        arm = self.controller.arm
        installation = self.controller.installation
        frames = arm.chain.frames(arm.measured_q)
        payload = (6, installation.payload_kg, installation.payload_cog_m)
        total = [0.0, 0.0, 0.0]
        for i, mass, com in (*self.links, payload):
            _, velocity = kinematics.point_motion(frames[: i + 1], arm.measured_qd, com)
            total = [p + mass * v for p, v in zip(total, velocity, strict=True)]
        return math.hypot(*total)
