"""The controller: one `cycle()` runs the program, moves the arm, checks the limits and advances the workcell."""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.cell import Cell
from simulator.clock import Timeline
from simulator.interfaces import InputValues
from simulator.physics import Transform, Workcell, kinematics
from simulator.program import (
    CONTROL_HEADER,
    Installation,
    InterpreterQueue,
    MotionState,
    Program,
    ProgramContext,
    ProgramRunner,
    SafetyLimits,
    Stops,
    SuddenTargetChange,
    load_control_program,
    motions,
)
from simulator.settings import ControllerIdentity, SimulatorSettings
from simulator.truth import Truth, truth_of
from simulator.urscript import Script

SCALING_PER_S = 5.0  # [1/s] chosen: rate at which the speed scaling follows the slider, full range in 0.2 s
ACCELERATION_SLACK = 1.001  # [-] a ramp exactly at the limit, rounded, is no violation
TOOL_VOLTAGE_V = 24  # source: UR user manual, tool I/O: 0, 12 or 24 V
COMMAND_REGISTERS = (0, 24)  # integer registers that may carry the command number; source: ur_rtde's two ranges


class Controller:
    """State of the simulated controller; nothing here knows a socket or a wall clock.

    Attributes:
        timeline: controller time and events.
        workcell: arm, outputs, gripper and objects.
        installation: tool, payload and mounting as the controller believes them.
        slider: position of the speed slider, 0 to 1.
        speed_scaling: present speed scaling, which follows the slider.
    """

    def __init__(self, cell: Cell, settings: SimulatorSettings, truth: Truth | None = None) -> None:
        """Starts at home; without a `truth` the cell's table [sim] is the truth."""
        self.cell = cell
        self.settings = settings
        self.identity = identity_of(cell, settings)
        self.timeline = Timeline(1.0 / cell.robot.sample_rate_hz)
        self.workcell = Workcell(cell, settings, truth or truth_of(cell), self.timeline.dt)
        self.arm = self.workcell.arm
        self.installation = installation_of(cell)
        self.limits = limits_of(cell, settings)
        self.slider = self.speed_scaling = 1.0
        self._commanded: tuple[int, Transform, list[float]] = (-1, kinematics.IDENTITY, [])
        self.runner = ProgramRunner(
            lambda text: load_program(self.context, text),
            lambda: self.arm.at_rest,
            self.timeline,
            settings,
            coast=lambda: motions.coast(self.context),
        )
        self.safety = self.runner.safety
        self.registers = self.runner.registers
        self.stream = self.runner.stream
        self.stops = Stops(self.runner)
        self.context = ProgramContext(
            version=self.identity.version,
            robot=cell.robot,
            arm=self.arm,
            motion=MotionState(),
            interpreter=InterpreterQueue(),
            registers=self.registers,
            installation=self.installation,
            limits=self.limits,
            speed_scaling=lambda: self.speed_scaling,
            in_contact=self.workcell.in_contact,
            set_watchdog=self.runner.set_watchdog,
            protective_stop=self.stops.protective,
            post=self.runner.board.post,
            set_outputs=self.workcell.outputs.request,
            output_bits=lambda: self.workcell.outputs.bits,
            input_bits=lambda: self.workcell.input_bits,
        )

    def look_at_feeder(self) -> dict[str, Any]:
        """Returns what the camera sees on the feeder's places, and when [s]; nothing without a feeder."""
        feeder = self.workcell.feeder
        return {"t": self.timeline.t, "objects": [] if feeder is None else feeder.look()}

    def take_inputs(self, inputs: InputValues) -> None:
        """Applies a data package: registers keep their values until overwritten, outputs and slider change."""
        registers = self.registers
        for first, values in inputs.doubles:
            registers.double_in[first : first + len(values)] = values
        for register, value in inputs.ints:
            registers.int_in[register] = value
            registers.written_at[register] = self.timeline.cycles
            if register in COMMAND_REGISTERS:
                self.stream.command_arrived(value)
        if inputs.others:
            self.workcell.outputs.request(inputs.others)
            for name, value in inputs.others.items():
                registers.write_bits(name, value)
            fraction = inputs.others.get("speed_slider_fraction", -1.0)
            if inputs.others.get("speed_slider_mask") and 0.0 <= fraction <= 1.0:
                self.slider = fraction

    def cycle(self) -> None:
        """Advances the controller by one cycle."""
        self.timeline.cycles += 1
        self.stream.cycle()
        self._follow_slider()
        self.context.motion.begin_cycle(self.runner.playing and self.safety.may_move)
        try:
            self.runner.cycle()
        except SuddenTargetChange as change:
            self.stops.protective(str(change))
        self.arm.brake(self.safety.deceleration)
        self._check_limits()
        self.workcell.cycle(self.timeline.t)

    def _follow_slider(self) -> None:
        if self.speed_scaling != self.slider:
            most = SCALING_PER_S * self.timeline.dt
            self.speed_scaling += min(most, max(-most, self.slider - self.speed_scaling))

    def _check_limits(self) -> None:
        arm = self.arm
        if self.safety.stopped or not any(arm.qd):
            return
        _, (vx, vy, vz, *_) = self.commanded_motion()
        violation = self.limits.violation(arm.q, arm.qd, arm.qdd, (vx * vx + vy * vy + vz * vz) ** 0.5)
        if violation:
            fate = "stopped" if self.context.motion.leads_out else None  # its program could only do the same again
            self.stops.protective(violation, fate, self.limits.stopping(arm.q, arm.qd))

    def commanded_motion(self) -> tuple[Transform, list[float]]:
        """Returns the commanded pose and twist of the TCP in the base; computed once per cycle."""
        if self._commanded[0] != self.timeline.cycles:
            motion = self.arm.chain.motion(self.arm.q, self.arm.qd, self.installation.tcp)
            self._commanded = (self.timeline.cycles, *motion)
        return self._commanded[1:]


