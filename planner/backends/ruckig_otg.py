"""Ruckig: the microsecond answer. State to state in joint space, jerk-limited, time-optimal for each joint.

The release acceleration is zero. Three launches are offered: `synchronised` stretches every joint to the slowest one's
time, `independent` lets every joint run its own fastest motion and wait at rest before it, and `gentle` is synchronised
with half the acceleration and jerk and less speed: later, but easy on torques and on the tool's speed on the way.
Source: Berscheid and Kroeger, Jerk-limited Real-time Trajectory Generation with Arbitrary Target States, RSS 2021.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.cell import Limits
from planner.errors import BackendUnavailable, SolverFailed
from planner.grid import ROOMS, fits, grid_limits, onto_grid
from planner.problem import ThrowProblem
from planner.release import Candidate
from planner.solution import Solution
from planner.trajectory import join

Vector = NDArray[np.float64]
State = tuple[Vector, Vector, Vector]

LAUNCHES = ("synchronised", "independent", "gentle")
SPARE = LAUNCHES[-1]  # never the soonest: for where the others are not certified
GENTLE_SPEED, GENTLE = 0.6, 0.5  # [-] of the limits on velocity, and on acceleration and jerk
TICKS_MAX = 20_000  # a phase longer than this is no throw


def solve(problem: ThrowProblem, candidate: Candidate, launch: str = "synchronised") -> Solution:
    """Returns the fastest motion to the candidate with zero acceleration there, and from there to rest.

    Args:
        problem: whose start and limits hold.
        candidate: the release state.
        launch: one of `LAUNCHES`.

    Raises:
        SolverFailed: Ruckig refuses the states, as when the release is faster than the limits.
        BackendUnavailable: ruckig is not installed.
    """
    ruckig, zero = _ruckig(), np.zeros(6)
    start, release = (problem.start, zero, zero), (candidate.q, candidate.qd, zero)
    if launch == "gentle":
        problem = replace(problem, limits=_gentle(problem.limits, candidate))
    way = _independent if launch == "independent" else _synchronised
    head = _on_grid(problem, start, lambda limits: (release, way(ruckig, start, release, limits, problem.dt)))
    if problem.ends_at_rest:
        tail = (candidate.q[None], candidate.qd[None], zero[None])
    else:
        tail = _on_grid(problem, release, lambda limits: _brake(ruckig, release, limits, problem.dt))
    return Solution(join(head, tail, 1.0 / problem.dt), launch)


@dataclass(frozen=True, eq=False)
class Rough:
    """Ruckig's synchronised motion as it comes, not on ticks: a first guess for others.

    Attributes:
        launch: to the release; Ruckig's trajectory.
        brake: from there to rest; None for a move that ends at rest.
    """

    launch: Any
    brake: Any

    @property
    def release_time_s(self) -> float:
        """Duration of the launch [s]."""
        return float(self.launch.duration)

    @property
    def duration_s(self) -> float:
        """Duration of the whole [s]."""
        return self.release_time_s + (float(self.brake.duration) if self.brake else 0.0)

    def at(self, t: ArrayLike) -> State:
        """Returns q, qd, qdd (n, 6) at times `t` (n,) [s]."""
        times, released = np.asarray(t, float), self.release_time_s
        states = [
            self.launch.at_time(s) if s <= released or not self.brake else self.brake.at_time(s - released)
            for s in times.tolist()
        ]
        q, qd, qdd = (np.array(column) for column in zip(*states, strict=True))
        return q, qd, qdd


def rough(problem: ThrowProblem, candidate: Candidate) -> Rough:
    """Returns a first guess of a motion to the candidate and from there to rest.

    Raises:
        SolverFailed: Ruckig refuses the states.
        BackendUnavailable: ruckig is not installed.
    """
    ruckig, zero, dt = _ruckig(), np.zeros(6), problem.dt
    release = (candidate.q, candidate.qd, zero)
    launch = _calculate(ruckig, _input(ruckig, (problem.start, zero, zero), release, problem.limits), dt)
    brake = None if problem.ends_at_rest else _braking(ruckig, release, problem.limits, dt)
    return Rough(launch, brake)


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


def least_times(problem: ThrowProblem, candidate: Candidate) -> Vector:
    """Returns each joint's own least time (6,) [s] to the candidate with zero acceleration there."""
    ruckig, zero = _ruckig(), np.zeros(6)
    start, release = (problem.start, zero, zero), (candidate.q, candidate.qd, zero)
    motion = _calculate(ruckig, _input(ruckig, start, release, problem.limits), problem.dt)
    return np.array(motion.independent_min_durations)


