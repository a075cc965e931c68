"""What the controller says of itself, as a fault where it is not normal operation.

Source of bits and states: Universal Robots, RTDE guide, `safety_status_bits`, `runtime_state`.
"""

from __future__ import annotations

from executor.streaming.fault import LinkFault

NORMAL = 1  # safety_status_bits in normal operation
PLAYING = 2  # runtime_state of a running program
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
SCALING_TOLERANCE = 1e-6  # [-] of the speed scaling around 1; rounding only


def check(safety_bits: int, runtime_state: int, speed_scaling: float) -> None:
    """Raises where the controller is not in normal operation, running our program at full speed.

    Raises:
        LinkFault: safety state first, then speed scaling, then the program's state.
    """
    if safety_bits != NORMAL:
        words = [name for bit, name in SAFETY_WORDS.items() if safety_bits >> bit & 1]
        outcome = "emergency_stop" if safety_bits & EMERGENCY_BITS else "protective_stop"
        raise LinkFault(outcome, ", ".join(words) or "safety state unknown")
    if runtime_state != PLAYING:
        raise LinkFault("aborted", f"the program on the controller is {PROGRAM_WORDS.get(runtime_state, 'unknown')}")
    if not abs(speed_scaling - 1.0) <= SCALING_TOLERANCE:  # true for NaN too
        raise LinkFault("aborted", f"speed scaling went to {speed_scaling:.3g}")


def check_command(values: list[float], limits: list[float]) -> None:
    """Raises where a command is not six finite numbers within `limits`.

    Raises:
        LinkFault: it must not be sent; this is a bug, so nothing more is sent either.
    """
    if len(values) != 6:
        raise LinkFault("aborted", f"a command of {len(values)} numbers")
    for value, limit in zip(values, limits, strict=True):
        if not -limit <= value <= limit:  # false for NaN too
            raise LinkFault("aborted", f"a command of {value!r} against a limit of {limit!r}")
