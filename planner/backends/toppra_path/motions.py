"""The motions offered: which paths they run along, one after the other, and at which speeds they pass the joints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from planner.backends.toppra_path.paths import SINGULAR, DrawnPath, JointLine, ToolLine
from planner.backends.toppra_path.timing import Timing, fastest
from planner.cell import Limits
from planner.errors import SolverFailed
from planner.kinematics import forward, inverse_velocity, jacobian
from planner.problem import ThrowProblem
from planner.rotations import matrix_to_rotation_vector
from planner.seeds.candidates import Candidate
from planner.timing.smoothing import RawMotion
from planner.timing.velocity_profiles import linear_brake, shortest_cubic, shortest_trapezoid, whole_ticks

Vector = NDArray[np.float64]

LAUNCHES = {
    "joint": "the joint path that a trapezoid of velocity draws",
    "smooth": "the joint path that a cubic draws",
    "cartesian": "a straight line of the tool",
}
# Multiples tried one after the other of the shortest run-up, or way to stop, that the acceleration limits could allow.
RUN_UPS = (1.1, 1.6, 2.5, 4.0, 6.5)
AVERAGE_PASSES = 4  # of finding the line whose average passes the release; each gains about three digits
DRAWN_SHARE = 0.98  # [-] of the acceleration limits used by the motion that draws the path: TOPP-RA needs some room
SAME_POSTURE_RAD = 1e-6  # rounding of the inverse kinematics
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
    passage = np.tile(v, (width + 1, 1))
    return RawMotion(_late([launch], problem.dt), passage, _joint_brake(problem, candidate, limits))


def _joint_brake(problem: ThrowProblem, candidate: Candidate, limits: Limits) -> Vector:
    """Returns velocities (M+1, 6) at ticks of the fastest stop straight along the release velocity."""
    q, v, stop = candidate.q, candidate.qd, _stop(candidate.qd, limits)
    if stop < problem.dt:  # next to standing: TOPP-RA would only meet its own rounding
        return linear_brake(v, limits, problem.dt)
    line = partial(JointLine, q, v, 0.0)
    return _early(
        _first(lambda share: fastest(line(share * stop), problem.cell, limits, (1.0, 0.0), False)), problem.dt
    )


def _stop(v: Vector, limits: Limits) -> float:
    """Returns the path length (in s of unit speed) in which the acceleration limits allow to stop from `v`."""
    return float((np.abs(v) / limits.qdd_max).max()) / 2.0


def _to_rest(problem: ThrowProblem, candidate: Candidate, path: str, limits: Limits, width: int) -> RawMotion:
    """A move that ends at rest: a straight line of the joints, or of the tool."""
    if path == "smooth":
        raise SolverFailed("a move that ends at rest runs straight in joint space or straight with the tool")
    d = candidate.q - problem.start
    if path == "joint":
        move = _move(problem, problem.start, d, limits)
    else:
        move = [fastest(_tool_line_to_rest(problem, candidate), problem.cell, limits, (0.0, 0.0))]
    launch = _late(move, problem.dt) if move else np.zeros((1, 6))
    return RawMotion(launch, np.zeros((width + 1, 6)), np.zeros((1, 6)))


def _tool_line_to_rest(problem: ThrowProblem, candidate: Candidate) -> ToolLine:
    """Returns the tool's straight line from the start to the candidate, turning about one axis, over s in [-1, 0]."""
    robot, X_FT = problem.cell.robot, problem.cell.tool.X_FT
    X_start, X_end = (forward(robot, q, X_FT) for q in (problem.start, candidate.q))
    turn = matrix_to_rotation_vector(X_end[:3, :3] @ X_start[:3, :3].T)
    twist = np.concatenate([X_end[:3, 3] - X_start[:3, 3], turn])
    try:
        dq = inverse_velocity(jacobian(robot, candidate.q, X_FT), twist)
    except np.linalg.LinAlgError as error:
        raise SolverFailed(SINGULAR) from error
    line = ToolLine(problem.cell, candidate.q, dq, -1.0, 0.0)
    if np.abs(line.at(np.array([-1.0]))[0][0] - problem.start).max() > SAME_POSTURE_RAD:
        raise SolverFailed("the tool's straight line leads to the release in another posture")
    return line


def _move(problem: ThrowProblem, start: Vector, d: Vector, limits: Limits) -> list[Timing]:
    """Returns the straight joint move over `d` from rest to rest, none where it is no move."""
    if np.abs(d).max() < STANDSTILL_RAD:
        return []
    longest = float(np.abs(d).max())
    return [fastest(JointLine(start, d / longest, 0.0, longest), problem.cell, limits, (0.0, 0.0))]


def _along_tool_line(problem: ThrowProblem, candidate: Candidate, limits: Limits, width: int) -> RawMotion:
    """A move to where the straight line begins, the run-up along it, the passage at constant speed, the stop on it."""
    cell, dt, half = problem.cell, problem.dt, width * problem.dt / 2.0
    least = max(_stop(candidate.qd, limits), dt)
    q, qd = _centre(problem, candidate, half)
    passage = _passage(ToolLine(cell, q, qd, -half, half), width, dt, limits)
    run_up = _first(
        lambda share: fastest(ToolLine(cell, q, qd, -half - share * least, -half), cell, limits, (0.0, 1.0))
    )
    after = _first(
        lambda share: fastest(ToolLine(cell, q, qd, half, half + share * least), cell, limits, (1.0, 0.0), False)
    )
    begin = run_up.path.at(run_up.s[:1])[0][0]
    move = _move(problem, problem.start, begin - problem.start, limits)
    return RawMotion(_late([*move, run_up], dt), passage, _early(after, dt))


def _passage(line: ToolLine, width: int, dt: float, limits: Limits) -> Vector:
    """Returns the velocities (width+1, 6) at ticks around the release, the tool at constant speed."""
    _, qd, qdd = line.at((np.arange(width + 1, dtype=np.float64) - width / 2.0) * dt)
    if (np.abs(qdd) > limits.qdd_max).any():
        raise SolverFailed("a straight line at constant speed takes more joint acceleration than there is")
    return qd


def _first(attempt: Callable[[float], Timing]) -> Timing:
    """Returns the first attempt over `RUN_UPS` that succeeds."""
    for share in RUN_UPS[:-1]:
        try:
            return attempt(share)
        except SolverFailed:
            continue
    return attempt(RUN_UPS[-1])


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
    count = whole_ticks(total, dt)
    t = np.arange(count + 1) * dt - (count * dt - total)
    qd, begin = np.zeros((count + 1, 6)), 0.0
    for timing in timings:
        rows = (t >= begin) & (t <= begin + timing.duration_s + dt / 2.0)
        qd[rows] = timing.velocities(np.minimum(t[rows] - begin, timing.duration_s))
        begin += timing.duration_s
    return qd


def _early(timing: Timing, dt: float) -> Vector:
    """Returns velocities (M+1, 6) at ticks of a timing that begins on the first one."""
    count = whole_ticks(timing.duration_s, dt)
    t = np.arange(count + 1) * dt
    qd = timing.velocities(np.minimum(t, timing.duration_s))
    return np.where((t <= timing.duration_s)[:, None], qd, 0.0)
