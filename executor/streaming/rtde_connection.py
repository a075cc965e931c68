"""The connection to the controller: the only module that uses ur_rtde.

Every call is checked: an exception, a False, or a call over 5 ms ends the run for good. After a lost connection the
library returns True for ever, reconnects by itself and resumes (measured with ur_rtde 1.6.5); a new socket in the place
of one of the first shows it. A long call counts only if the library slept in it, as it does to reconnect; otherwise the
machine stalled. A call that hangs is ended with the process, by a signal that needs neither this thread nor the daemon:
reconnected, the library would repeat its command in a program without a watchdog.
"""

from __future__ import annotations

import math
import signal
from collections.abc import Callable
from time import monotonic, sleep
from typing import Any, NamedTuple

from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

from executor.realtime import RunDelay, sleep_count
from executor.shared_memory import IN_CALL, REALTIME, SharedMemory
from executor.stream_job import StreamJob
from executor.streaming import state_checks
from executor.streaming.controller_inputs import ControllerInputs
from executor.streaming.gripper_port import gripper_port
from executor.streaming.library_sockets import LibrarySockets
from executor.streaming.state_checks import StreamFault
from planner import controller_program as registers

# [s] within a real-time call after which the kernel ends this process: the watchdog has stopped the arm by then, and it
# would move again where the library came to its own end of the call, which reconnects and starts its program anew
HANGS_S = 0.050
CALL_MAX_S = 0.005  # [s] a real-time call takes 30 us, one that reconnects itself takes 160 ms (ur_rtde 1.6.5)
WATCHDOG_HZ = 50.0  # [Hz] 20 ms, just above the 16 ms after which the loop itself gives up as late
WATCHDOG_ORDINARY_HZ = 20.0  # [Hz] 50 ms, just above the 40 ms accepted without real-time scheduling
SHOWN_S = 0.040  # [s] for a state to arrive that is as new as one that has arrived over another connection
SHOWN_POLL_S = 5e-4
SILENT_S = 0.036  # [s] of states, without a package over the connection for outputs: five of a CB3, as of its states
VARIABLES = [
    "timestamp",
    "actual_q",
    "actual_qd",
    "actual_current",
    "target_qd",
    "safety_status_bits",
    "runtime_state",
    "robot_mode",
    "speed_scaling",
    "target_speed_fraction",
    "actual_digital_output_bits",
    "actual_digital_input_bits",
]
PROGRAM_OUTPUTS = (registers.ROW, registers.BRAKE_ROW, registers.SWITCHED_ROW, registers.END, registers.RUN)
SERVO_LOOKAHEAD_S = 0.03  # source: URScript manual, servoj, the smallest lookahead time
SERVO_GAIN = 500.0  # source: URScript manual, servoj, between its 100 and 2000; the time constant is then two CB3 ticks
POSITION_LIMITS = [2.0 * math.pi] * 6  # [rad] source: UR joint range; tighter ones are checked by the certificate
SERVO_CONSTANT_S = SERVO_LOOKAHEAD_S * 300.0 / SERVO_GAIN  # [s] at gain 300 the lookahead time is the time constant
REST_RAD_S = 0.01  # [rad/s] an arm this slow counts as at rest; above the noise of a measured joint speed
REST_WITHIN_S = 1.0  # [s] longest wait for the measured rest at the end
STOP_DECELERATION = 20.0  # [rad/s^2] of the final speedStop, where only rounding is left to stop


class ProgramState(NamedTuple):
    """What a program in the controller publishes; see `planner.controller_program`."""

    row: int
    brake_row: int
    switched_row: int
    end: int
    run: int