def launch_time(problem: ThrowProblem, candidate: Candidate) -> float:
    """Returns how soon `solve` releases in the candidate [s], to a tick; infinite where Ruckig refuses it."""
    try:
        return float(least_times(problem, candidate).max())
    except SolverFailed:
        return float("inf")


def _ruckig() -> ModuleType:
    try:
        import ruckig
    except ImportError as error:
        raise BackendUnavailable("ruckig", "ruckig") from error
    return ruckig


def _synchronised(ruckig: ModuleType, start: State, end: State, limits: Limits, dt: float) -> Vector:
    """Returns the accelerations at the ticks (N+1, 6) of the joint motion in which all arrive together."""
    request = _input(ruckig, start, end, limits)
    request.duration_discretization = ruckig.DurationDiscretization.Discrete
    motion = _calculate(ruckig, request, dt)
    return _sample(motion, _ticks(motion.duration, dt), dt)


def _independent(ruckig: ModuleType, start: State, end: State, limits: Limits, dt: float) -> Vector:
    """Returns the accelerations at the ticks (N+1, 6) with every joint as late and as fast as it can be."""
    motions = []
    for i in range(6):
        own = _input(ruckig, _joint(i, start), _joint(i, end), _one_joint(limits, i))
        own.duration_discretization = ruckig.DurationDiscretization.Discrete
        motions.append(_calculate(ruckig, own, dt))
    counts = [_ticks(motion.duration, dt) for motion in motions]
    qdd = np.zeros((max(counts) + 1, 6))
    for i, (motion, count) in enumerate(zip(motions, counts, strict=True)):
        qdd[max(counts) - count :, i] = _sample(motion, count, dt)[:, 0]
    return qdd


def _brake(ruckig: ModuleType, release: State, limits: Limits, dt: float) -> tuple[State, Vector]:
    """Returns the state of rest in which the fastest braking ends, and the accelerations at its ticks (M+1, 6)."""
    motion = _braking(ruckig, release, limits, dt)
    count = _ticks(motion.duration, dt)
    rest = np.array(motion.at_time(motion.duration)[0])
    return (rest, np.zeros(6), np.zeros(6)), _sample(motion, count, dt)


def _braking(ruckig: ModuleType, release: State, limits: Limits, dt: float) -> Any:
    request = _input(ruckig, release, (np.zeros(6), np.zeros(6), np.zeros(6)), limits)
    request.control_interface = ruckig.ControlInterface.Velocity
    request.duration_discretization = ruckig.DurationDiscretization.Discrete
    return _calculate(ruckig, request, dt)


def _input(ruckig: ModuleType, start: State, end: State, limits: Limits) -> Any:
    request = ruckig.InputParameter(len(start[0]))
    request.current_position, request.current_velocity, request.current_acceleration = (x.tolist() for x in start)
    request.target_position, request.target_velocity, request.target_acceleration = (x.tolist() for x in end)
    # A release at the very limit is allowed: only the way there keeps the room that the grid needs.
    request.max_velocity = np.maximum(limits.qd_max, np.abs(end[1])).tolist()
    request.max_acceleration, request.max_jerk = limits.qdd_max.tolist(), limits.jerk_max.tolist()
    return request


def _calculate(ruckig: ModuleType, request: Any, dt: float) -> Any:
    motion = ruckig.Trajectory(request.degrees_of_freedom)
    try:
        result = ruckig.Ruckig(request.degrees_of_freedom, dt).calculate(request, motion)
    except ruckig.RuckigError as error:
        raise SolverFailed(f"ruckig refuses the request: {error}") from error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise SolverFailed(f"ruckig answers {result}")
    return motion


def _ticks(duration: float, dt: float) -> int:
    count = max(3, round(duration / dt))
    if count > TICKS_MAX:
        raise SolverFailed(f"the motion would take {duration:.1f} s")
    return count


def _sample(motion: Any, count: int, dt: float) -> Vector:
    return np.array([motion.at_time(i * dt)[2] for i in range(count + 1)])


def _joint(i: int, state: State) -> State:
    q, qd, qdd = (x[i : i + 1] for x in state)
    return q, qd, qdd


def _one_joint(limits: Limits, i: int) -> Limits:
    rows = {name: getattr(limits, name)[i : i + 1] for name in ("qd_max", "qdd_max", "jerk_max")}
    return replace(limits, **rows)
