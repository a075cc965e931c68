"""The gripper: one digital output opens and closes it; some time after it opens, the object leaves."""

from __future__ import annotations

import random

from executor.simulator.outputs import SHIFT
from planner.cell import Gripper as GripperOfCell
from planner.cell import Sim


class Gripper:
    """Starts closed on an object. Holds a new one when it is closed again and the arm stands.

    Attributes:
        holds: number of the object in the gripper, None while it is empty.
        stuck: a fault: it does not open.
        release_at: controller time [s] at which the object will leave, None where none is about to.
    """

    def __init__(self, cell: GripperOfCell, sim: Sim, seed: int) -> None:
        self.mask = 1 << (SHIFT[cell.output] + cell.index)
        self.open_bits = self.mask if cell.open_level else 0
        self.delay_s, self.jitter_s = sim.gripper_delay_s, sim.gripper_jitter_s
        self.draw = random.Random(seed)
        self.holds: int | None = 1
        self.objects = 1
        self.open = False
        self.stuck = False
        self.release_at: float | None = None

    @property
    def closed_bits(self) -> int:
        """The output bits with which the gripper is closed."""
        return self.mask ^ self.open_bits

    def output_changed(self, t: float, bits: int) -> None:
        """Takes the physical output bits from `t` [s] on."""
        opened = bits & self.mask == self.open_bits
        if not opened:
            self.release_at = None  # closed again before the object was free: it is held
        if opened and not self.open and self.holds is not None and not self.stuck:
            self.release_at = t + max(0.0, self.delay_s + self.draw.gauss(0.0, self.jitter_s))
        self.open = opened

    def take_release(self, t: float) -> float | None:
        """Returns when the object left, if that was up to `t` [s]; the gripper is then empty."""
        if self.release_at is None or self.release_at > t:
            return None
        left_at, self.release_at = self.release_at, None
        return left_at

    def let_go(self) -> int:
        """Empties the gripper; returns the number of the object that was in it."""
        number, self.holds = self.objects, None
        return number

    def rearm(self, arm_at_rest: bool) -> None:
        """Puts a new object in where the gripper is closed, empty and the arm stands."""
        if self.holds is None and not self.open and arm_at_rest:
            self.objects += 1
            self.holds = self.objects
