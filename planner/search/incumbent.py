"""What a search for a plan keeps: the best certified answer, the least bad refused one, the story, the time left."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from planner.certificate import Certificate, certify
from planner.errors import Infeasible, SolverFailed, Violation
from planner.problem import ThrowProblem
from planner.solution import Solution
from planner.trajectory import Trajectory


@dataclass(frozen=True)
class Attempt:
    """One back end's part of the story: what came of it, and how long it took [s]."""

    backend: str
    result: str
    duration_s: float


@dataclass(frozen=True, eq=False)
class Answer:
    """A back end's motion with its judgement."""

    backend: str
    solution: Solution
    certificate: Certificate


@dataclass(eq=False)
class Search:
    """The state of one search. `deadline_s` and `begun_s` are on `time.perf_counter`'s clock."""

    problem: ThrowProblem
    deadline_s: float
    best: Answer | None = None
    refused: Answer | None = None
    attempts: list[Attempt] = field(default_factory=list)
    begun_s: float = field(default_factory=time.perf_counter)

    @property
    def spent_s(self) -> float:
        """Time spent searching [s]."""
        return time.perf_counter() - self.begun_s

    @property
    def left_s(self) -> float:
        """Time left to search [s]."""
        return self.deadline_s - time.perf_counter()

    @property
    def release_time_s(self) -> float:
        """When the best answer so far releases [s]; infinite where there is none."""
        return float("inf") if self.best is None else self.best.solution.trajectory.release_time_s

    def judge(self, backend: str, solution: Solution) -> Certificate:
        """Certifies a solution and keeps it where it is the best, or the least bad."""
        answer = Answer(backend, solution, certify(self.problem, solution.trajectory))
        if not answer.certificate.valid:
            if self.refused is None or _badness(answer.certificate) < _badness(self.refused.certificate):
                self.refused = answer
        elif self.best is None or _rank(solution.trajectory) < _rank(self.best.solution.trajectory):
            self.best = answer
        return answer.certificate

    def tell(self, backend: str, result: str, begun_s: float) -> None:
        """Adds to the story what came of a back end that began at `begun_s`."""
        self.attempts.append(Attempt(backend, result, time.perf_counter() - begun_s))

    def refusal(self) -> Infeasible | SolverFailed:
        """Returns why there is no answer: the failed checks of the least bad motion, or the solvers' own words."""
        story = [attempt.__dict__ for attempt in self.attempts]
        if self.refused is None:
            return SolverFailed(self.attempts[-1].result if self.attempts else "out of time", attempts=story)
        failures = self.refused.certificate.failures
        violations = [Violation(c.name, c.value, c.limit, c.unit, c.at_s, c.detail) for c in failures]
        return Infeasible(violations, attempts=story)


def _badness(certificate: Certificate) -> tuple[int, float]:
    """Orders refused answers: few failed checks first, then by how far beyond the limits they are."""
    over = sum(-check.margin / max(abs(check.limit), 1e-3) for check in certificate.failures)
    return len(certificate.failures), over


def _rank(trajectory: Trajectory) -> tuple[float, float]:
    """Orders certified answers: soonest release, then soonest rest."""
    return trajectory.release_time_s, trajectory.duration_s
