"""Ruckig: the microsecond answer. State to state in joint space, jerk-limited, time-optimal for each joint.

Four launches are offered. `free` takes the slowest joint through the release with the acceleration that is soonest:
where nothing couples the joints, no launch is sooner. The others release with zero acceleration: `synchronised`
stretches every joint to the slowest one's time, `independent` lets every joint run its own fastest motion and wait at
rest before it, and `gentle` is synchronised with half the acceleration and jerk and less speed: later, but easy on
torques and on the tool's speed on the way.
Source: Berscheid and Kroeger, Jerk-limited Real-time Trajectory Generation with Arbitrary Target States, RSS 2021.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.backends.ruckig_otg import calls
from planner.backends.ruckig_otg.arrival import Arrival, least_times, soonest
from planner.backends.ruckig_otg.calls import State
from planner.backends.ruckig_otg.rough import Rough, rough
from planner.cell import Limits
from planner.errors import SolverFailed
from planner.problem import ThrowProblem
from planner.seeds.candidates import Candidate
from planner.solution import Solution
from planner.timing.grid import ROOMS, fits, grid_limits, onto_grid
from planner.trajectory import join

__all__ = ["LAUNCHES", "SPARE", "Arrival", "Rough", "arrival", "launch_time", "least_times", "rough", "solve"]

Vector = NDArray[np.float64]
Way = Callable[[State, State, Limits, float], Vector]

LAUNCHES = ("free", "synchronised", "independent", "gentle")
SPARE = LAUNCHES[-1]  # never the soonest: for where the others are not certified
GENTLE_SPEED, GENTLE = 0.6, 0.5  # [-] of the limits on velocity, and on acceleration and jerk


def solve(problem: ThrowProblem, candidate: Candidate, launch: str = "synchronised") -> Solution:
    """Returns the fastest motion to the candidate, with the launch's acceleration there, and from there to rest.

    Args:
        problem: whose start and limits hold.
        candidate: the release state.
        launch: one of `LAUNCHES`.

    Raises:
        SolverFailed: Ruckig refuses the states, as when the release is faster than the limits.
        BackendUnavailable: ruckig is not installed.
    """
    zero = np.zeros(6)
    start, qdd = (problem.start, zero, zero), zero
    if launch == "free":
        qdd = soonest(problem, candidate).qdd
    if launch == "gentle":
        problem = replace(problem, limits=_gentle(problem.limits, candidate))
    way = _independent if launch == "independent" else _synchronised

    def released(limits: Limits) -> tuple[State, Vector]:
        release = (candidate.q, candidate.qd, np.clip(qdd, -limits.qdd_max, limits.qdd_max))
        return release, way(start, release, limits, problem.dt)

    head = _on_grid(problem, start, released)
    release = (candidate.q, candidate.qd, head[2][-1])
    if problem.ends_at_rest:
        tail = (candidate.q[None], candidate.qd[None], zero[None])
    else:
        tail = _on_grid(problem, release, lambda limits: _brake(release, limits, problem.dt))
    return Solution(join(head, tail, 1.0 / problem.dt), launch)


def arrival(problem: ThrowProblem, candidate: Candidate) -> Arrival | None:
    """Returns the soonest arrival at the candidate; None where Ruckig refuses it."""
    try:
        return soonest(problem, candidate)
    except SolverFailed:
        return None


def launch_time(problem: ThrowProblem, candidate: Candidate) -> float:
    """Returns how soon a launch with zero acceleration at its end releases [s], to a tick; infinite where refused."""
    try:
        return float(least_times(problem, candidate).max())
    except SolverFailed:
        return float("inf")


def _gentle(limits: Limits, candidate: Candidate) -> Limits:
    qd_max = np.maximum(GENTLE_SPEED * limits.qd_max, np.minimum(np.abs(candidate.qd), limits.qd_max))
    return replace(limits, qd_max=qd_max, qdd_max=GENTLE * limits.qdd_max, jerk_max=GENTLE * limits.jerk_max)


def _on_grid(problem: ThrowProblem, start: State, phase: Callable[[Limits], tuple[State, Vector]]) -> State:
    """Returns the samples of a phase on the tick grid, with as little room left as it needs to keep the limits."""
    samples = start
    for room in ROOMS:
        end, qdd = phase(grid_limits(problem.limits, problem.dt, room))
        samples = onto_grid(start, end, qdd, problem.dt, problem.limits.jerk_max)
        if fits(samples, problem.limits, problem.dt):
            break
    return samples


def _synchronised(start: State, end: State, limits: Limits, dt: float) -> Vector:
    """Returns the accelerations at the ticks (N+1, 6) of the joint motion in which all arrive together."""
    motion = calls.reaching(start, end, limits, dt, on_ticks=True)
    return calls.accelerations(motion, calls.ticks(motion, dt), dt)


def _independent(start: State, end: State, limits: Limits, dt: float) -> Vector:
    """Returns the accelerations at the ticks (N+1, 6) with every joint as late and as fast as it can be."""
    motions = [
        calls.reaching(_joint(i, start), _joint(i, end), _one_joint(limits, i), dt, on_ticks=True) for i in range(6)
    ]
    counts = [calls.ticks(motion, dt) for motion in motions]
    qdd = np.zeros((max(counts) + 1, 6))
    for i, (motion, count) in enumerate(zip(motions, counts, strict=True)):
        qdd[max(counts) - count :, i] = calls.accelerations(motion, count, dt)[:, 0]
    return qdd


def _brake(release: State, limits: Limits, dt: float) -> tuple[State, Vector]:
    """Returns the state of rest in which the fastest braking ends, and the accelerations at its ticks (M+1, 6)."""
    motion = calls.resting(release, limits, dt)
    rest = np.array(motion.at_time(motion.duration)[0])
    return (rest, np.zeros(6), np.zeros(6)), calls.accelerations(motion, calls.ticks(motion, dt), dt)


def _joint(i: int, state: State) -> State:
    q, qd, qdd = (x[i : i + 1] for x in state)
    return q, qd, qdd


def _one_joint(limits: Limits, i: int) -> Limits:
    rows = {name: getattr(limits, name)[i : i + 1] for name in ("qd_max", "qdd_max", "jerk_max")}
    return replace(limits, **rows)
