"""What a joint does beyond its command: it overshoots, scatters in proportion to its speed, and is taken back.

A joint runs ahead of its command by a share s of the commanded speed u, and its own position control takes the lead x
back within a time T: x' = s u - x / T. With a constant share this is a lead element: it exceeds a step of the speed by
that share, which dies away with T, and a ramp of duration L by s T/L (1 - exp(-L/T)) of its end. At rest x is zero, so
the arm stands where it is commanded to.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

RECOVERY_S = 0.2  # [s] chosen: T; the recordings of the real UR5 tell the lead at the peak, not how long it lasts
AT_REST_RAD_S = 1e-6  # [rad/s] a lead that is taken back this slowly has vanished
IDLE_S = 0.6  # [s] without motion, longer than any lag, after which the next motion is a new run


@dataclass(frozen=True)
class Scatter:
    """Random part of the response, different in every run.

    Attributes:
        speed_share: standard deviation of the share s [-].
        correlation_s: time within which it forgets itself [s]; an Ornstein–Uhlenbeck process.
        lag_std_s: standard deviation of the lag from run to run [s].
    """

    speed_share: float
    correlation_s: float
    lag_std_s: float


NO_SCATTER = Scatter(0.0, 1.0, 0.0)


class Overshoot:
    """The lead of six joints over their commands.

    Attributes:
        lag_later_s: deviation of the lag in the present run [s].
        began: whether a new run began in the last cycle.
    """

    def __init__(self, dt: float, share: Sequence[float], scatter: Scatter, seed: str) -> None:
        """Starts at rest.

        Args:
            dt: cycle time [s].
            share: constant part of s, a joint (6,) [-].
            scatter: random part of it.
            seed: of the random numbers.
        """
        self.share = list(share)
        self.scatter = scatter
        self.draw = random.Random(seed)
        self.decay = math.exp(-dt / RECOVERY_S)
        self.bend = RECOVERY_S / dt
        self.keeps = math.exp(-dt / scatter.correlation_s)
        self.renews = scatter.speed_share * math.sqrt(1.0 - self.keeps**2)
        self.deviations = [self._deviation() for _ in share]
        self.ahead = [0.0] * 6  # s u of the last cycle [rad/s]
        self.taken_back = [0.0] * 6  # x / T [rad/s]
        self.idle_cycles = self.idle_enough = math.ceil(IDLE_S / dt)
        self.began = False
        self.lag_later_s = 0.0

    def step(self, q: list[float], qd: list[float]) -> tuple[list[float], list[float]]:
        """Takes the command (q, qd) at the end of a cycle; returns the motion with the lead."""
        self.began = False
        if not any(qd) and max(map(abs, self.taken_back)) < AT_REST_RAD_S:
            self.ahead = [0.0] * 6
            self.taken_back = [0.0] * 6
            self.idle_cycles += 1
            return q, qd
        if self.idle_cycles >= self.idle_enough:
            self.began, self.lag_later_s = True, self.draw.gauss(0.0, self.scatter.lag_std_s)
        self.idle_cycles = 0
        if self.renews:
            self.deviations = [self.keeps * n + self.renews * self.draw.gauss(0.0, 1.0) for n in self.deviations]
        ahead = [(o + n) * u for o, n, u in zip(self.share, self.deviations, qd, strict=True)]
        self.taken_back = [self._filtered(*each) for each in zip(self.ahead, ahead, self.taken_back, strict=True)]
        self.ahead = ahead
        return (
            [x + RECOVERY_S * y for x, y in zip(q, self.taken_back, strict=True)],
            [u + w - y for u, w, y in zip(qd, ahead, self.taken_back, strict=True)],
        )

    def _deviation(self) -> float:
        return self.draw.gauss(0.0, self.scatter.speed_share)

    def _filtered(self, a: float, b: float, y: float) -> float:
        """Returns y after a cycle in which T y' + y = w, with w linear from `a` to `b`."""
        bend = self.bend * (b - a)
        return b - bend + (y - a + bend) * self.decay
