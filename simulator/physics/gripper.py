"""The gripper: outputs or commands open and close it; the object leaves some time after the output changed."""

from __future__ import annotations

import random
from collections.abc import Callable

from planner.cell import Gripper
from simulator.physics.outputs import TIME_TOLERANCE_S, output_bit
from simulator.truth import GripperOpening

QUANTUM_S = 0.010  # [s] period of a gripper's own clock; source: the registers of Robotiq grippers change at 100 Hz
FINGERS_M_S = 0.150  # [m/s] of the opening between two fingers; source: Robotiq, data sheet of the 2F-85
ARRIVED_M = 1e-6  # [m] rounding
STICKS_S = 0.2  # chosen [s]: how much later an object leaves a cup that does not blow it off
SKEW_SHAPE = 2.0  # chosen: shape of the gamma distribution of a skewed jitter; its skewness is 2 / sqrt(2)


class SimulatedGripper:
    """Starts closed on object 1; takes the next object when it is closed again and the arm stands.

    Where objects have to be picked up it starts open instead, and has what its closing takes.

    Attributes:
        holds: number of the held object, None while the gripper is empty.
        stuck: fault: the gripper does not open.
        release_at: controller time at which the object will leave [s], None if no release is due.
        width_m: opening of its fingers [m].
        goal_m: opening to which they go, unless they hold an object [m].
    """

    def __init__(
        self,
        gripper: Gripper,
        object_m: float,
        opening: GripperOpening,
        seed: int | str,
        takes: Callable[[float], int | None] | None = None,
        place: int = 0,
        places: int = 1,
    ) -> None:
        """Starts closed, or open where objects have to be picked up.

        Args:
            gripper: of the cell file: its outputs, or its stroke.
            object_m: diameter of an object [m].
            opening: time from the change of the output to the object leaving.
            seed: of its random deviation.
            place, places: its number among the grippers of the tool, and theirs, which number objects in turn.
            takes: returns the number of the object that closing takes at a time [s], None for none; None: it always
                has the next one.
        """
        self.mask, self.open_bits = _lines(gripper)
        blows = gripper.kind == "vacuum" and gripper.second is not None
        self.blow_mask = output_bit(gripper.second.output, gripper.second.index) if blows and gripper.second else 0
        self.quantum_s = 0.0 if gripper.link is None else gripper.link.quantum_s
        self.stroke_m = 0.0 if gripper.link is None else gripper.link.stroke_m
        self.object_m = min(object_m, self.stroke_m)
        self.opening = opening
        self.openings = 0
        self.draw = random.Random(f"{seed} gripper")
        self.takes = takes
        self.holds: int | None = 1 + place if takes is None else None
        self.objects = 1 + place
        self.places = places
        self.open = takes is not None
        self.stuck = False
        self.release_at: float | None = None
        self.width_m = self.stroke_m if self.open else self.object_m
        self.goal_m = self.stroke_m if self.open else 0.0
        self._commands: list[tuple[float | None, bool, float]] = []  # (time [s], opens, goal [m]), still to come

    @property
    def first_bits(self) -> int:
        """Output bits at the start."""
        return self.open_bits if self.open else self.closed_bits

    @property
    def closed_bits(self) -> int:
        """Output bits that close the gripper."""
        return self.mask ^ self.open_bits

    def output_changed(self, t: float, bits: int) -> None:
        """Applies the physical output bits valid from `t` [s] on; between two of its lines it stays as it is."""
        if not self.mask:
            return
        if bits & self.mask == self.open_bits:
            self.obey(t, True, late_s=STICKS_S if self.blow_mask and not bits & self.blow_mask else 0.0)
        elif bits & self.mask == self.closed_bits:
            self.obey(t, False)

    def obey(self, t: float, opens: bool, late_s: float = 0.0) -> None:
        """Opens or closes from `t` [s] on; the object leaves its delay and `late_s` [s] later."""
        if not opens:
            self.release_at = None  # closed again before the object was free: it stays
        if not opens and self.open and self.holds is None and self.takes is not None:
            self.holds = self.takes(t)
        if opens and not self.open and self.holds is not None and not self.stuck:
            self.release_at = t + late_s + max(0.0, self._delay())
        self.open = opens

    def request(self, opens: bool, goal_m: float = 0.0) -> None:
        """Takes a command over a network or a bus, to be obeyed as late as an output that is switched now."""
        self._commands.append((None, opens, goal_m))

    def cycle(self, t: float, delay_s: float, dt: float) -> None:
        """Obeys what is due up to `t` [s] and moves the fingers; a command of this cycle is due at `t` + `delay_s`."""
        self._commands = [(t + delay_s if at is None else at, opens, goal) for at, opens, goal in self._commands]
        while self._commands and self._commands[0][0] is not None and self._commands[0][0] <= t + TIME_TOLERANCE_S:
            at, opens, self.goal_m = self._commands.pop(0)
            self.obey(at or t, opens)
        if not self.moves:
            return
        step = FINGERS_M_S * dt
        self.width_m += max(-step, min(step, self._target_m - self.width_m))

    @property
    def _target_m(self) -> float:
        """Where the fingers go, or stay: they close up to the object, and open once it is free."""
        if self.stuck or self.release_at is not None:
            return self.width_m
        return max(self.goal_m, self.object_m) if self.holds is not None else self.goal_m

    @property
    def moves(self) -> bool:
        """Whether the fingers are on their way."""
        return abs(self._target_m - self.width_m) > ARRIVED_M

    @property
    def is_busy(self) -> bool:
        """Whether a command is still to be obeyed, its object still to leave, or the fingers are on their way."""
        return bool(self._commands) or self.release_at is not None or self.moves

    def _delay(self) -> float:
        """Returns the delay of this opening [s]; its mean is that of the truth, whatever the shape of the jitter."""
        opening = self.opening
        draw = self.draw
        mean = opening.delay_s + opening.drift_s_per_throw * self.openings
        self.openings += 1
        if opening.jitter_shape == "skewed":
            return mean + opening.jitter_s * (draw.gammavariate(SKEW_SHAPE, 1.0) - SKEW_SHAPE) / SKEW_SHAPE**0.5
        delay = mean + draw.gauss(0.0, opening.jitter_s)
        quantum_s = QUANTUM_S if opening.jitter_shape == "quantised" else self.quantum_s
        if quantum_s > 0.0:  # it opens at a tick of its own clock, which knows nothing of the arm's
            delay += draw.uniform(-0.5, 0.5) * quantum_s
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
        number = self.holds
        assert number is not None
        self.holds = None
        return number

    def lose(self) -> int | None:
        """Fault: the object slips out of the closed fingers; returns its number, None where there is none."""
        lost = self.holds
        self.holds = None
        self.release_at = None
        return lost

    def rearm(self, arm_stands: bool) -> None:
        """Inserts the next object if the gripper is closed and empty and the arm does not move to speak of."""
        if self.takes is None and self.holds is None and not self.open and arm_stands:
            self.objects += self.places
            self.holds = self.objects


def _lines(gripper: Gripper) -> tuple[int, int]:
    """Returns the mask of the outputs that open and close a gripper, and their bits when it is open."""
    if gripper.link is not None and gripper.kind != "script":
        return 0, 0
    first = output_bit(gripper.output, gripper.index)
    mask = first
    bits = first if gripper.open_level else 0
    if gripper.kind == "digital" and gripper.second is not None:
        second = output_bit(gripper.second.output, gripper.second.index)
        mask |= second
        bits |= second if gripper.second.open_level else 0
    return mask, bits
