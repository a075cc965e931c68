"""The controller: one `cycle()` runs the program, moves the arm, watches the limits, and lets the world go on."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from executor.simulator import commands, kinematics, safety
from executor.simulator.arm import Arm, TwoMotions
from executor.simulator.control_program import NAME, ControlProgram
from executor.simulator.gripper import Gripper
from executor.simulator.kinematics import Chain, Transform
from executor.simulator.lag import Lag
from executor.simulator.motions import MotionError, SuddenChange
from executor.simulator.outputs import DigitalOutputs, take_outputs
from executor.simulator.program import Program, ProgramError
from executor.simulator.registers import Registers
from executor.simulator.safety import Safety, SafetyLimits
from executor.simulator.settings import Settings
from executor.simulator.statistics import Commands
from executor.simulator.world import World
from planner.cell import Cell
from planner.kinematics import inverse

STOPPED, PLAYING, PAUSED = 1, 2, 4  # runtime_state; source: RTDE guide
HISTORY = 2000  # cycles of measured positions kept for get_actual_joint_positions_history
EVENTS_MAX = 500  # events kept
SCALING_PER_S = 5.0  # chosen: how fast the speed scaling follows the slider, full range a second
CONTROL_REGISTERS = (0, 24)  # integer registers that may carry the command number


class Controller:
    """State of the simulated controller; nothing here knows a socket or a clock."""

    def __init__(self, cell: Cell, settings: Settings) -> None:
        self.cell, self.settings = cell, settings
        self.version = version_of(cell.sim.polyscope)
        self.dt = 1.0 / cell.robot.sample_rate_hz
        self.cycles = 0
        self.chain = Chain(cell.robot)
        home = cell.home.tolist()
        lag = Lag(self.dt, cell.sim.lag_s, settings.first_order_s, home)
        noise = (settings.position_noise_rad, settings.velocity_noise_rad_s)
        self.arm = Arm(self.chain, self.dt, home, lag, noise, cell.sim.seed)
        self.gripper = Gripper(cell.gripper, cell.sim, cell.sim.seed)
        self.digital = DigitalOutputs(self.dt, cell.sim.lag_s, self.gripper.closed_bits)
        self.analog = [0.0, 0.0]
        self.world = World(cell, settings.restitution)
        self.tool = kinematics.from_matrix(cell.tool.X_FT)  # the true one
        self.base = kinematics.from_matrix(cell.X_WB)
        self.tcp: Transform = self.tool  # the one the controller believes in; set_tcp changes it
        self.payload_kg, self.payload_cog_m = cell.tool.mass_kg, [0.0, 0.0, 0.0]
        self.payload_inertia = [0.0] * 6
        self.gravity_m_s2 = (cell.X_WB[:3, :3].T @ np.array([0.0, 0.0, cell.surroundings.gravity_m_s2])).tolist()
        self.safety = Safety()
        self.limits = limits_of(cell, settings)
        self.registers = Registers()
        self.commands = Commands()
        self.program: Program | None = None
        self.runtime = STOPPED
        self.upload_due: tuple[int, str] | None = None
        self.watchdog: tuple[int, float] | None = None  # (register, longest silence [s])
        self.slider = self.speed_scaling = 1.0
        self.remote_control = True
        self.deceleration = settings.decelerations.program_end
        self.history: deque[list[float]] = deque(maxlen=HISTORY)
        self.output_changes: deque[tuple[float, int]] = deque(maxlen=HISTORY)
        self.events: deque[tuple[float, str]] = deque(maxlen=EVENTS_MAX)

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

    # -- what comes in
    def take_inputs(self, values: Mapping[str, Any]) -> None:
        """Obeys a data package: registers keep their values until overwritten, outputs and slider change."""
        registers = self.registers
        for name, value in values.items():
            if name.startswith("input_double_register_"):
                registers.double_in[int(name[22:])] = value
            elif name.startswith("input_int_register_"):
                index = int(name[19:])
                registers.int_in[index] = value
                registers.written_at[index] = self.cycles
                if index in CONTROL_REGISTERS:
                    self.commands.arrived(value)
        if "speed_slider_mask" in values:
            self._take_slider(values)
        elif "standard_digital_output_mask" in values or len(values) > 1:
            take_outputs(values, self.digital, self.analog)

    def _take_slider(self, values: Mapping[str, Any]) -> None:
        fraction = values.get("speed_slider_fraction", 1.0)
        if values["speed_slider_mask"] and 0.0 <= fraction <= 1.0:
            self.slider = fraction

    def upload(self, text: str) -> None:
        """Takes a script: replaces what runs, and starts a little later."""
        refusal = self._refusal(text)
        if refusal:
            self.note(f"script refused: {refusal}")
            return
        self.stop_program("replaced by a new script")
        self.upload_due = (self.cycles + round(self.settings.program_start_s / self.dt), text)
        self.note(f"script received, {len(text)} characters")

    def _refusal(self, text: str) -> str | None:
        if not self.safety.may_move:
            return f"the robot is not in normal operation ({self.safety.reason or 'not running'})"
        if not self.remote_control:
            return "the robot is in local control"
        if not text.lstrip().startswith(f"def {NAME}()"):
            return "compile error: this controller knows the program of ur_rtde only"
        return None

    # -- life of the program
    def _start_program(self, text: str) -> None:
        self.registers.clear_outputs()
        self.program = ControlProgram(self, text, commands.process)
        self.runtime = PLAYING
        self.note(f"program {self.program.name} runs")

    def stop_program(self, why: str) -> None:
        """Ends the program, if one runs; the arm brakes."""
        if self.program is not None:
            self.note(f"program stopped: {why}")
        self.program, self.watchdog = None, None
        self.runtime = STOPPED
        self.commands.ended()
        if not self.safety.stopped:
            self.deceleration = self.settings.decelerations.program_end

    def pause_program(self) -> bool:
        """Pauses the program; returns whether one was running."""
        if self.runtime != PLAYING:
            return False
        self.runtime = PAUSED
        self.commands.ended()
        if not self.safety.stopped:
            self.deceleration = self.settings.decelerations.program_end
        return True

    def resume_program(self) -> bool:
        """Lets a paused program go on; returns whether it does."""
        if self.runtime != PAUSED or not self.safety.may_move or not self.arm.at_rest:
            return False
        self.runtime = PLAYING
        return True

    def set_watchdog(self, register: int, frequency_hz: float) -> None:
        """Stops the program once `register` was not written for 1 / `frequency_hz` seconds; zero or less: never."""
        self.watchdog = (register, 1.0 / frequency_hz) if frequency_hz > 0.0 else None
        self.registers.written_at[register] = self.cycles

    # -- stops
    def protective_stop(self, why: str, runtime: str | None = None) -> None:
        """Category 2: the program is paused, or stopped, or (a fault of old) goes on `playing`."""
        if self.safety.stopped:
            return
        self.note(f"protective stop: {why}")
        self.safety.set(safety.MODE_PROTECTIVE_STOP, safety.PROTECTIVE_STOPPED, self.t, why)
        self.deceleration = self.settings.decelerations.protective_stop
        self._after_stop(runtime or self.settings.protective_stop_runtime)

    def safeguard_stop(self) -> None:
        """Category 2, from the safeguard input: the program is paused."""
        if self.safety.stopped:
            return
        self.note("safeguard stop")
        self.safety.set(safety.MODE_SAFEGUARD_STOP, safety.SAFEGUARD_STOPPED, self.t, "safeguard stop")
        self.deceleration = self.settings.decelerations.safeguard_stop
        self._after_stop("paused")

    def emergency_stop(self) -> None:
        """Category 1: power is taken away once the arm has braked; the program ends."""
        self.note("emergency stop")
        bits = safety.ROBOT_EMERGENCY | safety.EMERGENCY_STOPPED
        self.safety.set(safety.MODE_ROBOT_EMERGENCY_STOP, bits, self.t, "emergency stop")
        self.safety.robot_mode = safety.ROBOT_POWER_OFF
        self.deceleration = self.settings.decelerations.emergency_stop
        self._after_stop("stopped")

    def power_off(self) -> None:
        """Category 0: the brakes stop the arm; the program ends."""
        self.note("power off")
        self.safety.robot_mode = safety.ROBOT_POWER_OFF
        self.stop_program("power off")
        self.deceleration = self.settings.decelerations.power_loss

    def _after_stop(self, runtime: str) -> None:
        if runtime == "stopped":
            self.stop_program(self.safety.reason)
        elif runtime == "paused":
            self.pause_program()

    # -- one cycle
    def cycle(self) -> None:
        """Advances the controller by one cycle."""
        self.cycles += 1
        self.commands.cycle()
        self._start_upload()
        self._watch()
        self._follow_slider()
        if self.runtime == PLAYING and self.safety.may_move and self.program is not None:
            self._run(self.program)
        self.arm.brake(self.deceleration)
        self._check_limits()
        self.arm.finish_cycle()
        self.history.append(self.arm.measured_q)
        self._world()

    def _start_upload(self) -> None:
        if self.upload_due and self.cycles >= self.upload_due[0] and self.safety.may_move:
            text, self.upload_due = self.upload_due[1], None
            try:
                self._start_program(text)
            except ProgramError as error:
                self.note(f"script refused: {error}")

    def _watch(self) -> None:
        if self.watchdog is None or self.runtime != PLAYING:
            return
        register, silence = self.watchdog
        if (self.cycles - self.registers.written_at[register]) * self.dt > silence:
            self.stop_program("the RTDE watchdog expired")

    def _follow_slider(self) -> None:
        if self.speed_scaling != self.slider:
            most = SCALING_PER_S * self.dt
            self.speed_scaling += min(most, max(-most, self.slider - self.speed_scaling))

    def _run(self, program: Program) -> None:
        try:
            if not program.step():
                self.stop_program("it has come to its end")
        except TwoMotions:
            self.stop_program("another thread is already controlling the robot")
        except SuddenChange as change:
            self.protective_stop(str(change))
        except (ProgramError, MotionError, ArithmeticError, ValueError) as error:
            self.stop_program(f"runtime error: {error}")

    def _check_limits(self) -> None:
        arm = self.arm
        if not any(arm.qd) or self.safety.stopped:
            return
        self.target_pose, self.target_twist = self.chain.motion(arm.q, arm.qd, self.tcp)
        vx, vy, vz = self.target_twist[:3]
        why = self.limits.violation(arm.q, arm.qd, arm.qdd, (vx * vx + vy * vy + vz * vz) ** 0.5)
        if why:
            self.protective_stop(why)

    def _world(self) -> None:
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

    # -- what the program asks
    def measured_before(self, steps: int) -> list[float]:
        """Returns the measured joint positions of `steps` cycles ago."""
        if not self.history:
            return self.arm.measured_q
        return self.history[-1 - min(max(steps, 0), len(self.history) - 1)]

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
    qdd_max = (arm.qdd_max * 1.001).tolist()  # a ramp at the limit itself, rounded, is no violation
    return SafetyLimits(arm.q_lower.tolist(), arm.q_upper.tolist(), qd_max, qdd_max, settings.tcp_speed_limit_m_s)


def _matrix(t: Transform) -> np.ndarray:
    return np.array([*t, 0.0, 0.0, 0.0, 1.0]).reshape(4, 4)
