"""Motions by TOPP-RA: the paths of each variant, one after the other, and the speeds at which they join."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from planner.backends.solution import Solution
from planner.backends.toppra_path.parameterization import PathTiming, fastest_timing
from planner.backends.toppra_path.paths import SINGULAR, JointLine, Path, ProfilePath, ToolLine, Vector
from planner.cell import Limits
from planner.errors import SolverFailed
from planner.kinematics import forward, inverse_velocity, jacobian
from planner.problem import ThrowProblem
from planner.rotations import matrix_to_rotation_vector
from planner.seeds import Candidate
from planner.timing import RawMotion, linear_brake, shortest_cubic, shortest_trapezoid, smooth, whole_ticks

PATHS = {  # of each variant, as the plan's status names it
    "joint": "the joint path that a trapezoid of velocity draws",
    "smooth": "the joint path that a cubic draws",
    "cartesian": "a straight line of the tool",
}
VARIANTS = tuple(PATHS)
# [-] lengths of run-up and stopping path tried in turn, as multiples of the least that the acceleration limits allow.
LENGTHS = (1.1, 1.6, 2.5, 4.0, 6.5)
AVERAGE_PASSES = 4  # iterations for the line whose average passes the release; each gains about three digits
PROFILE_SHARE = 0.98  # [-] of the acceleration limits in the profile that draws the path; TOPP-RA needs the rest
SAME_POSTURE_RAD = 1e-6  # [rad] rounding error of the inverse kinematics
RUN_UP = (0.0, 1.0)
STOP = (1.0, 0.0)  # [-] path speeds at the ends of a line up to the release, and of one after it
STANDSTILL_RAD = 1e-9  # [rad] a shorter move is no move


def solve(problem: ThrowProblem, candidate: Candidate, variant: str = "joint") -> Solution:
    """Returns the fastest motion along the variant's path through the candidate to rest.

    Args:
        problem: gives start, limits, tick and cell.
        candidate: the release state.
        variant: one of `VARIANTS`.

    Raises:
        SolverFailed: there is no such path, or no timing of it keeps the limits and has the release's speed.
        BackendUnavailable: toppra is not installed.
    """
    trajectory, width = smooth(problem, candidate, partial(_raw_motion, problem, candidate, variant))
    averaged = f"averaged over {1e3 * width:.0f} ms to keep the jerk limit"
    return Solution(trajectory, f"time-optimal along {PATHS[variant]} without regard to jerk; {averaged}")


def _raw_motion(problem: ThrowProblem, candidate: Candidate, variant: str, limits: Limits, width: int) -> RawMotion:
    """Returns the motion before it is averaged over `width` ticks."""
    if problem.ends_at_rest:
        return _to_rest(problem, candidate, variant, limits, width)
    if variant == "cartesian":
        return _along_tool_line(problem, candidate, limits, width)
    half = width * problem.dt / 2.0
    v = candidate.qd
    d = candidate.q - v * half - problem.start
    profile = shortest_trapezoid if variant == "joint" else shortest_cubic
    gentler = replace(limits, qdd_max=PROFILE_SHARE * limits.qdd_max)
    path = ProfilePath(problem.start, profile(d, v, gentler, problem.dt))
    launch = fastest_timing(path, problem.cell, limits, RUN_UP)
    passage = np.tile(v, (width + 1, 1))
    return RawMotion(_ending_on_tick([launch], problem.dt), passage, _joint_brake(problem, candidate, limits))


def _joint_brake(problem: ThrowProblem, candidate: Candidate, limits: Limits) -> Vector:
    """Returns velocities (M+1, 6) at the ticks of the fastest stop straight along the release velocity."""
    q = candidate.q
    v = candidate.qd
    stop = _stopping_path(candidate.qd, limits)
    if stop < problem.dt:  # almost at rest: TOPP-RA would only see rounding errors
        return linear_brake(v, limits, problem.dt)
    timing = _first_feasible(lambda share: JointLine(q, v, 0.0, share * stop), problem, limits, STOP)
    return _sampled([timing], problem.dt)


def _stopping_path(v: Vector, limits: Limits) -> float:
    """Returns the shortest stopping path [s] from `v` within the acceleration limits, in time at unit path speed."""
    return float((np.abs(v) / limits.qdd_max).max()) / 2.0


def _to_rest(problem: ThrowProblem, candidate: Candidate, variant: str, limits: Limits, width: int) -> RawMotion:
    """Returns a move that ends at rest: straight in joint space, or straight with the tool."""
    if variant == "smooth":
        raise SolverFailed("a move that ends at rest runs straight in joint space or straight with the tool")
    d = candidate.q - problem.start
    if variant == "joint":
        move = _move(problem, problem.start, d, limits)
    else:
        move = [fastest_timing(_tool_line_to_rest(problem, candidate), problem.cell, limits, (0.0, 0.0))]
    launch = _ending_on_tick(move, problem.dt) if move else np.zeros((1, 6))
    return RawMotion(launch, np.zeros((width + 1, 6)), np.zeros((1, 6)))


def _tool_line_to_rest(problem: ThrowProblem, candidate: Candidate) -> ToolLine:
    """Returns the tool's straight line from the start to the candidate over s in [-1, 0], turning about one axis."""
    robot = problem.cell.robot
    X_FT = problem.cell.tool.X_FT
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


