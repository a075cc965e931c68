"""The lag of the measured motion behind the commanded one: a pure delay and a first-order part.

A command that is sent while the state of cycle k is the newest is obeyed in cycle k + 1. This one cycle, the pure delay
and the time constant of the first-order part add up to the lag: measured(t) is what was sent at t - lag.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

ON_GRID = 1e-6  # [cycles] a delay this close to a whole number of cycles counts as whole


class Lag:
    """Turns the commanded joint motion, one sample a cycle, into the true motion of the arm."""

    def __init__(self, dt: float, lag_s: float, first_order_s: float, q: Sequence[float]) -> None:
        """`lag_s` [s] shorter than a cycle is taken for one: a command cannot be obeyed earlier."""
        rest = max(lag_s - dt, 0.0)
        self.dt = dt
        self.tau = min(first_order_s, rest / 2.0)
        cycles = (rest - self.tau) / dt
        self.whole = math.floor(cycles + ON_GRID)
        part = cycles - self.whole
        self.part = part if part > ON_GRID else 0.0  # the delay is (whole + part) cycles
        self.decay = math.exp(-dt / self.tau) if self.tau > 0.0 else 0.0
        self.size = self.whole + 2
        self.settle(q)

    def settle(self, q: Sequence[float]) -> None:
        """Starts anew, at rest at `q`."""
        self.ring = [(list(q), [0.0] * len(q))] * self.size
        self.at = 0
        self.input = [0.0] * len(q)
        self.speed = [0.0] * len(q)

    def step(self, q: list[float], qd: list[float]) -> tuple[list[float], list[float]]:
        """Takes the commanded state at the end of this cycle; returns the true one (q, qd) of the same instant.

        The lists are kept, not copied: who commands a motion makes new ones.
        """
        self.at = (self.at + 1) % self.size
        self.ring[self.at] = (q, qd)
        delayed_q, delayed_qd = self._delayed()
        if self.tau <= 0.0:
            return delayed_q, delayed_qd
        return self._filtered(delayed_q, delayed_qd)

    def _delayed(self) -> tuple[list[float], list[float]]:
        newer = self.ring[self.at - self.whole]
        if not self.part:
            return newer
        older = self.ring[self.at - self.whole - 1]
        s = 1.0 - self.part
        qd = [a + (b - a) * s for a, b in zip(older[1], newer[1], strict=True)]
        h = self.dt
        # Hermite's cubic; the exact parabola where the speed runs linearly over the cycle
        q = [
            qa + h * s * va + s * s * (3.0 * (qb - qa) - h * (2.0 * va + vb)) + s**3 * (2.0 * (qa - qb) + h * (va + vb))
            for qa, va, qb, vb in zip(older[0], older[1], newer[0], newer[1], strict=True)
        ]
        return q, qd

    def _filtered(self, q: list[float], qd: list[float]) -> tuple[list[float], list[float]]:
        """First order, exact for a speed that runs linearly over the cycle: tau v' + v = u, and so q_u - q = tau v."""
        tau, decay, dt = self.tau, self.decay, self.dt
        speed = []
        for u0, u1, v0 in zip(self.input, qd, self.speed, strict=True):
            bend = tau * (u1 - u0) / dt
            speed.append(u1 - bend + (v0 - u0 + bend) * decay)
        self.input, self.speed = qd, speed
        return [a - tau * v for a, v in zip(q, speed, strict=True)], speed
