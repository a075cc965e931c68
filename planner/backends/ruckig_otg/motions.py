"""Motions by Ruckig: solutions on the tick grid, and an initial guess in continuous time.

The variants differ in the launch:

* `free` gives the slowest joint the release acceleration with the earliest arrival. Where nothing couples the joints,
  no launch is sooner. The other variants release with zero acceleration.
* `synchronised` stretches every joint to the slowest one's time.
* `independent` lets every joint run its own fastest motion as late as possible.
* `gentle` is synchronised with half the acceleration and jerk and less speed: later, but with smaller torques and a
  slower tool during the launch.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from planner.backends.ruckig_otg.arrival import earliest_arrival
from planner.backends.ruckig_otg.library import State, Vector, accelerations, fastest_motion
from planner.backends.solution import Solution
from planner.cell import Limits
from planner.errors import SolverFailed
from planner.problem import ThrowProblem
from planner.seeds import Candidate
from planner.timing import RESERVES, fits, grid_limits, onto_grid
from planner.trajectory import join

LaunchVariant = Literal["free", "synchronised", "independent", "gentle"]
VARIANTS: tuple[LaunchVariant, ...] = get_args(LaunchVariant)
GENTLE = 0.5  # [-] of the limits on acceleration and jerk


def solve(problem: ThrowProblem, candidate: Candidate, variant: LaunchVariant = "synchronised") -> Solution:
    """Returns the fastest launch of the variant to the candidate, followed by the fastest brake.

    Args:
        problem: gives start, limits and tick.
        candidate: the release state.
        variant: one of `VARIANTS`.

    Raises:
        SolverFailed: Ruckig refuses the states, for example a release beyond the velocity limits.
        BackendUnavailable: ruckig is not installed.
    """
    zero = np.zeros(6)
    start = problem.start_state
    qdd = zero
    if variant == "free":
        qdd = earliest_arrival(problem, candidate).qdd
    limited = problem.limits
    if variant == "gentle":
        limited = _gentle(limited, np.maximum(np.abs(candidate.qd), np.abs(problem.start_qd)), GENTLE)
    at_ticks = _independent if variant == "independent" else _synchronised
    if variant == "independent" and not problem.starts_at_rest:
        raise SolverFailed("a joint that is in motion cannot wait at the start")

    def launch(limits: Limits) -> tuple[State, Vector]:
        release = (candidate.q, candidate.qd, np.clip(qdd, -limits.qdd_max, limits.qdd_max))
        return release, at_ticks(start, release, limits, problem.dt)

    head = _on_grid(limited, problem.dt, start, launch)
    release = (candidate.q, candidate.qd, head[2][-1])
    if problem.ends_at_rest:
        tail = (candidate.q[None], candidate.qd[None], zero[None])
    else:
        tail = _on_grid(limited, problem.dt, release, lambda limits: _brake(release, limits, problem.dt))
    return Solution(join(head, tail, 1.0 / problem.dt), variant)


def leg(problem: ThrowProblem, start: State, end: State | None, pace: float, least_s: float = 0.0) -> State:
    """Returns the samples of the fastest motion from one state to another, exactly on ticks.

    Args:
        problem: gives limits and tick.
        start: q [rad], qd [rad/s], qdd [rad/s^2], each (6,).
        end: the same quantities; None for rest, anywhere.
        pace: share of the limits on acceleration and jerk; speed is limited less.
        least_s: shortest duration, not of a brake [s].

    Raises:
        SolverFailed: Ruckig refuses the states, or its motion exceeds a limit once it is on ticks.
        BackendUnavailable: ruckig is not installed.
    """
    ends = [start] if end is None else [start, end]
    speeds, least_qdd = (np.abs([state[k] for state in ends]).max(axis=0) for k in (1, 2))
    limited = _gentle(problem.limits, speeds, pace, least_qdd) if pace < 1.0 else problem.limits

    def phase(limits: Limits) -> tuple[State, Vector]:
        if end is None:
            return _brake(start, limits, problem.dt)
        return end, _synchronised(start, end, limits, problem.dt, least_s)

    samples = _on_grid(limited, problem.dt, start, phase)
    if not fits(samples, problem.limits, problem.dt):
        raise SolverFailed("the motion exceeds a joint's limit on ticks")
    return samples


def least_leg_time(problem: ThrowProblem, start: State, end: State | None) -> float:
    """Returns the time of the fastest motion from one state to another [s]; infinite where Ruckig refuses them.

    Args:
        problem: gives limits and tick.
        start, end: as of `leg`.

    Raises:
        BackendUnavailable: ruckig is not installed.
    """
    try:
        return float(fastest_motion(start, end, problem.limits, problem.dt, on_ticks=False).duration)
    except SolverFailed:
        return math.inf


@dataclass(frozen=True, eq=False)
class RuckigMotion:
    """Ruckig's motion in continuous time, not on ticks.

    Attributes:
        launch: Ruckig's trajectory to the release.
        brake: Ruckig's trajectory from there to rest; None for a move that ends at rest.
        release_time_s: duration of the launch [s].
        duration_s: duration of launch and brake [s].
    """

    launch: Any
    brake: Any
    release_time_s: float
    duration_s: float

    def at(self, t: Vector, /) -> State:
        """Returns q, qd, qdd (n, 6) at times `t` (n,) [s]."""
        released = self.release_time_s
        states = [
            self.launch.at_time(s) if s <= released or not self.brake else self.brake.at_time(s - released)
            for s in t.tolist()
        ]
        q, qd, qdd = np.array(states).swapaxes(0, 1)
        return q, qd, qdd


def initial_guess(problem: ThrowProblem, candidate: Candidate) -> RuckigMotion:
    """Returns the motion that arrives with the slowest joint alone, as an initial guess for an optimiser.

    Args:
        problem: gives start and limits.
        candidate: the release state.

    Raises:
        SolverFailed: Ruckig refuses the states.
        BackendUnavailable: ruckig is not installed.
    """
    limits = problem.limits
    dt = problem.dt
    release = (candidate.q, candidate.qd, earliest_arrival(problem, candidate).qdd)
    launch = fastest_motion(problem.start_state, release, limits, dt, on_ticks=False)
    if problem.ends_at_rest:
        return RuckigMotion(launch, None, launch.duration, launch.duration)
    brake = fastest_motion(release, None, limits, dt)
    return RuckigMotion(launch, brake, launch.duration, launch.duration + brake.duration)


def _gentle(limits: Limits, speeds: Vector, pace: float, least_qdd: Vector | float = 0.0) -> Limits:
    """Returns the limits of a pace; no less than given speeds (6,) [rad/s] and accelerations (6,) [rad/s^2]."""
    share = (1.0 + 4.0 * pace) / 5.0  # of the velocity: a fifth at no pace, 0.6 at half the acceleration
    qd_max = np.maximum(share * limits.qd_max, np.minimum(speeds, limits.qd_max))
    qdd_max = np.maximum(pace * limits.qdd_max, np.minimum(least_qdd, limits.qdd_max))
    return replace(limits, qd_max=qd_max, qdd_max=qdd_max, jerk_max=pace * limits.jerk_max)


def _on_grid(limits: Limits, dt: float, start: State, phase: Callable[[Limits], tuple[State, Vector]]) -> State:
    """Returns the samples of a phase on the tick grid, with the smallest reserve with which it keeps the limits."""
    samples = start
    for reserve in RESERVES:
        end, qdd = phase(grid_limits(limits, dt, reserve))
        samples = onto_grid(start, end, qdd, dt, limits.jerk_max)
        if fits(samples, limits, dt):
            break
    return samples


def _synchronised(start: State, end: State, limits: Limits, dt: float, least_s: float = 0.0) -> Vector:
    """Returns the accelerations at the ticks (N+1, 6) of the motion in which all joints arrive together."""
    return accelerations(fastest_motion(start, end, limits, dt, least_s=least_s), dt)


def _independent(start: State, end: State, limits: Limits, dt: float) -> Vector:
    """Returns the accelerations at the ticks (N+1, 6) with every joint as fast and as late as possible."""
    columns = [accelerations(fastest_motion(start, end, limits, dt, slice(i, i + 1)), dt) for i in range(6)]
    longest = max(map(len, columns))
    return np.hstack([np.pad(column, ((longest - len(column), 0), (0, 0))) for column in columns])


def _brake(release: State, limits: Limits, dt: float) -> tuple[State, Vector]:
    """Returns the state of rest at the end of the fastest brake, and the accelerations at its ticks (M+1, 6)."""
    motion = fastest_motion(release, None, limits, dt)
    zero = np.zeros(6)
    return (np.array(motion.at_time(motion.duration)[0]), zero, zero), accelerations(motion, dt)
