"""Controller states that end a run, and commands that are never sent."""

from __future__ import annotations

import math

import pytest

from executor.streaming.safety import StreamFault, check_command, check_state

LIMITS = [3.0] * 6


def test_normal_operation_passes() -> None:
    check_state(1, 2, 1.0)
    check_command([3.0, -3.0, 0.0, 0.0, 0.0, 0.0], LIMITS)


@pytest.mark.parametrize(
    ("bits", "runtime", "scaling", "outcome", "word"),
    [
        (1 << 2 | 1 << 10, 4, 1.0, "protective_stop", "protective stop"),
        (1 << 2 | 1 << 10, 2, 1.0, "protective_stop", "protective stop"),  # though the program goes on playing
        (1 << 4, 2, 1.0, "protective_stop", "safeguard stop"),
        (1 | 1 << 1, 2, 1.0, "protective_stop", "reduced mode"),
        (1 << 6 | 1 << 7 | 1 << 10, 1, 1.0, "emergency_stop", "robot emergency stop"),
        (1 << 5, 2, 1.0, "emergency_stop", "system emergency stop"),
        (0, 2, 1.0, "protective_stop", "unknown"),
        (1, 1, 1.0, "aborted", "stopped"),
        (1, 4, 1.0, "aborted", "paused"),
        (1, 2, 0.5, "aborted", "speed scaling"),
        (1, 2, math.nan, "aborted", "speed scaling"),
    ],
)
def test_anything_else_ends_the_run(bits: int, runtime: int, scaling: float, outcome: str, word: str) -> None:
    with pytest.raises(StreamFault) as caught:
        check_state(bits, runtime, scaling)
    assert caught.value.outcome == outcome
    assert word in caught.value.reason


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 3.0001, -3.0001])
def test_a_command_out_of_bounds_is_never_sent(bad: float) -> None:
    with pytest.raises(StreamFault):
        check_command([0.0, 0.0, bad, 0.0, 0.0, 0.0], LIMITS)


@pytest.mark.parametrize("count", [0, 5, 7])
def test_a_command_of_another_length_is_never_sent(count: int) -> None:
    with pytest.raises(StreamFault):
        check_command([0.0] * count, LIMITS)
