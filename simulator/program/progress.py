"""The progress of a move along its path: a trapezoid of the speed, in time that the speed scaling stretches."""

from __future__ import annotations

import math
from collections.abc import Callable

from simulator.program.paths import Path


class SpeedTrapezoid:
    """Rest to rest over `length` [rad or m] with a largest speed and one acceleration; a triangle if it is short."""

    def __init__(self, length: float, speed: float, acceleration: float) -> None:
        self.length = length
        self.acceleration = acceleration
        self.speed = min(speed, math.sqrt(length * acceleration))
        self.ramp_s = self.speed / acceleration
        self.duration_s = length / self.speed + self.ramp_s

    def at(self, t: float) -> tuple[float, float]:
        """Returns distance and speed at `t` [s] after the start."""
        rest = self.duration_s - t
        if rest <= 0.0:
            return self.length, 0.0
        if t < self.ramp_s:
            return 0.5 * self.acceleration * t * t, self.acceleration * t
        if rest < self.ramp_s:
            return self.length - 0.5 * self.acceleration * rest * rest, self.acceleration * rest
        return self.speed * (t - 0.5 * self.ramp_s), self.speed


class Progress:
    """A move under way: how far along its path it is."""

    def __init__(self, path: Path, profile: SpeedTrapezoid, dt: float, scale: Callable[[], float]) -> None:
        """`scale` returns the present speed scaling: it stretches the move's time."""
        self.path = path
        self.profile = profile
        self.dt = dt
        self.scale = scale
        self.t = 0.0

    @property
    def ended(self) -> bool:
        """Whether the end is reached."""
        return self.t >= self.profile.duration_s

    @property
    def brakes(self) -> bool:
        """Whether the move has begun to lose its speed."""
        return self.t >= self.profile.duration_s - self.profile.ramp_s

    def step(self) -> tuple[list[float], list[float]]:
        """Goes on by one cycle; returns joint positions [rad] and speeds [rad/s]."""
        rate = self.scale()
        self.t = min(self.t + self.dt * rate, self.profile.duration_s)
        s, v = self.profile.at(self.t)
        q, rates = self.path.at(s)
        return q, [w * v * rate for w in rates]

    def rest(self) -> tuple[list[float], list[float]]:
        """Goes on by one cycle; returns what is left: joint positions less those of the goal, and speeds."""
        q, qd = self.step()
        return [a - b for a, b in zip(q, self.path.goal, strict=True)], qd
