"""The textbook formulation of the problem: multiple shooting with equal intervals, IPOPT, no warm start.

Launch and brake each have a free duration; jerk is constant on an interval. Constraints hold at the nodes: joint
limits, torques, tool speed, floor, singularities near the release; the velocity limit also at the control point between
nodes. Self-collision is left to the certificate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.answer import PeerAnswer, Samples, first_certified, gridded
from planner.backends.casadi_nlp import arm_symbols as arm
from planner.cell import Cell
from planner.geometry import body_capsules
from planner.problem import ThrowProblem
from planner.seeds import Candidate
from planner.timing import grid_limits

Vector = NDArray[np.float64]

LAUNCH, BRAKE = 24, 12  # intervals
DURATION_S = (0.05, 5.0)  # [s] limits of each phase
TIME_LIMIT_S = 10.0  # [s]
BRAKE_WEIGHT = 0.05  # [-] as in Fling's objective
MARGIN = 1e-3  # [m], [1] of the constraints at the nodes, for the motion between them


def solve(problem: ThrowProblem) -> PeerAnswer:
    """Returns the motion for a `pose` or `joint` release."""
    return first_certified(problem, _launch)


@dataclass(frozen=True)
class ShootingProgram:
    """IPOPT with the shooting problem of a cell, and its constraint bounds."""

    solver: Any
    lower: Vector
    upper: Vector
    variables: int


def _launch(problem: ThrowProblem, state: Candidate) -> Samples | None:
    first = _optimise(problem, state, None)
    if first is None:
        return None
    ticks = math.ceil(first[0] / problem.dt - 1e-6)
    second = _optimise(problem, state, (ticks * problem.dt, first[2]))
    if second is None:
        return None
    at = np.arange(ticks + 1) * problem.dt
    nodes = np.linspace(0.0, ticks * problem.dt, LAUNCH + 1)
    return gridded(problem, state, np.stack([np.interp(at, nodes, a) for a in second[1].T], axis=1))


def _optimise(
    problem: ThrowProblem, state: Candidate, fixed: tuple[float, Vector] | None
) -> tuple[float, Vector, Vector] | None:
    """Returns duration [s] and accelerations (LAUNCH+1, 6) of the launch, and all variables; None if IPOPT fails."""
    program = _program(problem.cell)
    lower, upper, initial_guess = _variable_bounds(problem, state)
    if fixed is not None:
        lower[0] = upper[0] = fixed[0]
        initial_guess = fixed[1]
    program_lower, program_upper = program.lower, program.upper
    found = program.solver(x0=initial_guess, lbx=lower, ubx=upper, lbg=program_lower, ubg=program_upper)
    if not program.solver.stats()["success"]:
        return None
    x = np.array(found["x"]).ravel()
    nodes = x[2 : 2 + 18 * (LAUNCH + BRAKE + 1)].reshape(-1, 18)
    return float(x[0]), nodes[: LAUNCH + 1, 12:], x


def _variable_bounds(problem: ThrowProblem, state: Candidate) -> tuple[Vector, Vector, Vector]:
    limits, count = grid_limits(problem.limits, problem.dt), LAUNCH + BRAKE
    top = np.maximum(limits.qd_max, np.abs(state.qd))
    low = np.tile(np.concatenate([limits.q_lower, -top, -limits.qdd_max]), (count + 1, 1))
    high = np.tile(np.concatenate([limits.q_upper, top, limits.qdd_max]), (count + 1, 1))
    rest, there = np.concatenate([problem.start, np.zeros(12)]), np.concatenate([state.q, state.qd])
    low[0], high[0] = rest, rest
    low[LAUNCH, :12], high[LAUNCH, :12] = there, there
    low[-1, 6:], high[-1, 6:] = 0.0, 0.0
    jerk = np.tile(limits.jerk_max, count)
    lower = np.concatenate([np.full(2, DURATION_S[0]), low.ravel(), -jerk])
    upper = np.concatenate([np.full(2, DURATION_S[1]), high.ravel(), jerk])
    share = np.concatenate([np.linspace(0.0, 1.0, LAUNCH + 1), np.ones(BRAKE)])[:, None]
    guess_q = problem.start + share * (state.q - problem.start)
    nodes = np.concatenate([guess_q, np.zeros((count + 1, 12))], axis=1)
    duration = np.array([max(1.2 * state.bound_s, 0.2), 0.3])
    return lower, upper, np.concatenate([duration, nodes.ravel(), np.zeros(6 * count)])


_PROGRAMS: dict[str, ShootingProgram] = {}


def _program(cell: Cell) -> ShootingProgram:
    """Returns the program of a cell, built once."""
    if cell.name not in _PROGRAMS:
        _PROGRAMS[cell.name] = _build(cell)
    return _PROGRAMS[cell.name]


def prepare(cell: Cell) -> None:
    """Builds the program of a cell, so that building is not timed."""
    _program(cell)


def _build(cell: Cell) -> ShootingProgram:
    T, count = ca.MX.sym("T", 2), LAUNCH + BRAKE
    X, J = ca.MX.sym("X", 18, count + 1), ca.MX.sym("J", 6, count)
    h = ca.horzcat(*([T[0] / LAUNCH] * LAUNCH + [T[1] / BRAKE] * BRAKE))
    step, rows = _step(), _rows(cell)
    gaps = X[:, 1:] - step.map(count)(X[:, :-1], J, h)
    held = rows.map(count + 1)(X)
    near = _singular(cell).map(3)(X[:, LAUNCH - 1 : LAUNCH + 2])
    between = X[6:12, :-1] + ca.repmat(h, 6, 1) * X[12:, :-1] / 2
    g = ca.vertcat(ca.vec(gaps), ca.vec(held), ca.vec(near), ca.vec(between))
    x = ca.vertcat(T, ca.vec(X), ca.vec(J))
    cost = T[0] + BRAKE_WEIGHT * T[1] + 1e-9 * ca.sumsqr(J)
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.max_wall_time": TIME_LIMIT_S, "ipopt.tol": 1e-6}
    solver = ca.nlpsol("plain", "ipopt", {"x": x, "f": cost, "g": g}, options)
    tau, clear = 0.98 * cell.limits.tau_max, cell.surroundings.clearance_m + cell.surroundings.floor_z_m + MARGIN
    heights = rows.size1_out(0) - 7
    low = np.concatenate([-tau, [0.0], np.full(heights, clear)])
    high = np.concatenate([tau, [(cell.limits.tcp_speed_max * (1.0 - MARGIN)) ** 2], np.full(heights, np.inf)])
    least = np.full(9, (cell.limits.singularity_distance_min + MARGIN) ** 2)
    fast = np.tile(cell.limits.qd_max, count)
    lower = np.concatenate([np.zeros(18 * count), np.tile(low, count + 1), least, -fast])
    upper = np.concatenate([np.zeros(18 * count), np.tile(high, count + 1), np.full(9, np.inf), fast])
    return ShootingProgram(solver, lower, upper, x.shape[0])


def _step() -> Any:
    x, j, h = ca.SX.sym("x", 18), ca.SX.sym("j", 6), ca.SX.sym("h")
    q, v, a = x[:6], x[6:12], x[12:]
    after = ca.vertcat(q + h * (v + h * (a / 2 + h * j / 6)), v + h * (a + h * j / 2), a + h * j)
    return ca.Function("step", [x, j, h], [after])


def _rows(cell: Cell) -> Any:
    """Returns torques (6), squared tool speed, and the heights of the capsules' ends, of one node."""
    x = ca.SX.sym("x", 18)
    q, qd, qdd = x[:6], x[6:12], x[12:]
    dh = ca.SX(_lengths(cell))
    up = cell.X_WB[:3, :3].T @ np.array([0.0, 0.0, cell.surroundings.gravity_m_s2])
    tau = arm.torques(dh, ca.SX(_links(cell)), ca.SX(up), q, qd, qdd)
    p_FT = cell.tool.X_FT[:3, 3]
    tool = arm.tool_motion(dh, ca.SX(p_FT), q, qd, qdd)
    frames, turn = arm.frames(dh, q), arm.turn(q[0])
    heights = []
    for c in [c for c in body_capsules(cell.robot, cell.tool.capsules) if c.frame > 1]:
        for end in (c.p0, c.p1):
            p_B = turn @ frames.point(c.frame, ca.SX(end))
            heights.append((ca.SX(cell.X_WB[2:3, :3]) @ p_B) + cell.X_WB[2, 3] - c.radius_m)
    return ca.Function("rows", [x], [ca.vertcat(tau, ca.sumsqr(tool.velocity), *heights)])


