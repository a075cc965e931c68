"""The lag of the measured motion behind the commanded one: a pure delay and a first-order part.

A command sent while the state of cycle k is the newest is obeyed in cycle k + 1. This one cycle, the pure delay and the
time constant of the first-order part add up to the lag: measured(t) is the motion sent at t - lag.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Sample = tuple[list[float], list[float], list[float]]  # commanded position and speed, and the speed filtered
ON_GRID = 1e-6  # [cycles] a delay this close to a whole number of cycles counts as whole


class Lag:
    """Turns the commanded joint motion, one sample per cycle, into the true motion of the arm."""

    def __init__(self, dt: float, lag_s: float, first_order_s: float, q: Sequence[float]) -> None:
        """Starts at rest at joint positions `q` [rad].

        Args:
            dt: cycle time [s].
            lag_s: total lag [s]; at least one cycle, since a command cannot be obeyed earlier.
            first_order_s: time constant of the first-order part [s], limited to half the rest of the lag.
            q: joint positions [rad].
        """
        rest = max(lag_s - dt, 0.0)
        self.dt = dt
        self.tau = min(first_order_s, rest / 2.0)
        self.delay = (rest - self.tau) / dt  # [cycles]
        self.decay = math.exp(-dt / self.tau) if self.tau > 0.0 else 0.0
        self.size = math.floor(self.delay) + 4
        still = [0.0] * len(q)
        self.ring: list[Sample] = [(list(q), still, still)] * self.size
        self.at = 0

    def step(self, q: list[float], qd: list[float]) -> tuple[list[float], list[float]]:
        """Takes the commanded state at the end of this cycle; returns the true one (q, qd) at the same instant.

        The lists are kept, not copied; callers pass new ones every cycle.
        """
        _, u, v = self.ring[self.at]
        self.at = (self.at + 1) % self.size
        self.ring[self.at] = (q, qd, self._filtered(u, qd, v, 1.0, self.decay))
        return self.before(0.0)

    def before(self, back_s: float) -> tuple[list[float], list[float]]:
        """Returns the true state (q, qd) `back_s` [s] before the end of this cycle, one cycle at most.

        First-order part and delay commute, so the delayed sample of the filtered motion is the filtered delayed motion.
        """
        cycles = self.delay + back_s / self.dt
        whole = math.floor(cycles + ON_GRID)
        part = cycles - whole
        q, _, v = self._within(whole, 1.0 - part) if part > ON_GRID else self.ring[self.at - whole]
        return [a - self.tau * b for a, b in zip(q, v, strict=True)], v  # tau v' + v = u, and so q_u - q = tau v

    def _within(self, back: int, s: float) -> Sample:
        """Returns the sample at the share `s` of the cycle that ended `back` cycles ago.

        The position is a cubic Hermite polynomial: the exact parabola where the speed is linear over the cycle.
        """
        (qa, ua, va), (qb, ub, _) = self.ring[self.at - back - 1], self.ring[self.at - back]
        h = self.dt
        q = [
            a + h * s * u + s * s * (3.0 * (b - a) - h * (2.0 * u + w)) + s**3 * (2.0 * (a - b) + h * (u + w))
            for a, u, b, w in zip(qa, ua, qb, ub, strict=True)
        ]
        u = [a + (b - a) * s for a, b in zip(ua, ub, strict=True)]
        return q, u, self._filtered(ua, u, va, s, math.exp(-s * h / self.tau) if self.tau > 0.0 else 0.0)

    def _filtered(self, u0: list[float], u1: list[float], v0: list[float], s: float, decay: float) -> list[float]:
        """Returns the filtered speed at the share `s` of a cycle with linear input; solves tau v' + v = u exactly."""
        if self.tau <= 0.0:
            return u1
        slope = self.tau / (s * self.dt)
        speed = []
        for a, b, v in zip(u0, u1, v0, strict=True):
            bend = slope * (b - a)
            speed.append(b - bend + (v - a + bend) * decay)
        return speed
