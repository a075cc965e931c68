"""Asking the planner, timing it, and judging what it says once more."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from planner.certificate import certify, landing_errors
from planner.errors import BackendUnavailable, Infeasible, InvalidProblem, SolverFailed
from planner.plan_document import problem_from_request
from planner.planning import Plan, plan
from planner.problem import BACKENDS, JointRelease, ThrowProblem
from planner.trajectory import Trajectory
from tests.benchmarks.bound import launch_bound
from tests.benchmarks.task import Row, Task

WINDOWS_MS = (10, 20, 30)
STEP_S = 0.001  # spacing at which a window is looked at
WARM_UP = 2  # unmeasured plans before a back end's first one on an arm and a kind of release


def supported(problem: ThrowProblem) -> tuple[str, ...]:
    """Returns the back ends of `BACKENDS` that this version's plan() honours."""
    easy = JointRelease(problem.start + 0.3, 0.1 * problem.limits.qd_max)
    return tuple(name for name in BACKENDS if _honours(replace(problem, release=easy, backend=name)))


def _honours(problem: ThrowProblem) -> bool:
    try:
        return problem.backend in ("auto", plan(problem).backend)
    except (BackendUnavailable, NotImplementedError, KeyError):
        return False
    except (Infeasible, SolverFailed):
        return True


class Runner:
    """Runs tasks; a back end is warmed on each arm and kind of release before anything is timed."""

    def __init__(self) -> None:
        self._warm: set[tuple[str, str, str, bool]] = set()

    def run(self, task: Task, backend: str) -> tuple[Row, Plan | None]:
        """Returns what came of it, and the plan where there is one."""
        problem = replace(task.problem, backend=backend)
        self._warm_up(problem)
        begun, cpu = time.perf_counter(), time.process_time()
        answer: Plan | None = None
        refusal: Infeasible | SolverFailed | None = None
        try:
            answer = plan(problem)
        except (Infeasible, SolverFailed) as error:
            refusal = error
        solve_s, cpu_s = time.perf_counter() - begun, time.process_time() - cpu
        row = _answered(task, backend, answer) if answer else _refused(task, problem, backend, refusal)
        row.solve_s, row.cpu_s = solve_s, cpu_s
        return row, answer

    def _warm_up(self, problem: ThrowProblem) -> None:
        key = (problem.backend, problem.cell.name, type(problem.release).__name__, problem.is_robust)
        if key in self._warm:
            return
        self._warm.add(key)
        for _ in range(WARM_UP):
            try:
                plan(problem)
            except (Infeasible, SolverFailed):
                continue


def measured(task: Task, name: str, motion: Trajectory, solve_s: float, ignored: tuple[str, ...] = ()) -> Row:
    """Returns the row of any motion, judged by the certificate; `ignored` checks are not a method's business."""
    problem = task.problem
    begun = time.perf_counter()
    certificate = certify(problem, motion)
    certificate_s = time.perf_counter() - begun
    failures = [c.name for c in certificate.failures if c.name not in ignored]
    return Row(
        task.name,
        name,
        "invalid" if failures else "certified",
        by=name,
        release_time_s=motion.release_time_s,
        duration_s=motion.duration_s,
        solve_s=solve_s,
        certificate_s=certificate_s,
        tick_s=problem.dt,
        window_m={} if problem.ends_at_rest else windows(problem, motion),
        reason=", ".join(failures),
    )


def windows(problem: ThrowProblem, motion: Trajectory) -> dict[str, float]:
    """Returns the worst landing error [m] within ± each of `WINDOWS_MS` around the release."""
    worst = {}
    for width in WINDOWS_MS:
        count = round(width / 1000.0 / STEP_S)
        errors = landing_errors(problem, motion, np.linspace(-count, count, 2 * count + 1) * STEP_S)
        worst[str(width)] = float(errors.max()) if np.isfinite(errors).all() else float("inf")
    return worst


def _answered(task: Task, backend: str, answer: Plan) -> Row:
    row = measured(task, backend, answer.trajectory, 0.0)
    row.by, row.bound_s = answer.backend, launch_bound(task.problem)
    return row


def _refused(task: Task, problem: ThrowProblem, backend: str, refusal: Infeasible | SolverFailed | None) -> Row:
    outcome = "infeasible" if isinstance(refusal, Infeasible) else "failed"
    row = Row(task.name, backend, outcome, reason=str(refusal)[:200], tick_s=problem.dt)
    row.nearest = _nearest(problem, getattr(refusal, "nearest", None))
    return row


def _nearest(problem: ThrowProblem, nearest: Mapping[str, object] | None) -> str:
    """Whether what a refusal offers instead is itself planned and certified."""
    if nearest is None:
        return "none"
    try:
        plan(problem_from_request(nearest, problem.cell))
    except (Infeasible, SolverFailed, InvalidProblem):
        return "wrong"
    return "certified"
