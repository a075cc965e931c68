"""Answers of a peer, and the parts that all peers share: postures, tick grid, brake."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import ruckig
from numpy.typing import NDArray

from planner.cell import Cell
from planner.certificate import certify
from planner.errors import Infeasible
from planner.problem import ThrowProblem
from planner.seeds import Candidate, candidates
from planner.timing import grid_limits, onto_grid
from planner.trajectory import Trajectory, join

Vector = NDArray[np.float64]
Samples = tuple[Vector, Vector, Vector]

POSTURES = 3  # best ones that a peer may try


class PeerMissing(Exception):
    """The peer is not installed."""


@dataclass(frozen=True)
class PeerAnswer:
    """A motion, or the reason why there is none.

    Attributes:
        motion: Motion on ticks with its brake, certified or not; None without a launch.
        solve_s: The peer's own time, without grid, brake and certificate [s].
        reason: Reason without a motion.
    """

    motion: Trajectory | None
    solve_s: float
    reason: str = ""


@dataclass(frozen=True)
class PeerPlanner:
    """A peer.

    Attributes:
        title: Name in the tables.
        solve: Plans one problem.
        ignored: Checks of the certificate that it does not promise.
        tasks: Number of tasks it gets; 0 for all.
        prepare: Builds what is not timed.
    """

    title: str
    solve: Callable[[ThrowProblem], PeerAnswer]
    ignored: tuple[str, ...] = ()
    tasks: int = 0
    prepare: Callable[[Cell], None] = lambda _: None


def first_certified(problem: ThrowProblem, launch: Callable[[ThrowProblem, Candidate], Samples | None]) -> PeerAnswer:
    """Returns the first certified motion over the best postures, or else the last motion.

    Args:
        problem: The problem.
        launch: Plans a launch to one release state; None without one.
    """
    spent, motion, reason = 0.0, None, "no launch found"
    try:
        postures = candidates(problem)[:POSTURES]
    except Infeasible as refusal:
        return PeerAnswer(None, 0.0, str(refusal))
    for state in postures:
        started_at = time.perf_counter()
        head = launch(problem, state)
        spent += time.perf_counter() - started_at
        if head is None:
            continue
        motion = join(head, braked(problem, state, head[2][-1]), float(problem.cell.robot.sample_rate_hz))
        if certify(problem, motion).valid:
            break
    return PeerAnswer(motion, spent, "" if motion is not None else reason)


def gridded(problem: ThrowProblem, state: Candidate, qdd: Vector) -> Samples:
    """Returns a launch on ticks from its accelerations (N+1, 6) at the ticks [rad/s^2]."""
    start = (problem.start, np.zeros(6), qdd[0])
    return onto_grid(start, (state.q, state.qd, qdd[-1]), qdd, problem.dt, problem.limits.jerk_max)


def braked(problem: ThrowProblem, state: Candidate, qdd: Vector) -> Samples:
    """Returns the fastest brake from the release, on ticks."""
    limits, dt = grid_limits(problem.limits, problem.dt), problem.dt
    request = ruckig.InputParameter(6)
    request.current_position, request.current_velocity, request.current_acceleration = state.q, state.qd, qdd
    request.target_velocity, request.target_acceleration = np.zeros(6), np.zeros(6)
    request.max_velocity = np.maximum(limits.qd_max, np.abs(state.qd))
    request.max_acceleration, request.max_jerk = np.maximum(limits.qdd_max, np.abs(qdd)), limits.jerk_max
    request.control_interface = ruckig.ControlInterface.Velocity
    request.duration_discretization = ruckig.DurationDiscretization.Discrete
    motion = ruckig.Trajectory(6)
    ruckig.Ruckig(6, dt).calculate(request, motion)
    count = max(3, round(motion.duration / dt))
    samples = np.array([motion.at_time(i * dt)[2] for i in range(count + 1)])
    rest = np.array(motion.at_time(motion.duration)[0])
    return onto_grid((state.q, state.qd, qdd), (rest, np.zeros(6), np.zeros(6)), samples, dt, problem.limits.jerk_max)
