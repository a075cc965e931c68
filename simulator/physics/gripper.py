"""The gripper: one digital output opens and closes it; the object leaves some time after the output changed."""

from __future__ import annotations

import random

from simulator.physics.outputs import OUTPUT_KINDS
from simulator.truth import GripperOpening

QUANTUM_S = 0.010  # [s] period of a gripper's own clock; source: the registers of Robotiq grippers change at 100 Hz
SKEW_SHAPE = 2.0  # chosen: shape of the gamma distribution of a skewed jitter; its skewness is 2 / sqrt(2)


class SimulatedGripper:
    """Starts closed on object 1; takes the next object when it is closed again and the arm stands.

    Attributes:
        holds: number of the held object, None while the gripper is empty.
        stuck: fault: the gripper does not open.
        release_at: controller time at which the object will leave [s], None if no release is due.
    """

    def __init__(self, output: str, index: int, open_level: bool, opening: GripperOpening, seed: int) -> None:
        """Starts closed.

        Args:
            output: kind of the output, a key of OUTPUT_KINDS.
            index: line within the kind.
            open_level: level that opens the gripper.
            opening: time from the change of the output to the object leaving.
            seed: of its random deviation.
        """
        self.mask = 1 << (OUTPUT_KINDS[output][0] + index)
        self.open_bits = self.mask if open_level else 0
        self.opening = opening
        self.openings = 0
        self.draw = random.Random(f"{seed} gripper")
        self.holds: int | None = 1
        self.objects = 1
        self.open = False
        self.stuck = False
        self.release_at: float | None = None

    @property
    def closed_bits(self) -> int:
        """Output bits that close the gripper."""
        return self.mask ^ self.open_bits

    def output_changed(self, t: float, bits: int) -> None:
        """Applies the physical output bits valid from `t` [s] on."""
        opened = bits & self.mask == self.open_bits
        if not opened:
            self.release_at = None  # closed again before the object was free: it stays
        if opened and not self.open and self.holds is not None and not self.stuck:
            self.release_at = t + max(0.0, self._delay())
        self.open = opened

    def _delay(self) -> float:
        """Returns the delay of this opening [s]; its mean is that of the truth, whatever the shape of the jitter."""
        opening = self.opening
        draw = self.draw
        mean = opening.delay_s + opening.drift_s_per_throw * self.openings
        self.openings += 1
        if opening.jitter_shape == "skewed":
            return mean + opening.jitter_s * (draw.gammavariate(SKEW_SHAPE, 1.0) - SKEW_SHAPE) / SKEW_SHAPE**0.5
        delay = mean + draw.gauss(0.0, opening.jitter_s)
        if opening.jitter_shape == "quantised":  # it opens at a tick of its own clock, which knows nothing of the arm's
            delay += draw.uniform(-0.5, 0.5) * QUANTUM_S
        return delay

    def take_release(self, t: float) -> float | None:
        """Returns when the object left, if it did so up to `t` [s]; the release is then no longer due."""
        if self.release_at is None or self.release_at > t:
            return None
        left_at = self.release_at
        self.release_at = None
        return left_at

    def let_go(self) -> int:
        """Empties the gripper; returns the number of the object it held."""
        number = self.objects
        self.holds = None
        return number

    def rearm(self, arm_stands: bool) -> None:
        """Inserts the next object if the gripper is closed and empty and the arm does not move to speak of."""
        if self.holds is None and not self.open and arm_stands:
            self.objects += 1
            self.holds = self.objects
