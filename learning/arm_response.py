"""What an arm makes of commanded joint velocities: speedj's ramp, a delay, a first-order part.

Between two ticks the arm moves linearly from one commanded velocity to the next; every motion here is a table of
velocities on a fine, uniform grid of times, read linearly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from learning.recordings import MotionRecording
from planner.arrays import Array
from planner.trajectory import columns_at

FINE_S = 0.002  # [s] longest step of the grid: a bend within a step is off by jerk * step^2 / 8, 2.5e-4 rad/s
RESPONSE_END = 1e-9  # [-] share of an impulse response at which it ends


@dataclass(frozen=True, eq=False)
class CommandedMotion:
    """Velocities (m, n) [rad/s] that the arm was driven to, on a uniform grid that starts at `start_s` [s]."""

    start_s: float
    step_s: float
    velocity: Array

    def delayed(self, times: Array, delay_s: float) -> tuple[Array, Array]:
        """Returns velocity (k, n) and its rate (k, n) `delay_s` before `times` (k,); at rest outside the grid."""
        at = (times - delay_s - self.start_s) / self.step_s
        last = len(self.velocity) - 1
        i = np.clip(np.floor(at).astype(int), 0, last - 1)
        share = np.clip(at - i, 0.0, 1.0)[:, None]
        slope = self._slope[i]
        inside = ((at >= 0.0) & (at <= last))[:, None]
        return self.velocity[i] + share * slope * self.step_s, np.where(inside, slope, 0.0)

    @cached_property
    def _slope(self) -> Array:
        return np.diff(self.velocity, axis=0) / self.step_s

    def filtered(self, first_order_s: float) -> CommandedMotion:
        """Returns the motion behind a first-order part of this time constant [s]; exact between grid points.

        Of tau v' + v = u with u linear over a step: v1 = u1 - b + (v0 - u0 + b) d with b = tau (u1 - u0) / h and
        d = exp(-h / tau); written as its impulse response.
        """
        if first_order_s <= 0.0:
            return self
        slope = first_order_s / self.step_s
        decay = math.exp(-1.0 / slope)
        first = 1.0 - slope + slope * decay
        second = slope - decay - slope * decay
        length = min(len(self.velocity), 2 + math.ceil(-math.log(RESPONSE_END) * slope))
        response = np.concatenate([[first], (second + decay * first) * decay ** np.arange(length - 1.0)])
        rest = self.velocity[0]  # whatever moved before the recording had settled
        columns = [np.convolve(u, response)[: len(u)] for u in (self.velocity - rest).T]
        return CommandedMotion(self.start_s, self.step_s, np.stack(columns, axis=1) + rest)


def commanded_motion(recording: MotionRecording, acceleration: float = math.inf) -> CommandedMotion:
    """Returns the commanded motion of a recording, behind the ramp of speedj with this acceleration [rad/s^2].

    The joint that has furthest to go ramps at `acceleration`, the others in proportion. Source: URScript manual,
    speedj: "acceleration of the leading axis".
    """
    times, command = recording.held_commands()
    velocity = ramped(times, command, acceleration)
    step = recording.dt / math.ceil(recording.dt / FINE_S - 1e-6)
    grid = np.arange(times[0], times[-1] + 0.5 * step, step)
    return CommandedMotion(times[0], step, columns_at(grid, times, velocity))


def leading_rates(recording: MotionRecording) -> Array:
    """Returns the commanded acceleration of the leading axis between rows (m,) [rad/s^2]."""
    times, command = recording.held_commands()
    return np.abs(np.diff(command, axis=0)).max(axis=1) / np.diff(times)


def ramped(times: Array, command: Array, acceleration: float) -> Array:
    """Returns the velocities (m, n) [rad/s] that a ramp on the leading axis reaches of commands (m, n)."""
    if np.abs(np.diff(command, axis=0)).max(initial=0.0) <= acceleration * np.diff(times).min():
        return command
    reached = command[0]
    rows = [command[0]]
    for wanted, most in zip(command[1:], acceleration * np.diff(times), strict=True):
        change = wanted - reached
        largest = np.abs(change).max()
        reached = wanted if largest <= most else reached + change * (most / largest)
        rows.append(reached)
    return np.array(rows)
