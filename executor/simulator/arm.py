"""The arm: the motion its controller commands, the true motion that follows, and what the encoders tell of it."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence

from executor.simulator.kinematics import Chain, Transform
from executor.simulator.lag import Lag

NOISE_TABLE = 8191  # noise samples drawn at the start; a prime, so six joints a cycle do not repeat soon
MOVING = 5e-3  # [rad/s] true speed above which the arm moves, as a person would say
AT_REST = 1e-9  # [rad/s] commanded speed below which the arm stands


class TwoMotions(Exception):
    """Two threads of a program moved the arm in one cycle."""


class Arm:
    """Commanded (`q qd qdd`), true (`true_q true_qd`) and measured (`measured_q measured_qd`) joint motion."""

    def __init__(self, chain: Chain, dt: float, q: Sequence[float], lag: Lag, noise: tuple[float, float], seed: int):
        """`noise`: standard deviations of the encoder's position [rad] and of the measured speed [rad/s]."""
        self.chain, self.dt, self.lag = chain, dt, lag
        self.q, self.qd, self.qdd = list(q), [0.0] * 6, [0.0] * 6
        self.true_q, self.true_qd = list(q), [0.0] * 6
        self.measured_q, self.measured_qd = self.true_q, self.true_qd
        draw = random.Random(seed)
        self.q_noise, self.qd_noise = ([draw.gauss(0.0, s) for _ in range(NOISE_TABLE)] * 2 for s in noise)
        self.draws = 0
        self.drives = 0
        self.before = self.q, self.qd, self.qdd  # commanded motion before this cycle's

    @property
    def at_rest(self) -> bool:
        """Whether the controller commands no motion and none is left in the lag."""
        return max(map(abs, self.qd)) < AT_REST and max(map(abs, self.true_qd)) < 1e-6

    @property
    def moves(self) -> bool:
        """Whether the arm truly moves."""
        return max(map(abs, self.true_qd)) > MOVING

    def drive(self, q: list[float], qd: list[float]) -> None:
        """Commands position and speed of the end of this cycle.

        Raises:
            TwoMotions: the arm was already driven in this cycle.
            ValueError: a position or speed that is not finite.
        """
        self.drives += 1
        if self.drives > 1:
            self.drives = 0
            self.q, self.qd, self.qdd = self.before  # neither of the two counts; the arm brakes
            raise TwoMotions
        if not math.isfinite(sum(q) + sum(qd)):
            raise ValueError("a motion that is not finite")
        self.before = self.q, self.qd, self.qdd
        self._set(q, qd)

    def ramp(self, qd: Sequence[float], acceleration: float) -> bool:
        """Drives towards a joint speed, linearly, the leading axis at `acceleration`; returns whether it is reached.

        The position advances with the mean of old and new speed: the speed runs linearly over the cycle.
        """
        now, reached = self._ramped(qd, acceleration)
        half = 0.5 * self.dt
        self.drive([x + half * (a + b) for x, a, b in zip(self.q, self.qd, now, strict=True)], now)
        return reached

    def _ramped(self, qd: Sequence[float], acceleration: float) -> tuple[list[float], bool]:
        change = [b - a for a, b in zip(self.qd, qd, strict=True)]
        largest = max(map(abs, change))
        most = acceleration * self.dt
        if largest <= most:
            return list(qd), True
        return [a + c * most / largest for a, c in zip(self.qd, change, strict=True)], False

    def brake(self, deceleration: float) -> None:
        """Ramps to rest where no motion was commanded in this cycle."""
        if self.drives:
            return
        if any(self.qd):
            self.ramp((0.0,) * 6, deceleration)
        else:
            self._set(self.q, self.qd)

    def finish_cycle(self) -> None:
        """Lets the true motion follow the command, and reads the encoders."""
        self.true_q, self.true_qd = self.lag.step(self.q, self.qd)
        at = self.draws
        self.draws = (at + 6) % NOISE_TABLE
        self.measured_q = [x + n for x, n in zip(self.true_q, self.q_noise[at : at + 6], strict=True)]
        self.measured_qd = [x + n for x, n in zip(self.true_qd, self.qd_noise[at : at + 6], strict=True)]
        self.drives = 0

    def true_at(self, back_s: float, tool: Transform) -> tuple[Transform, list[float]]:
        """Returns true pose and twist of the tool in the base, `back_s` [s] before the end of the last cycle."""
        q, qd = self.lag.before(back_s)
        return self.chain.motion(q, qd, tool)

    def _set(self, q: list[float], qd: list[float]) -> None:
        rate = 1.0 / self.dt
        self.qdd = [(b - a) * rate for a, b in zip(self.qd, qd, strict=True)]
        self.q, self.qd = q, qd
