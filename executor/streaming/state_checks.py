"""Every reason to stop: the controller's state, a command out of bounds, a request from outside the loop.

Source of bits and states: Universal Robots, RTDE guide, `safety_status_bits`, `runtime_state`.
"""

from __future__ import annotations

import os
import signal
from time import monotonic
from types import FrameType

from executor.shared_memory import ABORT, DAEMON_PULSE, SharedMemory

NORMAL = 1  # safety_status_bits in normal operation
PLAYING = 2  # runtime_state of a running program
ROBOT_RUNNING = 7
POWER_ON = 4  # robot_mode in operation, and the lowest one of an arm with power
EMERGENCY_BITS = 1 << 5 | 1 << 6 | 1 << 7
SAFETY_WORDS = {
    1: "reduced mode",
    2: "protective stop",
    3: "recovery mode",
    4: "safeguard stop",
    5: "system emergency stop",
    6: "robot emergency stop",
    7: "emergency stop",
    8: "safety violation",
    9: "safety fault",
    10: "stopped for safety",
}
PROGRAM_WORDS = {0: "stopping", 1: "stopped", 3: "pausing", 4: "paused", 5: "resuming"}
OUTPUT_SHIFT = {"standard_digital": 0, "configurable_digital": 8, "tool_digital": 16}  # source: RTDE guide, output bits
SCALING_TOLERANCE = 1e-6  # [-] of the speed scaling around 1; rounding only
FROZEN = b"tTZXx"  # thread states stopped, traced, dead; source: proc_pid_stat(5)
STAT_BYTES = 256  # the state follows the name, of 16 bytes at most


class StreamFault(Exception):
    """The connection, the controller or the library cannot be trusted: the process never calls the library again.

    Attributes:
        outcome: one of `executor.stream_job.OUTCOMES`.
        reason: explanation for the operator.
    """

    def __init__(self, outcome: str, reason: str) -> None:
        super().__init__(f"{outcome}: {reason}")
        self.outcome = outcome
        self.reason = reason


def safety_words(safety_bits: int) -> str:
    """Returns what `safety_status_bits` say, in words; empty in normal operation."""
    if safety_bits == NORMAL:
        return ""
    words = [name for bit, name in SAFETY_WORDS.items() if safety_bits >> bit & 1]
    return ", ".join(words) or "safety state unknown"


def power_words(robot_mode: int) -> str:
    """Returns what `robot_mode` says of an arm without power, in words."""
    return f"the arm has no power (robot mode {robot_mode})"


def check_state(safety_bits: int, runtime_state: int, speed_scaling: float, robot_mode: int = ROBOT_RUNNING) -> None:
    """Checks for normal operation: no safety stop, power on, the program playing, full speed.

    Raises:
        StreamFault: for the first of safety state, power, program state and speed scaling that is wrong.
    """
    if safety_bits != NORMAL:
        outcome = "emergency_stop" if safety_bits & EMERGENCY_BITS else "protective_stop"
        raise StreamFault(outcome, safety_words(safety_bits))
    if robot_mode < POWER_ON:
        raise StreamFault("power_off", power_words(robot_mode))
    if runtime_state != PLAYING:
        raise StreamFault("aborted", f"the program on the controller is {PROGRAM_WORDS.get(runtime_state, 'unknown')}")
    if not abs(speed_scaling - 1.0) <= SCALING_TOLERANCE:  # also true for NaN
        raise StreamFault("aborted", f"speed scaling went to {speed_scaling:.3g}")


def check_command(values: list[float], limits: list[float]) -> None:
    """Checks that a command is six finite numbers within `limits`.

    Raises:
        StreamFault: it is not; this is a bug, and nothing more is sent.
    """
    if len(values) != 6:
        raise StreamFault("aborted", f"bug in Fling: a command has {len(values)} numbers, not 6")
    for joint, (value, limit) in enumerate(zip(values, limits, strict=True), 1):
        if not -limit <= value <= limit:  # also false for NaN
            raise StreamFault("aborted", f"bug in Fling: joint {joint} was commanded {value:.5g}, limit {limit:.5g}")


class StopRequests:
    """Requests from outside: abort flag, SIGTERM, a daemon frozen, dead or silent. A signal only sets a flag."""

    def __init__(self, memory: SharedMemory, daemon_silent_s: float, daemon: int, thread: int) -> None:
        """Opens the state of the daemon's pulse thread.

        Args:
            memory: shared with the daemon.
            daemon_silent_s: longest accepted silence of the daemon [s].
            daemon, thread: process and thread that write the pulse; a frozen one is noticed at the next tick.
        """
        self.fields = memory.fields
        self.daemon_silent_s = daemon_silent_s
        self.terminated = False
        self._stat = os.open(f"/proc/{daemon}/task/{thread}/stat", os.O_RDONLY)

    def listen(self) -> None:
        """Makes SIGTERM a request to stop from now on; ignores SIGINT."""
        signal.signal(signal.SIGTERM, self._terminate)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the daemon, which aborts in order

    def pending(self) -> tuple[str, str] | None:
        """Returns outcome and reason of a request to stop; None without one."""
        if self.fields[ABORT]:
            return "aborted", "abort requested"
        if self.terminated:
            return "executor_lost", "the executor ended"
        if self._is_daemon_frozen():
            return "executor_lost", "the executor was frozen"
        if monotonic() - self.fields[DAEMON_PULSE] > self.daemon_silent_s:
            return "executor_lost", f"the executor was silent for {self.daemon_silent_s * 1e3:.0f} ms"
        return None

    def _is_daemon_frozen(self) -> bool:
        try:
            stat = os.pread(self._stat, STAT_BYTES, 0)
        except ProcessLookupError:
            return True  # dead and reaped
        return stat[stat.rindex(b")") + 2] in FROZEN

    def _terminate(self, number: int, frame: FrameType | None) -> None:
        self.terminated = True