def load_program(context: ProgramContext, text: str) -> Program:
    """Returns the program of an uploaded text: that of ur_rtde, or any script.

    Raises:
        ProgramError: it does not compile.
    """
    if text.lstrip().startswith(CONTROL_HEADER):
        return load_control_program(context, text)
    return Script(context, text)


def identity_of(cell: Cell, settings: SimulatorSettings) -> ControllerIdentity:
    """Returns the identity presented for a cell; `sim.polyscope` is "5.11.1" or "3.15"."""
    major, minor, bugfix = (*map(int, cell.sim.polyscope.split(".")), 0)[:3]
    model = cell.robot.name.upper().rstrip("E")
    return ControllerIdentity((major, minor, bugfix), settings.build, settings.serial_number, model)


def installation_of(cell: Cell) -> Installation:
    """Returns the installation that agrees with the cell: the controller's belief until a client changes it."""
    cog_m = (0.5 * cell.tool.end_F).tolist()  # half way to the TCP: docs/conventions.md
    up_W = np.array([0.0, 0.0, cell.surroundings.gravity_m_s2])
    installation = Installation(cell.tool.mass_kg, cog_m, (cell.X_WB[:3, :3].T @ up_W).tolist())
    installation.set_tcp(kinematics.from_matrix(cell.tool.X_FT))
    if cell.gripper.link is None and cell.gripper.output == "tool_digital":
        installation.tool_voltage_v = TOOL_VOLTAGE_V
    return installation


def limits_of(cell: Cell, settings: SimulatorSettings) -> SafetyLimits:
    """Returns the arm's own limits; the safety system does not know the tighter ones of the cell file."""
    robot = cell.robot
    qd_max = (robot.qd_max + settings.joint_speed_tolerance_rad_s).tolist()
    qdd_max = (robot.qdd_max * ACCELERATION_SLACK).tolist()
    return SafetyLimits(robot.q_lower.tolist(), robot.q_upper.tolist(), qd_max, qdd_max, settings.tcp_speed_limit_m_s)
