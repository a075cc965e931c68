"""Digital and analog outputs of the controller: commanded at once, physically changed some time later."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Mapping
from typing import Any

from planner.cell import DigitalOutput
from simulator.truth import OutputTiming

CHANGES_MAX = 2000  # changes kept
TIME_TOLERANCE_S = 1e-9  # [s] rounding of a sum of times


# kind -> position of its first line among the output bits, number of lines; source: RTDE guide
OUTPUT_KINDS = {"standard_digital": (0, 8), "configurable_digital": (8, 8), "tool_digital": (16, 2)}


def output_bit(kind: str, index: int) -> int:
    """Returns the bit of one output line."""
    return 1 << OUTPUT_KINDS[kind][0] + index


class Outputs:
    """Output lines of the controller.

    A change obeyed in the cycle that ends at t was sent while the state of the cycle before was the newest. It happens
    `delay_s` after that state: at t - dt + delay_s.

    Attributes:
        bits: physical levels of the digital outputs.
        commanded: commanded levels of the digital outputs.
        changes: (time [s], bits) of the latest physical changes.
        analog: levels of the two analog outputs.
        stuck: fault: the digital outputs stay as they are, whatever they are told.
    """

    def __init__(self, dt: float, delay_s: float, bits: int) -> None:
        self.delay_s = delay_s - dt  # after the end of the cycle that obeys
        self.bits = self.commanded = bits
        self.changes: deque[tuple[float, int]] = deque(maxlen=CHANGES_MAX)
        self.analog = [0.0, 0.0]
        self.stuck = False
        self._requests: list[tuple[int, int]] = []  # (mask, bits) since the last cycle
        self._due: deque[tuple[float, int]] = deque()  # (time, bits), still to come

    def request(self, values: Mapping[str, Any]) -> None:
        """Takes the outputs of a data package; digital ones, under their masks, are obeyed in the next cycle."""
        for kind, (shift, width) in OUTPUT_KINDS.items():
            mask = values.get(f"{kind}_output_mask")
            if isinstance(mask, int) and mask:
                mask &= (1 << width) - 1
                self._requests.append((mask << shift, (int(values.get(f"{kind}_output", 0)) & mask) << shift))
        mask = values.get("standard_analog_output_mask")
        for line in (0, 1):
            level = values.get(f"standard_analog_output_{line}")
            if isinstance(mask, int) and mask & (1 << line) and isinstance(level, float):
                self.analog[line] = level

    def cycle(self, t: float) -> list[tuple[float, int]]:
        """Obeys the requests; returns the physical changes (time [s], bits) up to `t` [s]."""
        for mask, value in () if self.stuck else self._requests:
            self.commanded = self.commanded & ~mask | value
            self._due.append((t + self.delay_s, self.commanded))
        self._requests.clear()
        happened = []
        while self._due and self._due[0][0] <= t + TIME_TOLERANCE_S:
            happened.append(self._due.popleft())
            self.bits = happened[-1][1]
        self.changes.extend(happened)
        return happened


class SwitchedDevice:
    """What an output switches, such as a valve: it follows the output some time later; an input may be wired to it.

    Attributes:
        on: whether it is on.
        changes: (time [s], whether on) of its latest changes.
    """

    def __init__(self, output: DigitalOutput, timing: OutputTiming, bits: int, seed: str) -> None:
        """Starts as the output bits say; `seed` is of its delays."""
        self._bit = output_bit(output.output, output.index)
        self._input = 0 if output.sense_input is None else 1 << output.sense_input
        self._timing = timing
        self._draw = random.Random(seed)
        self._told = self.on = bool(bits & self._bit)
        self._due: deque[tuple[float, bool]] = deque()
        self.changes: deque[tuple[float, bool]] = deque(maxlen=CHANGES_MAX)

    def output_changed(self, at: float, bits: int) -> None:
        """Takes the output bits from a time on [s]; what was told first happens first."""
        told = bool(bits & self._bit)
        if told == self._told:
            return
        self._told = told
        due = at + max(self._draw.gauss(self._timing.delay_s, self._timing.jitter_s), 0.0)
        self._due.append((max(due, self._due[-1][0]) if self._due else due, told))

    def sensed(self, t: float, input_bits: int) -> int:
        """Changes as is due up to `t` [s]; returns the input bits with those of its wire, where it has changed."""
        while self._due and self._due[0][0] <= t + TIME_TOLERANCE_S:
            self.changes.append(self._due.popleft())
            self.on = self.changes[-1][1]
            input_bits = input_bits | self._input if self.on else input_bits & ~self._input
        return input_bits

    @property
    def input_bits(self) -> int:
        """Input bits at the start: that of its wire, where it is on."""
        return self._input if self.on else 0
