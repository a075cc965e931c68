"""Solving one request: launch and brake of least time, then the same on whole ticks."""

# long: one task from its bounds to its answer; the steps share the problem, the shape and the solver's vector
from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.backends.casadi_nlp import answer, codegen, exactness, solvers
from planner.backends.casadi_nlp.assembly import Shape, Table, assemble
from planner.backends.casadi_nlp.blocks import Block, interpreted
from planner.backends.casadi_nlp.layout import NZ, STEP, TIME, TIME_SCALE
from planner.backends.casadi_nlp.request import (
    CLOSE,
    WIDE,
    Margins,
    Request,
    Start,
    arguments,
    guess,
    pattern_of,
    shape_of,
)
from planner.ballistics import fly
from planner.errors import SolverFailed
from planner.grid import grid_limits
from planner.kinematics import forward, jacobian
from planner.problem import JointRelease, PoseRelease, TargetRelease, ThrowProblem
from planner.release import Candidate
from planner.solution import Solution
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

# source of the options: measured on random problems; the LU tolerance keeps fatrop 1.1.8 from an endless factorisation
FATROP = {"tolerance": 1e-4, "mu_init": 1e-3, "max_iter": 100, "linsol_lu_fact_tol": 1e-2}
POLISH = {**FATROP, "mu_init": 1e-4, "max_iter": 40}  # begins near its optimum
IPOPT = {"tol": 1e-5, "mu_init": 1e-3, "max_iter": 80}
SECOND_TRY_S = 0.15  # [s] of time left that IPOPT is worth
EXTRA_TICKS = (1, 2, 3)  # given to launch and brake where the first whole number of ticks does not do
PATTERNS_MAX = 64  # solvers kept: a few for each kind of release
DRAG_ROUNDS = 3  # corrections of the aim for drag; each leaves a tenth of the error or less


@dataclass(frozen=True)
class Machine:
    """An assembled problem."""

    shape: Shape
    table: Table
    blocks: dict[str, Block]
    functions: dict[str, Any]


@cache
def machine(shape: Shape) -> Machine:
    """Returns the problem of a shape, built once a process; with compiled functions where there are any."""
    blocks = codegen.compiled() or interpreted()
    functions, table = assemble(shape, blocks)
    return Machine(shape, table, blocks, functions)


@lru_cache(maxsize=PATTERNS_MAX)
def fatrop(shape: Shape, pattern: bytes, polish: bool) -> Any:
    """Returns the solver for one pattern of equalities, inequalities and free rows.

    casadi 3.8.2 makes fatrop anew where the pattern differs from the call before, and then forgets its options: each
    pattern gets a solver of its own, which takes a few milliseconds.
    """
    made = machine(shape)
    return solvers.fatrop(made.functions, made.table, POLISH if polish else FATROP)


@cache
def _ipopt(shape: Shape) -> Any:
    return solvers.ipopt(machine(shape).functions, IPOPT)


def solve(
    problem: ThrowProblem, candidate: Candidate, warm_start: Trajectory | None, deadline_s: float, wide: bool = False
) -> Solution:
    """Returns the motion of least release time next to a candidate. See docs/optimal-control.md.

    Args:
        problem: what is asked.
        candidate: where to begin; `joint` and `pose` are held to it.
        warm_start: a motion to it, best Ruckig's; None: a plain one is made up.
        deadline_s: on `time.perf_counter`, when to stop trying.
        wide: keep more room from what is only looked at on knots, for when a certificate has found fault.

    Raises:
        SolverFailed: neither solver found a motion in time.
    """
    margins = WIDE if wide else CLOSE
    motion, spent = _motion(problem, candidate, warm_start), 0
    if problem.is_robust:
        motion, spent = _without_window(problem, candidate, motion, deadline_s, margins)
    task = _Task(problem, candidate, shape_of(problem), deadline_s, spent)
    request = _request(problem, candidate, margins)
    start = guess(task.machine.table, problem, motion)
    return task.finish(request, task.run(request, start))


