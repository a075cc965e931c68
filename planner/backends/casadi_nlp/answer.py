"""From a solution to a trajectory: the release made exact, and every jerk brought onto a tick."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.backends.casadi_nlp.layout import QD, QD_SCALE, QDD, QDD_SCALE, TIME, TIME_SCALE, Q
from planner.backends.casadi_nlp.table import Shape
from planner.problem import ThrowProblem
from planner.timing.grid import onto_grid
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
    """Returns the motion on whole ticks, through the release state exactly.

    What a phase lacks to whole ticks is spent at rest: before the launch, and after the brake.

    Args:
        problem: for its start, limits and tick.
        found: the solution.
        release: q and qd (6,), exact.
        ticks: of the launch and of the brake; 0 for a move that ends at rest.
    """
    dt, jerk_max, k = problem.dt, problem.limits.jerk_max, found.launch
    zero, (q, qd) = np.zeros(6), release
    launch, brake = found.t[: k + 1], found.t[k:] - found.t[k]
    wait = ticks[0] * dt - float(launch[-1])
    acceleration = _sampled(launch, found.qdd[: k + 1], dt * np.arange(ticks[0] + 1, dtype=np.float64) - wait)
    state = (q, qd, zero if problem.ends_at_rest else found.qdd[k])
    head = onto_grid((problem.start, zero, zero), state, acceleration, dt, jerk_max)
    if problem.ends_at_rest:
        return join(head, tuple(x[-1:] for x in head), 1.0 / dt)  # pyright: ignore[reportArgumentType]
    acceleration = _sampled(brake, found.qdd[k:], dt * np.arange(ticks[1] + 1, dtype=np.float64))
    rest = q + found.q[-1] - found.q[k]
    tail = onto_grid(state, (rest, zero, zero), acceleration, dt, jerk_max)
    return join(head, tail, 1.0 / dt)


def _sampled(t: Vector, qdd: Vector, when: Vector) -> Vector:
    """Returns the accelerations (n, 6) at times `when` (n,) [s] of a phase from knots `t`: at rest outside it."""
    return np.stack([np.interp(when, t, column) for column in qdd.T], axis=1)


def joints_within(problem: ThrowProblem, made: Trajectory) -> bool:
    """Whether velocity, acceleration and jerk obey the problem's limits at the ticks."""
    limits, room = problem.limits, 1.0 + ROUNDING
    pairs = ((made.qd, limits.qd_max), (made.qdd, limits.qdd_max), (made.jerk, limits.jerk_max))
    return all(bool((np.abs(values) <= limit * room).all()) for values, limit in pairs)
