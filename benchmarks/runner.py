"""Calls the planner, measures it, and certifies its answers once more."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from statistics import median

import numpy as np

from benchmarks.launch_bound import launch_bound
from benchmarks.problem_sets import Task, cell
from benchmarks.results import ResultRow
from planner.certificate import Examination, certify, landing_errors
from planner.errors import BackendUnavailable, Infeasible, InvalidProblem, SolverFailed
from planner.planning import Plan, plan
from planner.problem import BACKENDS, JointRelease, TargetRelease, ThrowProblem
from planner.request import problem_from_request
from planner.trajectory import Trajectory

WINDOWS_MS = (10, 20, 30)
STEP_S = 0.001  # [s] grid of a release window
WARM_UP = 2  # unmeasured plans before a back end's first one for an arm and a kind of release

SLOW_LIMITS = 2.0, 15.0  # [rad/s^2, rad/s^3] limits that stretch a throw to about 1.5 s
SLOW_TARGET = np.array([1.1, 0.3, 0.0])  # [m]
CERTIFICATE_REPEATS = 25


def supported(problem: ThrowProblem) -> tuple[str, ...]:
    """Returns the back ends that are installed."""
    easy = JointRelease(problem.start + 0.3, 0.1 * problem.limits.qd_max)
    return tuple(name for name in BACKENDS if _is_installed(replace(problem, release=easy, backend=name)))


def _is_installed(problem: ThrowProblem) -> bool:
    try:
        return problem.backend in ("auto", plan(problem).backend)
    except (BackendUnavailable, NotImplementedError, KeyError):
        return False
    except (Infeasible, SolverFailed):
        return True


class Runner:
    """Runs tasks; warms a back end up for each arm and kind of release before it measures."""

    def __init__(self) -> None:
        self._warm: set[tuple[str, str, str, bool]] = set()

    def run(self, task: Task, backend: str) -> tuple[ResultRow, Plan | None]:
        """Returns the row of a task, and the plan if there is one."""
        problem = replace(task.problem, backend=backend)
        self._warm_up(problem)
        started_at = time.perf_counter()
        cpu = time.process_time()
        answer: Plan | None = None
        refusal: Infeasible | SolverFailed | None = None
        try:
            answer = plan(problem)
        except (Infeasible, SolverFailed) as error:
            refusal = error
        solve_s = time.perf_counter() - started_at
        cpu_s = time.process_time() - cpu
        row = _answered(task, backend, answer) if answer else _refused(task, problem, backend, refusal)
        row.solve_s = solve_s
        row.cpu_s = cpu_s
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


def measured(task: Task, name: str, motion: Trajectory) -> ResultRow:
    """Returns the row of a motion.

    Args:
        task: Its task.
        name: Name of the method.
        motion: The motion, which is certified here.
    """
    problem = task.problem
    started_at = time.perf_counter()
    certificate = certify(problem, motion)
    certificate_s = time.perf_counter() - started_at
    failures = [c.name for c in certificate.failures]
    return ResultRow(
        task.name,
        name,
        "invalid" if failures else "certified",
        by=name,
        release_time_s=motion.release_time_s,
        duration_s=motion.duration_s,
        certificate_s=certificate_s,
        tick_s=problem.dt,
        window_m={} if problem.ends_at_rest else windows(problem, motion),
        reason=", ".join(failures),
    )


def windows(problem: ThrowProblem, motion: Trajectory) -> dict[str, float]:
    """Returns the largest landing error within ± each of `WINDOWS_MS` of the release [m]."""
    largest = {}
    for width in WINDOWS_MS:
        count = round(width / 1000.0 / STEP_S)
        errors = landing_errors(problem, motion, np.linspace(-count, count, 2 * count + 1) * STEP_S)
        largest[str(width)] = float(errors.max()) if np.isfinite(errors).all() else float("inf")
    return largest


def certificate_time() -> tuple[int, float]:
    """Returns the samples of a robust throw of about 1.5 s, and the median time of its checks in a search [s].

    It is processor time. A certificate that tells bounds takes about three times as long, once for each plan.
    """
    arm = cell("ur5e-sim")
    limits = replace(arm.limits, qdd_max=np.full(6, SLOW_LIMITS[0]), jerk_max=np.full(6, SLOW_LIMITS[1]))
    problem = ThrowProblem(
        arm, arm.home, TargetRelease(SLOW_TARGET), limits, release_window_s=0.02, landing_tolerance_m=0.01
    )
    motion = plan(problem).trajectory
    return len(motion.q), median(_certify_once(problem, motion) for _ in range(CERTIFICATE_REPEATS))


def _certify_once(problem: ThrowProblem, motion: Trajectory) -> float:
    fresh = Trajectory(motion.sample_rate_hz, motion.q, motion.qd, motion.qdd, motion.release_index)  # empty caches
    started_at = time.process_time()
    Examination(problem, fresh).first_failure  # noqa: B018
    return time.process_time() - started_at


def _answered(task: Task, backend: str, answer: Plan) -> ResultRow:
    row = measured(task, backend, answer.trajectory)
    row.by, row.bound_s = answer.backend, launch_bound(task.problem)
    return row


def _refused(task: Task, problem: ThrowProblem, backend: str, refusal: Infeasible | SolverFailed | None) -> ResultRow:
    outcome = "infeasible" if isinstance(refusal, Infeasible) else "failed"
    row = ResultRow(task.name, backend, outcome, reason=str(refusal)[:200], tick_s=problem.dt)
    row.nearest = _nearest(problem, getattr(refusal, "nearest", None))
    return row


def _nearest(problem: ThrowProblem, nearest: Mapping[str, object] | None) -> str:
    """Returns whether the nearest request of a refusal can be planned: "certified", "wrong" or "none"."""
    if nearest is None:
        return "none"
    try:
        plan(problem_from_request(nearest, problem.cell))
    except (Infeasible, SolverFailed, InvalidProblem):
        return "wrong"
    return "certified"