def _singular(cell: Cell) -> Any:
    x = ca.SX.sym("x", 18)
    shoulder = arm.shoulder_distance(ca.SX(_lengths(cell)), x[:6])
    return ca.Function("singular", [x], [ca.vertcat(ca.sin(x[4]) ** 2, ca.sin(x[2]) ** 2, shoulder**2)])


def _lengths(cell: Cell) -> Vector:
    a, d = cell.robot.a, cell.robot.d
    return np.array([d[0], a[1], a[2], d[3], d[4], d[5]])


def _links(cell: Cell) -> Vector:
    """Returns mass, first moment, inertia about the frame's origin of the six links, tool and object on the last."""
    p = cell.tool.X_FT[:3, 3]
    rows = []
    for i, link in enumerate(cell.robot.links):
        points = [] if i < 5 else [(cell.tool.mass_kg, 0.5 * p), (cell.object.mass_kg, p)]
        mass = link.mass + sum(m for m, _ in points)
        moment = link.mass * link.com + sum((m * c for m, c in points), np.zeros(3))
        inertia = link.inertia + sum((_about(m, c) for m, c in points), _about(link.mass, link.com))
        rows.append([mass, *moment, *inertia[np.triu_indices(3)]])
    return np.array(rows).ravel()


def _about(mass: float, at: Vector) -> Vector:
    return mass * (at @ at * np.eye(3) - np.outer(at, at))
