"""The lag of the measured motion behind the commanded one: a pure delay and a first-order part.

A command sent while the state of cycle k is the newest is obeyed in cycle k + 1. This one cycle, the pure delay and the
time constant of the first-order part add up to the lag: measured(t) is the motion sent at t - lag.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Sample = tuple[float, float, float]  # commanded position and speed, and the speed filtered
ON_GRID = 1e-6  # [cycles] a delay this close to a whole number of cycles counts as whole


class JointLag:
    """Turns the commanded motion of one joint, one sample per cycle, into its true motion."""

    def __init__(self, dt: float, lag_s: float, first_order_s: float, q: float) -> None:
        """Starts at rest at joint position `q` [rad].

        Args:
            dt: cycle time [s].
            lag_s: total lag [s]; at least one cycle, since a command cannot be obeyed earlier.
            first_order_s: time constant of the first-order part [s], at most the rest of the lag.
            q: joint position [rad].
        """
        rest = max(lag_s - dt, 0.0)
        self.dt = dt
        self.tau = min(first_order_s, rest)
        self.delay = self.mean_delay = (rest - self.tau) / dt  # [cycles]
        self.decay = math.exp(-dt / self.tau) if self.tau > 0.0 else 0.0
        self.size = math.floor(self.delay) + 5
        self.ring: list[Sample] = [(q, 0.0, 0.0)] * self.size
        self.at = 0

    def shift(self, later_s: float) -> None:
        """Makes the pure delay differ by `later_s` [s] from its mean, by one cycle at most; only while at rest."""
        self.delay = max(0.0, self.mean_delay + min(1.0, max(-1.0, later_s / self.dt)))

    def step(self, q: float, qd: float) -> tuple[float, float]:
        """Takes the commanded state at the end of this cycle; returns the true one (q, qd) at the same instant."""
        _, u, v = self.ring[self.at]
        self.at = (self.at + 1) % self.size
        self.ring[self.at] = (q, qd, self._filtered(u, qd, v, 1.0, self.decay))
        return self.before(0.0)

    def before(self, back_s: float) -> tuple[float, float]:
        """Returns the true state (q, qd) `back_s` [s] before the end of this cycle, one cycle at most.

        First-order part and delay commute, so the delayed sample of the filtered motion is the filtered delayed motion.
        """
        cycles = self.delay + back_s / self.dt
        whole = math.floor(cycles + ON_GRID)
        part = cycles - whole
        q, _, v = self._within(whole, 1.0 - part) if part > ON_GRID else self.ring[self.at - whole]
        return q - self.tau * v, v  # tau v' + v = u, and so q_u - q = tau v

    def _within(self, back: int, s: float) -> Sample:
        """Returns the sample at the share `s` of the cycle that ended `back` cycles ago.

        The position is a cubic Hermite polynomial: the exact parabola where the speed is linear over the cycle.
        """
        (qa, ua, va) = self.ring[self.at - back - 1]
        (qb, ub, _) = self.ring[self.at - back]
        h = self.dt
        q = qa + h * s * ua + s * s * (3.0 * (qb - qa) - h * (2.0 * ua + ub)) + s**3 * (2.0 * (qa - qb) + h * (ua + ub))
        u = ua + (ub - ua) * s
        return q, u, self._filtered(ua, u, va, s, math.exp(-s * h / self.tau) if self.tau > 0.0 else 0.0)

    def _filtered(self, a: float, b: float, v: float, s: float, decay: float) -> float:
        """Returns the filtered speed after the share `s` of a cycle with an input linear from `a` to `b`.

        It solves tau v' + v = u exactly.
        """
        if self.tau <= 0.0:
            return b
        bend = self.tau / (s * self.dt) * (b - a)
        return b - bend + (v - a + bend) * decay


class Lag:
    """The lag of six joints: equal in sum, each with a first-order part of its own."""

    def __init__(self, dt: float, lag_s: float, first_order_s: Sequence[float], q: Sequence[float]) -> None:
        """Starts at rest at joint positions `q` [rad]; see `JointLag`."""
        self.joints = [JointLag(dt, lag_s, tau, x) for tau, x in zip(first_order_s, q, strict=True)]

    def shift(self, later_s: float) -> None:
        """Makes the delay of all joints differ by `later_s` [s] from its mean; only while at rest."""
        for joint in self.joints:
            joint.shift(later_s)

    def step(self, q: Sequence[float], qd: Sequence[float]) -> tuple[list[float], list[float]]:
        """Takes the commanded state at the end of this cycle; returns the true one (q, qd) at the same instant."""
        found = [joint.step(x, v) for joint, x, v in zip(self.joints, q, qd, strict=True)]
        return [x for x, _ in found], [v for _, v in found]

    def before(self, back_s: float) -> tuple[list[float], list[float]]:
        """Returns the true state (q, qd) `back_s` [s] before the end of this cycle, one cycle at most."""
        found = [joint.before(back_s) for joint in self.joints]
        return [x for x, _ in found], [v for _, v in found]