class RtdeConnection:
    """Fresh connections to one controller, for one execution.

    A motion that runs inside the controller has no control interface, and with it no program of ur_rtde's.

    Attributes:
        stamp: controller time of the newest state [s].
        q, qd, current: measured (6,), of that state [rad, rad/s, A].
        target_qd: joint speeds (6,) that the controller commands, of that state [rad/s].
        safety_bits, runtime_state, robot_mode, scaling, outputs, inputs: of that state; as in the RTDE guide.
        program: what a motion inside the controller publishes, of that state; None where it is streamed.
        plays: whether a program of ours is to play.
        delayed_s: time this thread waited for a processor between the last two readings [s].
        call_s: duration of the last command [s].
        sent_at: monotonic time at which the last command of a motion began, at first that of arming the watchdog [s].
        watchdog_hz: lowest command rate accepted by the controller [Hz].
        writer: what switches outputs and keeps a program alive; None in a dry run.
        gripper: what this run tells its gripper through.
    """

    call_s = delayed_s = 0.0
    sent_at = math.inf
    stamp = math.nan
    _unheard_s = 0.0
    watchdog_hz = WATCHDOG_HZ

    def __init__(self, job: StreamJob, memory: SharedMemory) -> None:
        """Connects.

        Raises:
            StreamFault: no connection, the script is refused, or another client owns the registers.
        """
        self.job = job
        self.memory = memory
        self._run_delay = RunDelay()
        self._delay_s = 0.0
        self.in_controller = bool(job.program)
        self.program: ProgramState | None = None
        variables = VARIABLES
        if self.in_controller:
            variables = VARIABLES + [f"output_int_register_{number}" for number in PROGRAM_OUTPUTS]
        try:
            self.receive = RTDEReceiveInterface(job.host, 1.0 / job.dt, variables)
            self.writer = None if job.dry_run else ControllerInputs(job.host, 1.0 / job.dt, self.in_controller)
            streams = not (job.dry_run or self.in_controller)
            self.control = RTDEControlInterface(job.host, 1.0 / job.dt) if streams else None
        except (RuntimeError, ValueError, OSError) as error:
            raise StreamFault("refused", f"connecting: {error}") from error
        self.plays = self.control is not None
        self._sockets = LibrarySockets()
        interfaces = sum(each is not None for each in (self.receive, self.writer, self.control))  # one connection each
        if self._sockets.count < interfaces:
            reason = f"{self._sockets.count} of {interfaces} RTDE connections are open right after connecting"
            raise StreamFault("refused", reason)
        self.gripper = gripper_port(self)
        self.read()
        self._await_program()

    def _await_program(self) -> None:
        """Waits until the states show the program that the control interface has seen start, over another connection.

        Where they do not soon, it has been stopped since: `check` says so.
        """
        end = monotonic() + SHOWN_S
        while self.plays and self.runtime_state != state_checks.PLAYING and monotonic() < end:
            sleep(SHOWN_POLL_S)
            self.read()

    def timestamp(self) -> float:
        """Returns the newest controller time [s]."""
        return self.receive.getTimestamp()

    def read(self) -> None:
        """Reads one consistent state into the attributes.

        Raises:
            StreamFault: a connection is lost.
        """
        delay_s = self._run_delay.total_s()
        self.delayed_s = delay_s - self._delay_s
        self._delay_s = delay_s
        receive = self.receive
        if not receive.isConnected() or (self.control is not None and not self.control.isConnected()):
            raise StreamFault("link_lost", "the connection to the controller is gone")
        if self._sockets.were_replaced():
            raise StreamFault("link_lost", "a connection to the controller was closed, or replaced by the library")
        before = self.stamp
        while True:  # a package may arrive between two getters: read again, at most once in practice
            self.stamp = receive.getTimestamp()
            self.q, self.qd, self.current = receive.getActualQ(), receive.getActualQd(), receive.getActualCurrent()
            self.target_qd = receive.getTargetQd()
            self.safety_bits, self.runtime_state = receive.getSafetyStatusBits(), receive.getRuntimeState()
            self.robot_mode = receive.getRobotMode()
            self.scaling = receive.getSpeedScalingCombined()
            self.outputs = receive.getActualDigitalOutputBits()
            self.inputs = receive.getActualDigitalInputBits()
            if self.in_controller:
                self.program = ProgramState(*map(receive.getOutputIntRegister, PROGRAM_OUTPUTS))
            if receive.getTimestamp() == self.stamp:
                break
        if self.writer is not None:
            self._listen(self.writer, is_new=self.stamp != before)

    def _listen(self, writer: ControllerInputs, is_new: bool) -> None:
        """Checks that the controller still sends over the connection for outputs, too, where it sent a new state.

        Counted in states: a controller that compiles a program sends nothing for tens of milliseconds, over neither.

        Raises:
            StreamFault: the connection is lost.
        """
        try:
            heard = writer.heard()
        except OSError as error:
            raise StreamFault("link_lost", f"the connection that switches outputs is lost: {error}") from error
        self._unheard_s = 0.0 if heard else self._unheard_s + is_new * self.job.dt
        if self._unheard_s >= SILENT_S:
            silent = f"silent for {1e3 * self._unheard_s:.0f} ms, while states came"
            raise StreamFault("link_lost", f"the connection that switches outputs has been {silent}")

    def check(self) -> None:
        """Checks the state last read.

        Raises:
            StreamFault: the controller is not in normal operation.
        """
        runtime = self.runtime_state if self.plays else state_checks.PLAYING
        state_checks.check_state(self.safety_bits, runtime, self.scaling, self.robot_mode)

    def arm_watchdog(self) -> None:
        """Makes the controller stop the program, and with it the arm, once commands stop arriving."""
        chosen_hz = WATCHDOG_HZ if self.memory.fields[REALTIME] else WATCHDOG_ORDINARY_HZ
        self.watchdog_hz = self.job.watchdog_hz or chosen_hz
        if self.control is not None:
            begin = monotonic()
            self._check_answer("setWatchdog", _called("setWatchdog", self.control.setWatchdog, self.watchdog_hz))
            self.sent_at = begin

    def speed(self, qd: list[float]) -> None:
        """Sends joint speeds (6,) [rad/s] for the next tick."""
        state_checks.check_command(qd, self.job.qd_max)
        if self.control is not None:
            self.sent_at = self._command("speedJ", self.control.speedJ, qd, self.job.acceleration, self.job.dt)

    def servo(self, q: list[float], limits: list[float]) -> None:
        """Sends joint positions (6,) [rad] for the next tick; `limits` as for `state_checks.check_command`."""
        state_checks.check_command(q, limits)
        if self.control is not None:
            call = self.control.servoJ
            self.sent_at = self._command("servoJ", call, q, 0.0, 0.0, self.job.dt, SERVO_LOOKAHEAD_S, SERVO_GAIN)

    def output(self, kind: str, index: int, level: bool) -> None:
        """Sets a digital output."""
        if self.writer is not None:
            self._command("the digital output", self.writer.set_output, kind, index, level)

    def beat(self, number: int, request: int) -> None:
        """Raises the heartbeat of a program in the controller, and says what is asked of it."""
        if self.writer is not None:
            self._command("the heartbeat", self.writer.set_register, registers.HEARTBEAT, number)
            self._command("a request", self.writer.set_register, registers.REQUEST, request)

    def end_speeds(self) -> None:
        """Ends a stream of speeds at rest, so that another kind of motion may follow."""
        if self.control is not None:
            self._check_answer("speedStop", _called("speedStop", self.control.speedStop, STOP_DECELERATION))

    def stop(self) -> None:
        """Ends the stream at rest, and the program with it: the only way to disarm the watchdog."""
        if self.job.dry_run:
            return
        if self.control is not None:
            if self.job.mode == "servoj":
                _called("servoStop", self.control.servoStop)
            else:
                _called("speedStop", self.control.speedStop, STOP_DECELERATION)
            _called("stopScript", self.control.stopScript)
        self.wait_for_rest()

    def wait_for_rest(self) -> None:
        """Returns at measured rest: the arm may lag behind the commands by more than the cell states."""
        end = monotonic() + REST_WITHIN_S
        while max(map(abs, self.qd)) > REST_RAD_S and monotonic() < end:
            sleep(self.job.dt)
            self.read()

    def part(self) -> None:
        """Ends the connections, once all that was sent has arrived.

        Raises:
            StreamFault: it has not, and is dropped.
        """
        if not self._sockets.close_in_order():
            raise StreamFault("link_lost", "the last commands of the run have not arrived at the controller")

    def _command(self, name: str, call: Callable[..., Any], *args: Any) -> float:
        """Makes one real-time call and checks its answer and its duration; one that hangs is this process's end.

        Returns:
            The monotonic time at which it began [s].
        """
        self.memory.fields[IN_CALL] = 1.0
        slept = sleep_count()
        begin = monotonic()
        if self.control is not None:
            signal.setitimer(signal.ITIMER_REAL, HANGS_S)
        try:
            answer = _called(name, call, *args)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        self.call_s = spent = monotonic() - begin
        self.memory.fields[IN_CALL] = 0.0
        self._check_answer(name, answer)
        if spent > CALL_MAX_S and sleep_count() > slept and self._without_delay(spent) > CALL_MAX_S:
            raise StreamFault("link_lost", f"{name} took {spent * 1e3:.1f} ms")
        return begin

    def _check_answer(self, name: str, answer: Any) -> None:
        if answer is not True:
            self.read()
            self.check()
            raise StreamFault("link_lost", f"{name} was refused")

    def _without_delay(self, spent: float) -> float:
        """Returns a duration that ends now, less the time this thread waited for a processor [s]."""
        return spent - (self._run_delay.total_s() - self._delay_s)


def _called(name: str, call: Callable[..., Any], *args: Any) -> Any:
    """Returns the answer of a call.

    Raises:
        StreamFault: the connection failed meanwhile.
    """
    try:
        return call(*args)
    except (RuntimeError, OSError) as error:
        raise StreamFault("link_lost", f"{name}: {error}") from error
