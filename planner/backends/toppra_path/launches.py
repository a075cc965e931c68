"""The motions offered: which paths they run along, one after the other, and at which speeds they pass the joints."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.backends.toppra_path.paths import DrawnPath, JointLine, ToolLine
from planner.backends.toppra_path.timing import Timing, fastest
from planner.cell import Limits
from planner.errors import SolverFailed
from planner.problem import ThrowProblem
from planner.release import Candidate
from planner.smoothing import RawMotion
from planner.velocity_profiles import shortest_cubic, shortest_trapezoid

Vector = NDArray[np.float64]

LAUNCHES = {
    "joint": "the joint path that a trapezoid of velocity draws",
    "smooth": "the joint path that a cubic draws",
    "cartesian": "a straight line of the tool",
}
RUN_UPS = (1.1, 1.6, 2.5, 4.0, 6.5)  # [-] multiples of the shortest run-up that the acceleration limits could allow
STOPS = RUN_UPS
AVERAGE_PASSES = 4  # of finding the line whose average passes the release; each gains about three digits
DRAWN_SHARE = 0.98  # [-] of the acceleration limits used by the motion that draws the path: TOPP-RA needs some room
STANDSTILL_RAD = 1e-9  # a move shorter than this is none


def raw_motion(problem: ThrowProblem, candidate: Candidate, path: str, limits: Limits, width: int) -> RawMotion:
    """Returns the motion before averaging over `width` ticks.

    Raises:
        SolverFailed: there is none along this path.
    """
    if problem.ends_at_rest:
        return _to_rest(problem, candidate, path, limits, width)
    if path == "cartesian":
        return _along_tool_line(problem, candidate, limits, width)
    half, v = width * problem.dt / 2.0, candidate.qd
    d = candidate.q - v * half - problem.start
    shape = shortest_trapezoid if path == "joint" else shortest_cubic
    gentler = replace(limits, qdd_max=DRAWN_SHARE * limits.qdd_max)
    drawn = DrawnPath(problem.start, shape(d, v, gentler, problem.dt))
    launch = fastest(drawn, problem.cell, limits, (0.0, 1.0))
    stop = _stop(v, limits)
    brake = fastest(
        JointLine(candidate.q, v, half, half + 1.05 * stop), problem.cell, limits, (1.0, 0.0), carrying=False
    )
    passage = np.tile(v, (width + 1, 1))
    return RawMotion(_late([launch], problem.dt), passage, _early(brake, problem.dt))


def _stop(v: Vector, limits: Limits) -> float:
    """Returns the path length (in s of unit speed) in which the acceleration limits allow to stop from `v`."""
    return float((np.abs(v) / limits.qdd_max).max()) / 2.0


def _to_rest(problem: ThrowProblem, candidate: Candidate, path: str, limits: Limits, width: int) -> RawMotion:
    d = candidate.q - problem.start
    if path != "joint":
        raise SolverFailed("a move that ends at rest has one path, the straight one in joint space")
    move = _move(problem, problem.start, d, limits)
    launch = _late(move, problem.dt) if move else np.zeros((1, 6))
    return RawMotion(launch, np.zeros((width + 1, 6)), np.zeros((1, 6)))


def _move(problem: ThrowProblem, start: Vector, d: Vector, limits: Limits) -> list[Timing]:
    """Returns the straight joint move over `d` from rest to rest, none where it is no move."""
    if np.abs(d).max() < STANDSTILL_RAD:
        return []
    return [fastest(JointLine(start, d, 0.0, 1.0), problem.cell, limits, (0.0, 0.0))]


def _along_tool_line(problem: ThrowProblem, candidate: Candidate, limits: Limits, width: int) -> RawMotion:
    """A move to where the straight line begins, the run-up along it, the passage at constant speed, the stop on it."""
    cell, dt, half = problem.cell, problem.dt, width * problem.dt / 2.0
    least = _stop(candidate.qd, limits)
    centre = _centre(problem, candidate, half)
    passage = _passage(ToolLine(cell, *centre, -half, half), width, dt, limits)
    run_up = _first(
        RUN_UPS, lambda share: fastest(ToolLine(cell, *centre, -half - share * least, -half), cell, limits, (0.0, 1.0))
    )
    brake = _first(
        STOPS,
        lambda share: fastest(
            ToolLine(cell, *centre, half, half + share * least), cell, limits, (1.0, 0.0), carrying=False
        ),
    )
    begin = run_up.path.at(run_up.s[:1])[0][0]
    move = _move(problem, problem.start, begin - problem.start, limits)
    return RawMotion(_late([*move, run_up], dt), passage, _early(brake, dt))


def _passage(line: ToolLine, width: int, dt: float, limits: Limits) -> Vector:
    """Returns the velocities (width+1, 6) at ticks around the release, the tool at constant speed."""
    _, qd, qdd = line.at((np.arange(width + 1, dtype=np.float64) - width / 2.0) * dt)
    if (np.abs(qdd) > limits.qdd_max).any():
        raise SolverFailed("a straight line at constant speed takes more joint acceleration than there is")
    return qd


def _first(shares, attempt):
    """Returns the first attempt that succeeds."""
    failure = SolverFailed("nothing was tried")
    for share in shares:
        try:
            return attempt(share)
        except SolverFailed as error:
            failure = error
    raise failure


def _centre(problem: ThrowProblem, candidate: Candidate, half: float) -> tuple[Vector, Vector]:
    """Returns the state (q, qd) at s = 0 of the tool line whose average over [-half, half] is the release state."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    q, qd = candidate.q, candidate.qd
    for _ in range(AVERAGE_PASSES):
        line = ToolLine(problem.cell, q, qd, -half, half)
        passed = line.at(half * np.array([-1.0, *nodes, 1.0]))[0]
        average, change = weights / 2.0 @ passed[1:-1], passed[-1] - passed[0]
        q, qd = q + candidate.q - average, qd + candidate.qd - change / (2.0 * half)
    return q, qd


def _late(timings: list[Timing], dt: float) -> Vector:
    """Returns velocities (N+1, 6) at ticks of the timings one after the other, which end on the last tick."""
    total = sum(timing.duration_s for timing in timings)
    count = math.ceil(total / dt)
    t = np.arange(count + 1) * dt - (count * dt - total)
    qd, begin = np.zeros((count + 1, 6)), 0.0
    for timing in timings:
        rows = (t >= begin) & (t <= begin + timing.duration_s + dt / 2.0)
        qd[rows] = timing.velocities(np.minimum(t[rows] - begin, timing.duration_s))
        begin += timing.duration_s
    return qd


def _early(timing: Timing, dt: float) -> Vector:
    """Returns velocities (M+1, 6) at ticks of a timing that begins on the first one."""
    count = math.ceil(timing.duration_s / dt)
    t = np.arange(count + 1) * dt
    qd = timing.velocities(np.minimum(t, timing.duration_s))
    return np.where((t <= timing.duration_s)[:, None], qd, 0.0)
