"""The controller: one `cycle()` runs the program, moves the arm, watches the limits, and lets the world go on."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from executor.simulator import kinematics
from executor.simulator.arm import Arm
from executor.simulator.execution import Execution
from executor.simulator.gripper import Gripper
from executor.simulator.kinematics import Chain, Transform
from executor.simulator.lag import Lag
from executor.simulator.outputs import DigitalOutputs, take_outputs
from executor.simulator.recipes import Inputs
from executor.simulator.registers import Registers
from executor.simulator.safety import Safety, SafetyLimits
from executor.simulator.settings import Settings
from executor.simulator.statistics import Commands
from executor.simulator.stops import Stops
from executor.simulator.world import World
from planner.cell import Cell
from planner.kinematics import inverse

HISTORY = 2000  # cycles of measured positions kept for get_actual_joint_positions_history
EVENTS_MAX = 500  # events kept
SCALING_PER_S = 5.0  # chosen: how fast the speed scaling follows the slider, full range in 0.2 s
ACCELERATION_SLACK = 1.001  # a ramp at the limit itself, rounded, is no violation
CONTROL_REGISTERS = (0, 24)  # integer registers that may carry the command number


class Controller:
    """State of the simulated controller; nothing here knows a socket or a clock."""

    def __init__(self, cell: Cell, settings: Settings) -> None:
        self.cell, self.settings = cell, settings
        self.version = version_of(cell.sim.polyscope)
        self.dt = 1.0 / cell.robot.sample_rate_hz
        self.cycles = 0
        self.moved_at = 0.0  # controller time [s] of the last cycle in which the arm truly moved
        self.events: deque[tuple[float, str]] = deque(maxlen=EVENTS_MAX)
        self._mechanics()
        self._installation()
        self.registers = Registers()
        self.commands = Commands()
        self.safety = Safety()
        self.limits = limits_of(cell, settings)
        self.stops = Stops(self)
        self.execution = Execution(self)
        self.slider = self.speed_scaling = 1.0
        self.deceleration = settings.decelerations.program_end

    def _mechanics(self) -> None:
        cell, settings, home = self.cell, self.settings, self.cell.home.tolist()
        self.chain = Chain(cell.robot)
        lag = Lag(self.dt, cell.sim.lag_s, settings.first_order_s, home)
        noise = (settings.position_noise_rad, settings.velocity_noise_rad_s)
        self.arm = Arm(self.chain, self.dt, home, lag, noise, cell.sim.seed)
        self.target_at = -1  # cycle whose commanded motion of the TCP is in `target`
        self.target = (kinematics.IDENTITY, [0.0] * 6)
        self.history: deque[list[float]] = deque(maxlen=HISTORY)
        self.gripper = Gripper(cell.gripper, cell.sim, cell.sim.seed)
        self.digital = DigitalOutputs(self.dt, cell.sim.lag_s, self.gripper.closed_bits)
        self.output_changes: deque[tuple[float, int]] = deque(maxlen=HISTORY)
        self.analog = [0.0, 0.0]
        self.world = World(cell, settings.restitution)
        self.tool = kinematics.from_matrix(cell.tool.X_FT)
        self.base = kinematics.from_matrix(cell.X_WB)

    def _installation(self) -> None:
        """What the controller believes of tool, payload and mounting: the cell's truth, until a client changes it."""
        cell = self.cell
        self.set_tcp(self.tool)
        self.payload_kg, self.payload_inertia = cell.tool.mass_kg, [0.0] * 6
        self.payload_cog_m: list[float] = (0.5 * cell.tool.X_FT[:3, 3]).tolist()  # half way to the TCP, as in cells.md
        up_W = np.array([0.0, 0.0, cell.surroundings.gravity_m_s2])
        self.gravity_m_s2: list[float] = (cell.X_WB[:3, :3].T @ up_W).tolist()  # UR's sign: against the fall

    def set_tcp(self, tcp: Transform) -> None:
        """Changes the tool centre point the controller believes in; the true tool stays."""
        self.tcp, self.tcp_pose = tcp, kinematics.pose_of(tcp)

    @property
    def t(self) -> float:
        """Controller time [s]."""
        return self.cycles * self.dt

    def scaling(self) -> float:
        """Returns the speed scaling of now, 0 to 1."""
        return self.speed_scaling

    def note(self, event: str) -> None:
        """Keeps an event for whoever asks over the control port."""
        self.events.append((round(self.t, 4), event))

    def take_inputs(self, inputs: Inputs) -> None:
        """Obeys a data package: registers keep their values until overwritten, outputs and slider change."""
        registers = self.registers
        for first, values in inputs.doubles:
            registers.double_in[first : first + len(values)] = values
        for register, value in inputs.ints:
            registers.int_in[register] = value
            registers.written_at[register] = self.cycles
            if register in CONTROL_REGISTERS:
                self.commands.arrived(value)
        if inputs.others:
            take_outputs(inputs.others, self.digital, self.analog)
            self._take_slider(inputs.others)

    def _take_slider(self, values: Mapping[str, Any]) -> None:
        fraction = values.get("speed_slider_fraction", -1.0)
        if values.get("speed_slider_mask") and 0.0 <= fraction <= 1.0:
            self.slider = fraction

    def cycle(self) -> None:
        """Advances the controller by one cycle."""
        self.cycles += 1
        self.commands.cycle()
        self._follow_slider()
        self.execution.cycle()
        self.arm.brake(self.deceleration)
        self._check_limits()
        self.arm.finish_cycle()
        if self.arm.moves:
            self.moved_at = self.t
        self.history.append(self.arm.measured_q)
        self._move_world()

    def _follow_slider(self) -> None:
        if self.speed_scaling != self.slider:
            most = SCALING_PER_S * self.dt
            self.speed_scaling += min(most, max(-most, self.slider - self.speed_scaling))

    def _check_limits(self) -> None:
        arm = self.arm
        if self.safety.stopped or not any(arm.qd):
            return
        _, (vx, vy, vz, *_) = self.target_motion()
        why = self.limits.violation(arm.q, arm.qd, arm.qdd, (vx * vx + vy * vy + vz * vz) ** 0.5)
        if why:
            self.stops.protective(why)

    def target_motion(self) -> tuple[Transform, list[float]]:
        """Returns pose and twist of the TCP in the base, as commanded; computed once a cycle."""
        if self.target_at != self.cycles:
            self.target_at = self.cycles
            self.target = self.chain.motion(self.arm.q, self.arm.qd, self.tcp)
        return self.target

    def _move_world(self) -> None:
        t = self.t
        for at, bits in self.digital.cycle(t):
            self.output_changes.append((at, bits))
            self.gripper.output_changed(at, bits)
        self.world.cycle(t, self.dt)
        left_at = self.gripper.take_release(t)
        if left_at is not None:
            self.world.release(self.gripper.let_go(), left_at, self._object_state(t - left_at), t)
        self.gripper.rearm(self.arm.at_rest)

    def _object_state(self, back_s: float) -> tuple[float, ...]:
        """Returns position and velocity of the object in the world, `back_s` [s] ago: those of the true tool."""
        pose, twist = self.arm.true_at(min(back_s, self.dt), self.tool)
        b = self.base
        point = kinematics.product(b, pose)
        velocity = [b[r] * twist[0] + b[r + 1] * twist[1] + b[r + 2] * twist[2] for r in (0, 4, 8)]
        return (point[3], point[7], point[11], *velocity)

    def measured_before(self, steps: int) -> list[float]:
        """Returns the measured joint positions of `steps` cycles ago."""
        if not self.history:
            return self.arm.measured_q
        return self.history[-1 - min(max(steps, 0), len(self.history) - 1)]

    def in_contact(self) -> bool:
        """Returns whether the tool centre point is in the floor or in a keep-out box."""
        point = kinematics.product(self.base, self.chain.forward(self.arm.true_q, self.tool))
        return self.world.solid_at((point[3], point[7], point[11]))

    def solve(self, pose: list[float], near: list[float] | None = None) -> list[float] | None:
        """Returns the joint angles of the tool's pose nearest to `near` (default: the commanded ones), None if none."""
        near = list(self.arm.q) if near is None else near
        goal = kinematics.transform(pose)
        q = self.chain.solve(goal, near, self.tcp)
        if q is not None and self.limits.allows(q):
            return q
        found = inverse(self.cell.robot, _matrix(goal), X_FT=_matrix(self.tcp)).q
        if not len(found):
            return None
        return found[int(np.argmin(np.abs(found - near).max(axis=1)))].tolist()


def version_of(text: str) -> tuple[int, int, int]:
    """Returns the version numbers of "5.11.1" or "3.15"."""
    major, minor, bugfix = (*map(int, text.split(".")), 0)[:3]
    return major, minor, bugfix


def limits_of(cell: Cell, settings: Settings) -> SafetyLimits:
    """Returns the arm's own limits: the safety system knows nothing of the tighter ones of the cell file."""
    arm = cell.robot
    qd_max = (arm.qd_max + settings.joint_speed_tolerance_rad_s).tolist()
    qdd_max = (arm.qdd_max * ACCELERATION_SLACK).tolist()
    return SafetyLimits(arm.q_lower.tolist(), arm.q_upper.tolist(), qd_max, qdd_max, settings.tcp_speed_limit_m_s)


def _matrix(t: Transform) -> np.ndarray:
    return np.array([*t, 0.0, 0.0, 0.0, 1.0]).reshape(4, 4)
