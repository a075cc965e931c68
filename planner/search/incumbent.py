"""State of one planning search: incumbent, best rejected motion, attempt log, work spent, deadline."""

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
    """One entry of the attempt log: back end, result in words, duration [s]."""

    backend: str
    result: str
    duration_s: float


@dataclass(frozen=True, eq=False)
class CertifiedSolution:
    """A back end's motion with its certificate, valid or not."""

    backend: str
    solution: Solution
    certificate: Certificate


@dataclass(eq=False)
class PlanningSearch:
    """State of one planning search.

    Attributes:
        problem: to be solved.
        deadline_s: of the request, on the clock of `time.perf_counter`.
        incumbent: best valid motion so far.
        certified: every valid motion, in the order in which they were found.
        best_rejected: the rejected motion closest to a valid one, for the refusal.
        attempts: log of what was tried.
        iterations: spent by the optimiser so far.
        lower_bound_s: no motion releases earlier [s], as far as is known.
    """

    problem: ThrowProblem
    deadline_s: float
    incumbent: CertifiedSolution | None = None
    certified: list[CertifiedSolution] = field(default_factory=list)
    best_rejected: CertifiedSolution | None = None
    attempts: list[Attempt] = field(default_factory=list)
    iterations: int = 0
    lower_bound_s: float = 0.0
    _certified_backends: set[str] = field(default_factory=set)

    @property
    def out_of_time(self) -> bool:
        """Whether the request's deadline has passed."""
        return time.perf_counter() >= self.deadline_s

    @property
    def release_time_s(self) -> float:
        """Release time of the incumbent [s]; infinite without one."""
        return float("inf") if self.incumbent is None else self.incumbent.solution.trajectory.release_time_s

    @property
    def is_optimal(self) -> bool:
        """Whether the incumbent is known to be the soonest: it reaches the lower bound."""
        return self.release_time_s <= self.lower_bound_s

    def has_certified(self, backend: str) -> bool:
        """Returns whether a motion of the back end was valid."""
        return backend in self._certified_backends

    def certify(self, backend: str, solution: Solution) -> Certificate:
        """Returns the certificate of a motion; keeps the motion if it is the best valid or the best rejected one."""
        certified = CertifiedSolution(backend, solution, certify(self.problem, solution.trajectory))
        certificate = certified.certificate
        if not certificate.valid:
            if self.best_rejected is None or _excess(certificate) < _excess(self.best_rejected.certificate):
                self.best_rejected = certified
            return certificate
        self._certified_backends.add(backend)
        self.certified.append(certified)
        if self.incumbent is None or _rank(solution.trajectory) < _rank(self.incumbent.solution.trajectory):
            self.incumbent = certified
        return certificate

    def by_rank(self) -> list[CertifiedSolution]:
        """Returns the valid motions, the best first."""
        return sorted(self.certified, key=lambda each: _rank(each.solution.trajectory))

    def log_attempt(self, backend: str, result: str, begun_s: float) -> None:
        """Adds an entry to the attempt log for work that began at `begun_s`."""
        self.attempts.append(Attempt(backend, result, time.perf_counter() - begun_s))

    def failure(self) -> Infeasible | SolverFailed:
        """Returns the error of a search without incumbent: the best rejected motion's failed checks, if there is one.

        Otherwise the last entry of the attempt log.
        """
        log = [attempt.__dict__ for attempt in self.attempts]
        if self.best_rejected is None:
            status = self.attempts[-1].result if self.attempts else "out of time"
            return SolverFailed(status, attempts=log)
        failures = self.best_rejected.certificate.failures
        violations = [Violation(c.name, c.value, c.limit, c.unit, c.at_s, c.detail) for c in failures]
        return Infeasible(violations, attempts=log)


def _excess(certificate: Certificate) -> tuple[int, float]:
    """Returns the sort key of a rejected motion: number of failed checks, then total excess over their limits [-]."""
    over = sum(-check.margin / max(abs(check.limit), 1e-3) for check in certificate.failures)
    return len(certificate.failures), over


def _rank(trajectory: Trajectory) -> tuple[float, float]:
    """Returns the sort key of a valid motion: release time, then duration [s]."""
    return trajectory.release_time_s, trajectory.duration_s