def _without_window(
    problem: ThrowProblem, candidate: Candidate, motion: dict[str, Any], deadline_s: float, margins: Margins
) -> tuple[dict[str, Any], int]:
    """Returns the best motion for the nominal instant alone, from which the window is easily found, and iterations."""
    nominal = replace(problem, release_window_s=0.0, landing_tolerance_m=0.0)
    task = _Task(nominal, candidate, shape_of(nominal), deadline_s)
    start = guess(task.machine.table, nominal, motion)
    try:
        found = answer.knots(task.run(_request(nominal, candidate, margins), start), task.shape)
    except SolverFailed:
        return motion, task.iterations
    return {"release_s": found.release_s, "end_s": float(found.t[-1]), "state": found.at}, task.iterations


def _request(problem: ThrowProblem, candidate: Candidate, margins: Margins) -> Request:
    return Request(problem, candidate, grid_limits(problem.limits, problem.dt), _aim(problem, candidate), margins)


class _Task:
    """The state of one call: what was spent."""

    def __init__(self, problem: ThrowProblem, candidate: Candidate, shape: Shape, deadline_s: float,
                 spent: int = 0) -> None:
        self.problem, self.candidate, self.shape, self.deadline_s = problem, candidate, shape, deadline_s
        self.machine = machine(shape)
        self.iterations = spent
        self.status = ""

    def run(self, request: Request, start: Start) -> Vector:
        """Returns the variables (N + 1, NZ) of the solution; IPOPT's where fatrop gives up.

        Raises:
            SolverFailed: both gave up, or time ran out.
        """
        call = arguments(request, self.machine.table, start)
        z = self._fatrop(call, polish=False) if self.left_s > 0.0 else None
        if z is None and self.left_s > SECOND_TRY_S:
            z = self._call("ipopt", _ipopt(self.shape), call)
        if z is None:
            raise SolverFailed(self.status or "out of time", self.iterations)
        return z

    @property
    def left_s(self) -> float:
        """Time left [s]."""
        return self.deadline_s - time.perf_counter()

    def _fatrop(self, call: dict[str, Any], polish: bool) -> Vector | None:
        return self._call("fatrop", fatrop(self.shape, pattern_of(call), polish), call)

    def _call(self, name: str, solver: Any, call: dict[str, Any]) -> Vector | None:
        """Returns the variables (N + 1, NZ), None where the solver gave up."""
        solution = solver(**call)
        stats = solver.stats()
        self.iterations += int(stats["iter_count"])
        x = np.array(solution["x"]).ravel()
        ok = bool(stats["success"]) and bool(np.isfinite(x).all())
        self.status = f"{name}: {'solved' if ok else 'gave up'} in {stats['iter_count']} iterations"
        padded = np.append(x, np.zeros(NZ * (self.shape.stages + 1) - len(x)))
        return padded.reshape(-1, NZ) if ok else None

    def finish(self, request: Request, z: Vector) -> Solution:
        """Returns the solution on whole ticks: as found with a wait at rest, solved again for them, or longer.

        Raises:
            SolverFailed: the limits are broken on the grid whatever is tried.
        """
        dt, found = self.problem.dt, answer.knots(z, self.shape)
        brake = answer.whole_ticks(found.brake_s, dt) if self.shape.brake else 0
        ticks = (answer.whole_ticks(found.release_s, dt), brake)
        made, request = self._made(request, found, ticks)
        if answer.joints_within(self.problem, made):
            return Solution(made, self.status, self.iterations)
        polished = self._polished(request, z, ticks)
        if polished is not None:
            return polished
        for extra in EXTRA_TICKS:
            slower = (ticks[0] + extra, ticks[1] + extra * bool(ticks[1]))
            made, _ = self._made(request, found, slower)
            if answer.joints_within(self.problem, made):
                return Solution(made, self.status, self.iterations)
        raise SolverFailed("the solution does not fit the ticks", self.iterations)

    def _polished(self, request: Request, z: Vector, ticks: tuple[int, int]) -> Solution | None:
        """Returns the motion solved again with its times fixed to `ticks`, None where that breaks a limit or fails."""
        dt, status = self.problem.dt, self.status
        start = Start(_restarted(z, ticks, dt), z[:-1, STEP] * TIME_SCALE, (ticks[0] * dt, sum(ticks) * dt))
        again = self._fatrop(arguments(request, self.machine.table, start), polish=True)
        self.status = status
        if again is None:
            return None
        made, _ = self._made(request, answer.knots(again, self.shape), ticks)
        return Solution(made, status, self.iterations) if answer.joints_within(self.problem, made) else None

    def _made(self, request: Request, found: answer.Knots, ticks: tuple[int, int]) -> tuple[Trajectory, Request]:
        """Returns the trajectory through the exact release, and the request with the aim that drag asks for."""
        problem, slope = self.problem, self.machine.blocks["release"].slope
        state = (found.q[found.launch], found.qd[found.launch])
        aim = request.aim
        for _ in range(DRAG_ROUNDS if problem.drag > 0.0 else 1):
            state = exactness.exact_release(problem, self.candidate, slope, state, aim)
            if isinstance(problem.release, TargetRelease):
                aim = exactness.drag_free_aim(problem, problem.release.p_W, *tool_point(problem, *state))
        if problem.drag > 0.0:
            state = exactness.exact_release(problem, self.candidate, slope, state, aim)
        return answer.trajectory(problem, found, state, ticks), replace(request, aim=aim)


