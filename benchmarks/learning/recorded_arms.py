"""An arm that the estimators do not know: a command becomes a measured velocity by small steps of time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from learning import MotionRecording

STEP_S = 1e-4  # [s] of the integration: far below a tick


@dataclass(frozen=True)
class RecordedArm:
    """Truth of an arm: lag, first-order part [s], gains, speedj's acceleration [rad/s^2], noise [rad/s]."""

    lag_s: float
    first_order_s: float = 0.0
    gain: np.ndarray = field(default_factory=lambda: np.ones(6))
    ramp: float = math.inf
    noise: float = 5e-4
    correlated: float = 0.0

    def run(self, rng: np.random.Generator, rate_hz: float) -> MotionRecording:
        """Returns a throw-like motion: each joint swings up to its own peak and brakes, over about a second."""
        dt = 1.0 / rate_hz
        t = np.arange(0.0, 1.5, dt)
        command = launch_and_brake(rng, t)
        followed = followed_commands(command, self.ramp * dt)
        fine = np.arange(0.0, t[-1], STEP_S)
        arm = np.stack([np.interp(fine - (self.lag_s - self.first_order_s), t, u) for u in followed.T], axis=1)
        if self.first_order_s > 0.0:
            arm = trapezoidal_low_pass(arm, self.first_order_s)
        measured = self.gain * np.stack([np.interp(t, fine, v) for v in arm.T], axis=1)
        measured = measured + rng.normal(0.0, self.noise, measured.shape)
        return MotionRecording(t, command, measured + self._residual(rng, command, dt))

    def _residual(self, rng: np.random.Generator, command: np.ndarray, dt: float) -> np.ndarray:
        """A disturbance correlated over 20 ms, in proportion to the speed."""
        keep = math.exp(-dt / 0.02)
        rows = [np.zeros(6)]
        for _ in command[1:]:
            rows.append(keep * rows[-1] + math.sqrt(1.0 - keep**2) * rng.normal(0.0, self.correlated, 6))
        return np.array(rows) * np.abs(command) / max(np.abs(command).max(), 1e-9)


def launch_and_brake(rng: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """Smooth commands (n, 6) [rad/s] from rest to a peak and back; the fastest joint reaches 2 to 3 rad/s."""
    up = rng.uniform(0.35, 0.55)
    down = rng.uniform(0.3, 0.5)
    rise = 0.5 - 0.5 * np.cos(np.pi * np.clip((t - 0.1) / up, 0.0, 1.0))
    fall = 0.5 + 0.5 * np.cos(np.pi * np.clip((t - 0.1 - up) / down, 0.0, 1.0))
    peaks = rng.uniform(0.2, 1.0, 6) * rng.choice([-1.0, 1.0], 6)
    return (rise * fall)[:, None] * peaks / np.abs(peaks).max() * rng.uniform(2.0, 3.0)


def followed_commands(command: np.ndarray, most: float) -> np.ndarray:
    """What an arm reaches of the commands whose leading axis changes by `most` [rad/s] a tick at most."""
    at = np.zeros(6)
    rows = []
    for wanted in command:
        change = wanted - at
        at = at + change * min(1.0, most / max(np.abs(change).max(), 1e-12))
        rows.append(at)
    return np.array(rows)


def trapezoidal_low_pass(signal: np.ndarray, time_constant: float) -> np.ndarray:
    """First-order low pass by the trapezoidal rule, every `STEP_S`."""
    c = STEP_S / (2.0 * time_constant)
    state = signal[0]
    rows = [signal[0]]
    for before, now in pairwise(signal):
        state = ((1.0 - c) * state + c * (before + now)) / (1.0 + c)
        rows.append(state)
    return np.array(rows)
