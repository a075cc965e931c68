"""What the controller tells: the values of the output variables at the end of a cycle."""

from __future__ import annotations

from executor.simulator import safety
from executor.simulator.controller import Controller
from executor.simulator.dynamics import Torques
from executor.simulator.kinematics import pose_of

JOINT_RUNNING = 253  # joint_mode; source: RTDE guide
JOINT_TEMPERATURE_C = 30.0  # chosen
VOLTAGE_V = 48.0  # source: UR user manual, robot supply
CURRENT_IDLE_A = 0.5  # chosen
AMPERE_PER_NM = 0.1  # chosen: the joints' torque constants are not published


class Published:
    """Fills the output variables of a controller's registers, cycle by cycle."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.dynamics = Torques(controller.cell.robot)
        self.torque_every = max(1, round(controller.settings.torque_every_s / controller.dt))
        self._constants()
        self.torques()

    def _constants(self) -> None:
        out = self.controller.registers.outputs
        out["joint_temperatures"] = [JOINT_TEMPERATURE_C] * 6
        out["joint_mode"] = [JOINT_RUNNING] * 6
        out["actual_main_voltage"] = out["actual_robot_voltage"] = [VOLTAGE_V]
        out["actual_joint_voltage"] = [VOLTAGE_V] * 6
        out["actual_robot_current"] = [CURRENT_IDLE_A]
        out["actual_execution_time"] = [0.0]

    def cycle(self) -> None:
        """Writes the values of now."""
        self._state()
        self._motion()
        self._io()

    def _state(self) -> None:
        c, out = self.controller, self.controller.registers.outputs
        out["timestamp"] = [c.t]
        out["runtime_state"] = [c.execution.runtime]
        out["safety_mode"] = [c.safety.mode]
        out["safety_status_bits"] = [c.safety.bits]
        out["safety_status"] = [c.safety.mode]
        out["robot_mode"] = [c.safety.robot_mode]
        out["robot_status_bits"] = [(c.safety.robot_mode >= safety.ROBOT_IDLE) + 2 * c.execution.playing]
        out["speed_scaling"] = [c.speed_scaling / c.slider if c.slider else 1.0]
        out["target_speed_fraction"] = [c.slider]

    def _motion(self) -> None:
        c, out = self.controller, self.controller.registers.outputs
        arm = c.arm
        out["target_q"], out["target_qd"], out["target_qdd"] = arm.q, arm.qd, arm.qdd
        out["actual_q"], out["actual_qd"] = arm.measured_q, arm.measured_qd
        if any(arm.qd) or not arm.at_rest or c.cycles % self.torque_every == 0:
            pose, out["actual_TCP_speed"] = c.chain.motion(arm.measured_q, arm.measured_qd, c.tcp)
            out["actual_TCP_pose"] = pose_of(pose)
            pose, out["target_TCP_speed"] = c.target_motion()
            out["target_TCP_pose"] = pose_of(pose)

    def _io(self) -> None:
        c, out = self.controller, self.controller.registers.outputs
        out["actual_digital_output_bits"] = [c.digital.bits]
        out["standard_analog_output0"], out["standard_analog_output1"] = c.analog[:1], c.analog[1:]
        out["payload"], out["payload_cog"] = [c.payload_kg], c.payload_cog_m
        out["payload_inertia"] = c.payload_inertia
        out["tcp_offset"] = c.tcp_pose
        bx, by, bz = c.gravity_m_s2
        out["actual_tool_accelerometer"] = [-bx, -by, -bz]

    def torques(self) -> None:
        """Computes the joint torques; too dear for every cycle, so done now and then and held."""
        c, out = self.controller, self.controller.registers.outputs
        arm = c.arm
        (ux, uy, uz), (x, y, z) = c.gravity_m_s2, c.payload_cog_m
        moments = self.dynamics.of(arm.q, arm.qd, arm.qdd, (ux, uy, uz), c.payload_kg, (x, y, z))
        out["target_moment"] = moments
        out["target_current"] = out["actual_current"] = [AMPERE_PER_NM * m for m in moments]
        out["joint_control_output"] = out["target_current"]
        out["actual_current_as_torque"] = moments
