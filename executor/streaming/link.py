"""The link: the only module that touches ur_rtde.

Every call is judged: an exception, a False, or more than 5 ms ends the run for good, because after a lost connection
the library answers True for ever, reconnects by itself and resumes (reference: rtde.md, sections 10 to 12). Long calls
count only where the library slept in them, as it does to reconnect: in others the machine had stalled.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable
from time import monotonic, sleep
from typing import Any

from rtde_control import RTDEControlInterface
from rtde_io import RTDEIOInterface
from rtde_receive import RTDEReceiveInterface

from executor.board import IN_CALL, Board
from executor.job import Job
from executor.streaming import realtime, safety
from executor.streaming.fault import LinkFault

CALL_MAX_S = 0.005  # [s] a real-time call takes 30 us; one that reconnects in secret takes 160 ms (rtde.md, section 10)
WATCHDOG_HZ = 40.0  # [Hz] 25 ms, just beyond the 20 ms after which the loop itself gives up as late
WATCHDOG_ORDINARY_HZ = 20.0  # [Hz] 50 ms, likewise beyond the 40 ms borne without real-time scheduling
VARIABLES = [
    "timestamp",
    "actual_q",
    "actual_qd",
    "actual_current",
    "safety_status_bits",
    "runtime_state",
    "speed_scaling",
    "target_speed_fraction",
    "actual_digital_output_bits",
]
SERVO_LOOKAHEAD_S = 0.03  # source: URScript manual, servoj, the smallest lookahead time
SERVO_GAIN = 500.0  # source: URScript manual, servoj, between its 100 and 2000; the time constant is then two CB3 ticks
SERVO_CONSTANT_S = SERVO_LOOKAHEAD_S * 300.0 / SERVO_GAIN  # [s] at gain 300 the lookahead time is the time constant
REST_RAD_S = 0.01  # [rad/s] source: faults.md, C6; the noise of a measured joint speed is below it
REST_WITHIN_S = 1.0  # [s] then it is told as it is
STOP_DECELERATION = 20.0  # [rad/s^2] of speedStop at the end, where only rounding is left to stop


class Link:
    """Fresh interfaces to one controller, for one execution.

    Attributes:
        stamp: controller time of the newest state read [s].
        q, qd, current: measured, of that state.
        delayed_s: time this thread waited for a processor between the last two readings [s].
        call_s: how long the last command took [s].
        sent_at: when, by the monotonic clock [s].
    """

    def __init__(self, job: Job, board: Board) -> None:
        """Connects.

        Raises:
            LinkFault: nobody listens, the script is refused, another client owns the registers.
        """
        self.job, self.words = job, board.words
        self._stat = os.open(f"/proc/self/task/{threading.get_native_id()}/schedstat", os.O_RDONLY)
        self._waited = 0
        try:
            self.receive = RTDEReceiveInterface(job.host, 1.0 / job.dt, VARIABLES)
            self.control = None if job.dry_run else RTDEControlInterface(job.host, 1.0 / job.dt)
            self.io = None if job.dry_run else RTDEIOInterface(job.host)
        except (RuntimeError, ValueError) as error:
            raise LinkFault("refused", f"connecting: {error}") from error
        realtime.no_delay()
        self.send_output = (
            None
            if self.io is None
            else {
                "tool_digital": self.io.setToolDigitalOut,
                "standard_digital": self.io.setStandardDigitalOut,
                "configurable_digital": self.io.setConfigurableDigitalOut,
            }[job.output]
        )
        self.read()

    def timestamp(self) -> float:
        """Returns the newest controller time [s]."""
        return self.receive.getTimestamp()

    def read(self) -> None:
        """Reads one consistent state, and judges nothing but the connection.

        Raises:
            LinkFault: a connection is gone.
        """
        before, self._waited = self._waited, self._run_delay_ns()
        self.delayed_s = (self._waited - before) * 1e-9
        receive = self.receive
        if not receive.isConnected() or (self.control is not None and not self.control.isConnected()):
            raise LinkFault("link_lost", "the connection to the controller is gone")
        while True:  # a package may arrive between two getters: read again, at most once in practice
            self.stamp = receive.getTimestamp()
            self.q, self.qd, self.current = receive.getActualQ(), receive.getActualQd(), receive.getActualCurrent()
            self.safety_bits, self.runtime_state = receive.getSafetyStatusBits(), receive.getRuntimeState()
            self.scaling = receive.getSpeedScalingCombined()
            self.outputs = receive.getActualDigitalOutputBits()
            if receive.getTimestamp() == self.stamp:
                return

    def check(self) -> None:
        """Judges the state just read.

        Raises:
            LinkFault: not in normal operation.
        """
        runtime = safety.PLAYING if self.control is None else self.runtime_state
        safety.check(self.safety_bits, runtime, self.scaling)

    def move(self, q: list[float]) -> None:
        """Starts a straight joint move to `q` (6,) [rad] and returns while it goes on."""
        job = self.job
        if self.control is not None:
            self._answer("moveJ", self.control.moveJ(q, job.approach_speed, job.approach_acceleration, True))

    def stop_move(self) -> None:
        """Ends a move before its goal; returns at rest."""
        if self.control is not None:
            self.control.stopJ(self.job.approach_acceleration)

    def arm_watchdog(self, realtime: bool) -> None:
        """From now on, and once only, the controller stops the program where commands stay out."""
        if self.armed:
            return
        self.armed = True
        self.watchdog_hz = self.job.watchdog_hz or (WATCHDOG_HZ if realtime else WATCHDOG_ORDINARY_HZ)
        if self.control is not None:
            self._answer("setWatchdog", self.control.setWatchdog(self.watchdog_hz))

    def speed(self, qd: list[float]) -> None:
        """Sends joint speeds (6,) [rad/s] for the next tick."""
        safety.check_command(qd, self.job.qd_max)
        if self.control is not None:
            self._real_time("speedJ", self.control.speedJ, qd, self.job.acceleration, self.job.dt)

    def servo(self, q: list[float], limits: list[float]) -> None:
        """Sends joint positions (6,) [rad] for the next tick; `limits` as for `safety.check_command`."""
        safety.check_command(q, limits)
        if self.control is not None:
            self._real_time("servoJ", self.control.servoJ, q, 0.0, 0.0, self.job.dt, SERVO_LOOKAHEAD_S, SERVO_GAIN)

    def output(self, level: bool) -> None:
        """Sets the gripper's output."""
        if self.send_output is not None:
            self._real_time("the digital output", self.send_output, self.job.output_index, level)

    def end_speeds(self) -> None:
        """Ends a stream of speeds at rest, so that another kind of motion may follow."""
        if self.control is not None:
            self._answer("speedStop", self.control.speedStop(STOP_DECELERATION))

    def stop(self) -> None:
        """Ends the stream at rest, and the program with it: the only way to disarm the watchdog."""
        if self.control is None:
            return
        if self.job.mode == "servoj":
            self.control.servoStop()
        else:
            self.control.speedStop(STOP_DECELERATION)
        self.control.stopScript()
        self._await_rest()

    def _await_rest(self) -> None:
        """Returns once the arm is measured at rest: it may follow the commands later than the cell says."""
        end = monotonic() + REST_WITHIN_S
        while max(map(abs, self.qd)) > REST_RAD_S and monotonic() < end:
            sleep(self.job.dt)
            self.read()

    def _real_time(self, name: str, call: Callable[..., Any], *args: Any) -> None:
        self.words[IN_CALL] = 1.0
        slept = realtime.sleeps()
        begin = monotonic()
        try:
            answer = call(*args)
        except RuntimeError as error:
            raise LinkFault("link_lost", f"{name}: {error}") from error
        self.call_s = spent = monotonic() - begin
        self.words[IN_CALL] = 0.0
        self.sent_at = begin
        self._answer(name, answer)
        if spent > CALL_MAX_S and realtime.sleeps() > slept and self._without_delay(spent) > CALL_MAX_S:
            raise LinkFault("link_lost", f"{name} took {spent * 1e3:.1f} ms")

    def _answer(self, name: str, answer: Any) -> None:
        if answer is not True:
            self.read()
            self.check()
            raise LinkFault("link_lost", f"{name} was refused")

    def _without_delay(self, spent: float) -> float:
        """Returns a duration that ends now, without what this thread waited for a processor in it [s]."""
        return spent - (self._run_delay_ns() - self._waited) * 1e-9

    def _run_delay_ns(self) -> int:
        """Returns how long this thread was ready to run and had no processor [ns]: not the library's fault."""
        return int(os.pread(self._stat, 64, 0).split()[1])

    call_s = 0.0
    sent_at = math.inf
    watchdog_hz = WATCHDOG_HZ
    armed = False