def _move(problem: ThrowProblem, start: Vector, d: Vector, limits: Limits) -> list[PathTiming]:
    """Returns the straight joint move over `d` from rest to rest, empty where `d` is zero."""
    if np.abs(d).max() < STANDSTILL_RAD:
        return []
    longest = float(np.abs(d).max())
    return [fastest_timing(JointLine(start, d / longest, 0.0, longest), problem.cell, limits, (0.0, 0.0))]


def _along_tool_line(problem: ThrowProblem, candidate: Candidate, limits: Limits, width: int) -> RawMotion:
    """Returns a joint move to the straight line, the run-up along it, the passage at constant speed and the stop."""
    cell = problem.cell
    half = width * problem.dt / 2.0
    dt = problem.dt
    least = max(_stopping_path(candidate.qd, limits), dt)
    q, qd = _centre(problem, candidate, half)
    passage = _passage(ToolLine(cell, q, qd, -half, half), width, dt, limits)
    run_up = _first_feasible(lambda share: ToolLine(cell, q, qd, -half - share * least, -half), problem, limits, RUN_UP)
    after = _first_feasible(lambda share: ToolLine(cell, q, qd, half, half + share * least), problem, limits, STOP)
    begin = run_up.path.at(run_up.s[:1])[0][0]
    move = _move(problem, problem.start, begin - problem.start, limits)
    return RawMotion(_ending_on_tick([*move, run_up], dt), passage, _sampled([after], dt))


def _passage(line: ToolLine, width: int, dt: float, limits: Limits) -> Vector:
    """Returns the velocities (width+1, 6) at the ticks around the release, with the tool at constant speed."""
    _, qd, qdd = line.at((np.arange(width + 1, dtype=np.float64) - width / 2.0) * dt)
    if (np.abs(qdd) > limits.qdd_max).any():
        raise SolverFailed("a straight line at constant speed exceeds the joint acceleration limits")
    return qd


def _first_feasible(
    path: Callable[[float], Path], problem: ThrowProblem, limits: Limits, ends: tuple[float, float]
) -> PathTiming:
    """Returns the timing of the first path of the `LENGTHS` that has one; after the release without the object."""
    for share in LENGTHS:
        try:
            return fastest_timing(path(share), problem.cell, limits, ends, carrying=ends == RUN_UP)
        except SolverFailed:
            if share == LENGTHS[-1]:
                raise
    raise AssertionError("no lengths")


def _centre(problem: ThrowProblem, candidate: Candidate, half: float) -> tuple[Vector, Vector]:
    """Returns the state (q, qd) at s = 0 of the tool line whose average over [-half, half] is the release state."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    q = candidate.q
    qd = candidate.qd
    for _ in range(AVERAGE_PASSES):
        line = ToolLine(problem.cell, q, qd, -half, half)
        passed = line.at(half * np.array([-1.0, *nodes, 1.0]))[0]
        average = weights / 2.0 @ passed[1:-1]
        change = passed[-1] - passed[0]
        q = q + candidate.q - average
        qd = qd + candidate.qd - change / (2.0 * half)
    return q, qd


def _ending_on_tick(timings: list[PathTiming], dt: float) -> Vector:
    """Returns velocities (N+1, 6) at the ticks of consecutive timings, the last of which ends on the last tick."""
    total = sum(timing.duration_s for timing in timings)
    return _sampled(timings, dt, wait=whole_ticks(total, dt) * dt - total)


def _sampled(timings: list[PathTiming], dt: float, wait: float = 0.0) -> Vector:
    """Returns velocities (N+1, 6) at the ticks of consecutive timings that begin after a `wait` [s]."""
    total = sum(timing.duration_s for timing in timings)
    count = whole_ticks(total, dt)
    t = np.arange(count + 1) * dt - wait
    qd = np.zeros((count + 1, 6))
    begin = 0.0
    for timing in timings:
        rows = (t >= begin) & (t <= begin + timing.duration_s + dt / 2.0)
        qd[rows] = timing.velocities(np.minimum(t[rows] - begin, timing.duration_s))
        begin += timing.duration_s
    return qd
