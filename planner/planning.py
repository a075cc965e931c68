"""plan(): candidates, back ends, the judge, the best.

Only a certified trajectory leaves this module. `auto` takes Ruckig's best certified answer as the incumbent and lets
the optimiser improve on it while time allows.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from planner.backends import ruckig_otg
from planner.certificate import Certificate, certify
from planner.errors import Infeasible, SolverFailed, Violation
from planner.nearest import nearest_release, request_document
from planner.problem import ThrowProblem
from planner.release import Candidate, candidates
from planner.solution import Solution
from planner.trajectory import Trajectory

NEAREST_TIME_S = 1.0  # [s] spent at most on finding what can be done instead
NEAREST_SEEDS = 6  # candidates tried for each share


@dataclass(frozen=True)
class Attempt:
    """One back end's part of the story: what came of it, and how long it took [s]."""

    backend: str
    result: str
    duration_s: float


@dataclass(frozen=True, eq=False)
class Plan:
    """A certified answer to a problem, and how it was found."""

    problem: ThrowProblem
    backend: str
    trajectory: Trajectory
    certificate: Certificate
    status: str
    iterations: int
    solve_time_s: float
    attempts: tuple[Attempt, ...]


@dataclass(eq=False)
class Search:
    """The best certified answer so far, the least bad refused one, and what is left of the time."""

    problem: ThrowProblem
    deadline_s: float
    best: tuple[str, Solution, Certificate] | None = None
    refused: tuple[Solution, Certificate] | None = None
    attempts: list[Attempt] = field(default_factory=list)

    @property
    def left_s(self) -> float:
        """Time left to search [s]."""
        return self.deadline_s - time.perf_counter()

    @property
    def release_time_s(self) -> float:
        """When the best answer so far releases [s]; infinite where there is none."""
        return float("inf") if self.best is None else self.best[1].trajectory.release_time_s

    def judge(self, backend: str, solution: Solution) -> bool:
        """Certifies a solution and keeps it where it is the best; returns whether it is valid."""
        certificate = certify(self.problem, solution.trajectory)
        if not certificate.valid:
            if self.refused is None or _badness(certificate) < _badness(self.refused[1]):
                self.refused = (solution, certificate)
            return False
        if self.best is None or _rank(solution.trajectory) < _rank(self.best[1].trajectory):
            self.best = (backend, solution, certificate)
        return True


def plan(problem: ThrowProblem) -> Plan:
    """Returns the best certified motion for the problem.

    Raises:
        Infeasible: no release state or no certified motion exists; says what stands in the way.
        SolverFailed: time ran out, or the back end gave up, before that was decided.
        BackendUnavailable: the back end asked for is not installed.
    """
    begun = time.perf_counter()
    search = Search(problem, begun + problem.time_limit_s)
    try:
        _by_ruckig(search, candidates(problem))
        if search.best is None:
            raise _refusal(search)
    except Infeasible as refusal:
        raise _with_nearest(search, refusal) from None
    backend, solution, certificate = search.best
    return Plan(
        problem=problem,
        backend=backend,
        trajectory=solution.trajectory,
        certificate=certificate,
        status=solution.status,
        iterations=solution.iterations,
        solve_time_s=time.perf_counter() - begun,
        attempts=tuple(search.attempts),
    )


def _by_ruckig(search: Search, seeds: list[Candidate]) -> None:
    """Tries both launches to every candidate that could still be sooner than the best."""
    begun, tried, valid, failure = time.perf_counter(), 0, 0, ""
    for seed in seeds:
        if seed.bound_s >= search.release_time_s or search.left_s <= 0.0:
            break
        for launch in ruckig_otg.LAUNCHES:
            try:
                solution = ruckig_otg.solve(search.problem, seed, launch)
            except SolverFailed as error:
                failure = error.status
                continue
            if solution.trajectory.release_time_s < search.release_time_s:
                tried += 1
                valid += search.judge("ruckig", solution)
    result = f"{valid} of {tried} motions certified" + (f"; {failure}" if failure else "")
    search.attempts.append(Attempt("ruckig", result, time.perf_counter() - begun))


def _with_nearest(search: Search, refusal: Infeasible) -> Infeasible:
    """Returns the refusal with the closest request that certifies."""
    deadline = min(search.deadline_s, time.perf_counter() + NEAREST_TIME_S)
    release = nearest_release(search.problem, list(refusal.violations), _certifiable, deadline)
    nearest = None if release is None else request_document(search.problem, release)
    return Infeasible(refusal.violations, nearest, refusal.attempts)


def _certifiable(problem: ThrowProblem) -> bool:
    """Whether one of the first few candidates gives a certified motion by Ruckig alone."""
    try:
        seeds = candidates(problem)[:NEAREST_SEEDS]
    except Infeasible:
        return False
    for seed in seeds:
        try:
            if certify(problem, ruckig_otg.solve(problem, seed).trajectory).valid:
                return True
        except SolverFailed:
            continue
    return False


def _refusal(search: Search) -> Infeasible | SolverFailed:
    attempts = [attempt.__dict__ for attempt in search.attempts]
    if search.refused is None:
        return SolverFailed(search.attempts[-1].result, attempts=attempts)
    failures = search.refused[1].failures
    violations = [Violation(c.name, c.value, c.limit, c.unit, c.at_s, c.detail) for c in failures]
    return Infeasible(violations, attempts=attempts)


def _badness(certificate: Certificate) -> tuple[int, float]:
    """Orders refused answers: few failed checks first, then by how far beyond the limits they are."""
    over = sum(-check.margin / max(abs(check.limit), 1e-3) for check in certificate.failures)
    return len(certificate.failures), over


def _rank(trajectory: Trajectory) -> tuple[float, float]:
    """Orders certified answers: soonest release, then soonest rest."""
    return trajectory.release_time_s, trajectory.duration_s