def _restarted(z: Vector, ticks: tuple[int, int], dt: float) -> Vector:
    """Returns the variables with the times of the fixed problem; the rest is near enough."""
    z = z.copy()
    z[-1, TIME] = sum(ticks) * dt / TIME_SCALE
    return z


def _aim(problem: ThrowProblem, candidate: Candidate) -> Vector:
    """Returns where the drag-free flight is to land (3,) [m]: for a target with drag, as from the candidate."""
    p, v = tool_point(problem, candidate.q, candidate.qd)
    if isinstance(problem.release, TargetRelease):
        return exactness.drag_free_aim(problem, problem.release.p_W, p, v)
    if not isinstance(problem.release, JointRelease | PoseRelease):
        p, v = problem.release.p_WT, problem.release.v_WT
    flight = None if problem.ends_at_rest else fly(p, v, problem.plane_z, problem.gravity)
    return np.array([p[0], p[1], problem.plane_z]) if flight is None else flight.landing_point


def tool_point(problem: ThrowProblem, q: Vector, qd: Vector) -> tuple[Vector, Vector]:
    """Returns position [m] and velocity [m/s] of the tool centre in the world, each (3,)."""
    cell = problem.cell
    X_WT = cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT)
    v_B = jacobian(cell.robot, q, cell.tool.X_FT)[:3] @ qd
    return X_WT[:3, 3], cell.X_WB[:3, :3] @ v_B


def _motion(problem: ThrowProblem, candidate: Candidate, warm_start: Trajectory | None) -> dict[str, Any]:
    if warm_start is not None:
        return {"release_s": warm_start.release_time_s, "end_s": warm_start.duration_s, "state": warm_start.at}
    return _plain_motion(problem, candidate)


def _plain_motion(problem: ThrowProblem, candidate: Candidate) -> dict[str, Any]:
    """A made-up first guess: a cubic to the release in twice the least time, then even braking."""
    release = max(2.0 * candidate.bound_s, 0.2)
    slowing = max(float(np.max(np.abs(candidate.qd) / problem.limits.qdd_max)) * 1.5, 0.1)
    d, v = candidate.q - problem.start, candidate.qd

    def state(t: Vector) -> tuple[Vector, Vector, Vector]:
        s = np.minimum(t, release)[:, None]
        c2, c3 = 3 * d / release**2 - v / release, v / release**2 - 2 * d / release**3
        after = np.clip(t - release, 0.0, slowing)[:, None]
        q = problem.start + c2 * s**2 + c3 * s**3 + v * (after - after**2 / (2 * slowing))
        qd = 2 * c2 * s + 3 * c3 * s**2 - v * after / slowing
        return q, qd, np.where(t[:, None] < release, 2 * c2 + 6 * c3 * s, -v / slowing)

    return {"release_s": release, "end_s": release + (0.0 if problem.ends_at_rest else slowing), "state": state}
