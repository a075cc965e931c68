"""Digital and analog outputs: commanded over RTDE or by a program, physically changed one lag later."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

SHIFT = {"standard_digital": 0, "configurable_digital": 8, "tool_digital": 16}  # source: RTDE guide, output bits
WIDTH = {"standard_digital": 8, "configurable_digital": 8, "tool_digital": 2}


class DigitalOutputs:
    """The output bits.

    A change that is obeyed in the cycle that ends at t was sent while the state of one cycle before was the newest;
    it happens `lag_s` after that: at t - dt + lag_s. So outputs and joint speeds share one latency.
    """

    def __init__(self, dt: float, lag_s: float, bits: int) -> None:
        self.delay_s = max(lag_s, dt) - dt
        self.bits = bits  # as they physically are
        self.commanded = bits
        self.requests: list[tuple[int, int]] = []  # (mask, bits) since the last cycle
        self.changes: deque[tuple[float, int]] = deque()  # (time, bits), still to come

    def request(self, kind: str, mask: int, value: int) -> None:
        """Asks for `value` on the lines of `mask` of one kind; obeyed in the next cycle."""
        mask &= (1 << WIDTH[kind]) - 1
        self.requests.append((mask << SHIFT[kind], (value & mask) << SHIFT[kind]))

    def cycle(self, t: float) -> list[tuple[float, int]]:
        """Obeys what was asked for; returns the physical changes (time, bits) up to `t` [s]."""
        for mask, value in self.requests:
            self.commanded = self.commanded & ~mask | value
            self.changes.append((t + self.delay_s, self.commanded))
        self.requests.clear()
        happened = []
        while self.changes and self.changes[0][0] <= t + 1e-9:
            happened.append(self.changes.popleft())
            self.bits = happened[-1][1]
        return happened


def take_outputs(values: Mapping[str, object], digital: DigitalOutputs, analog: list[float]) -> None:
    """Obeys the output part of an input package: digital lines under their masks, analog outputs."""
    for kind in SHIFT:
        mask = values.get(f"{kind}_output_mask")
        if isinstance(mask, int) and mask:
            digital.request(kind, mask, int(values.get(f"{kind}_output", 0)))  # pyright: ignore[reportArgumentType]
    mask = values.get("standard_analog_output_mask")
    for line in (0, 1):
        level = values.get(f"standard_analog_output_{line}")
        if isinstance(mask, int) and mask & (1 << line) and isinstance(level, float):
            analog[line] = level
