"""From a solution to a trajectory: the release made exact, and every jerk brought onto a tick."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.backends.casadi_nlp.assembly import Shape
from planner.backends.casadi_nlp.layout import QD, QD_SCALE, QDD, QDD_SCALE, TIME, TIME_SCALE, Q
from planner.grid import onto_grid
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory, join

Vector = NDArray[np.float64]

SPARE = 0.2  # [ticks] beyond the least time: room for bringing jerks onto ticks
LEAST_TICKS = 4  # of a phase: three are needed to reach an end state
ROUNDING = 1e-8  # [-] share of a limit that floating point may exceed


@dataclass(frozen=True)
class Knots:
    """A solution's states: times (N + 1,) [s], q, qd, qdd (N + 1, 6); jerk is constant between them."""

    t: Vector
    q: Vector
    qd: Vector
    qdd: Vector
    launch: int

    @property
    def release_s(self) -> float:
        """Time of the release [s]."""
        return float(self.t[self.launch])

    @property
    def brake_s(self) -> float:
        """Duration of the brake [s]."""
        return float(self.t[-1] - self.t[self.launch])

    def at(self, t: Vector) -> tuple[Vector, Vector, Vector]:
        """Returns q, qd, qdd (k, 6) at times `t` (k,) [s] within the motion."""
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        s = (t - self.t[i])[:, None]
        jerk = (self.qdd[i + 1] - self.qdd[i]) / (self.t[i + 1] - self.t[i])[:, None]
        q = self.q[i] + s * (self.qd[i] + s * (self.qdd[i] / 2.0 + s * jerk / 6.0))
        return q, self.qd[i] + s * (self.qdd[i] + s * jerk / 2.0), self.qdd[i] + s * jerk


def knots(z: Vector, shape: Shape) -> Knots:
    """Returns the states of the variables (N + 1, NZ)."""
    return Knots(z[:, TIME] * TIME_SCALE, z[:, Q], z[:, QD] * QD_SCALE, z[:, QDD] * QDD_SCALE, shape.launch)


def whole_ticks(duration: float, dt: float) -> int:
    """Returns the least number of ticks of `dt` that lasts `duration` [s], and a little more."""
    return max(LEAST_TICKS, math.ceil(duration / dt + SPARE))


def trajectory(
    problem: ThrowProblem, found: Knots, release: tuple[Vector, Vector], ticks: tuple[int, int]
) -> Trajectory:
    """Returns the motion stretched to whole ticks, through the release state exactly.

    Args:
        problem: for its start, limits and tick.
        found: the solution.
        release: q and qd (6,), exact.
        ticks: of the launch and of the brake; 0 for a move that ends at rest.
    """
    dt, jerk_max, k = problem.dt, problem.limits.jerk_max, found.launch
    zero, (q, qd) = np.zeros(6), release
    acceleration, a = _stretched(found.t[: k + 1], found.qdd[: k + 1], ticks[0], dt)
    state = (q, qd, zero if problem.ends_at_rest else a)
    head = onto_grid((problem.start, zero, zero), state, acceleration, dt, jerk_max)
    if problem.ends_at_rest:
        return join(head, tuple(x[-1:] for x in head), 1.0 / dt)  # pyright: ignore[reportArgumentType]
    acceleration, _ = _stretched(found.t[k:] - found.t[k], found.qdd[k:], ticks[1], dt)
    tail = onto_grid(state, (found.q[-1], zero, zero), acceleration, dt, jerk_max)
    return join(head, tail, 1.0 / dt)


def _stretched(t: Vector, qdd: Vector, ticks: int, dt: float) -> tuple[Vector, Vector]:
    """Returns the accelerations at the ticks (n + 1, 6) of a phase slowed down to `ticks`, and the last one."""
    slower = t[-1] / (ticks * dt)
    when = np.linspace(0.0, t[-1], ticks + 1)
    samples = np.stack([np.interp(when, t, column) for column in qdd.T], axis=1) * slower**2
    return samples, samples[-1]


def joints_within(problem: ThrowProblem, made: Trajectory) -> bool:
    """Whether velocity, acceleration and jerk obey the problem's limits at the ticks."""
    limits, room = problem.limits, 1.0 + ROUNDING
    pairs = ((made.qd, limits.qd_max), (made.qdd, limits.qdd_max), (made.jerk, limits.jerk_max))
    return all(bool((np.abs(values) <= limit * room).all()) for values, limit in pairs)
