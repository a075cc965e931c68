"""The trapezoid of speed that URScript's moves follow along their path."""

from __future__ import annotations

import math


class Trapezoid:
    """Rest to rest over `length` with a largest speed and one acceleration; a triangle where the way is short."""

    def __init__(self, length: float, speed: float, acceleration: float) -> None:
        self.length = length
        self.acceleration = acceleration
        self.speed = min(speed, math.sqrt(length * acceleration))
        self.ramp_s = self.speed / acceleration
        self.duration_s = length / self.speed + self.ramp_s

    def at(self, t: float) -> tuple[float, float]:
        """Returns way and speed at `t` [s] after the start."""
        rest = self.duration_s - t
        if rest <= 0.0:
            return self.length, 0.0
        if t < self.ramp_s:
            return 0.5 * self.acceleration * t * t, self.acceleration * t
        if rest < self.ramp_s:
            return self.length - 0.5 * self.acceleration * rest * rest, self.acceleration * rest
        return self.speed * (t - 0.5 * self.ramp_s), self.speed
