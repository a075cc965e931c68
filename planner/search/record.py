"""Record of one planning search: best motion, rejected ones, attempt log, work spent, deadline."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

from planner.answer import Attempt
from planner.backends.solution import Solution
from planner.certificate import Certificate, Check, Examination
from planner.errors import TIME_LIMIT, Infeasible, SolverFailed, Violation, nothing_found
from planner.problem import ThrowProblem
from planner.progress import SILENT


@dataclass(frozen=True, eq=False)
class CertifiedSolution:
    """A back end's motion with the checks of it, valid or not.

    Attributes:
        backend: that made it.
        solution: the motion.
        examination: its checks, made as they are asked for.
    """

    backend: str
    solution: Solution
    examination: Examination

    @property
    def is_valid(self) -> bool:
        """Whether every check holds."""
        return self.examination.first_failure is None

    @property
    def violates_window_alone(self) -> bool:
        """Whether every check but that of the release window holds."""
        failure = self.examination.first_failure
        return failure is not None and failure.name == "landing_window"

    @property
    def certificate(self) -> Certificate:
        """The certificate."""
        return self.examination.certificate


@dataclass(eq=False)
class PlanningSearch:
    """State of one planning search.

    Attributes:
        problem: to be solved.
        deadline_s: of the request, on the clock of `time.perf_counter`.
        certified: every valid motion, in the order in which they were found.
        rejected: every motion that is not valid.
        attempts: log of what was tried.
        iterations: spent by the optimiser so far.
        loading_s: spent on loading solvers [s]; the deadline is later by as much.
        was_cut_short: whether the deadline had passed at the end of the search, and the answer may not be the soonest.
        is_for_any: whether any valid motion will do: the first one ends the search.
        tell: called at each step, with the number of candidates that it begins with and `release_time_s`.
    """

    problem: ThrowProblem
    deadline_s: float
    certified: list[CertifiedSolution] = field(default_factory=list)
    rejected: list[CertifiedSolution] = field(default_factory=list)
    attempts: list[Attempt] = field(default_factory=list)
    iterations: int = 0
    loading_s: float = 0.0
    was_cut_short: bool = False
    is_for_any: bool = False
    tell: Callable[[int, float], object] = SILENT.step

    @property
    def out_of_time(self) -> bool:
        """Whether the request's deadline has passed."""
        return time.perf_counter() >= self.deadline_s

    @property
    def best(self) -> CertifiedSolution | None:
        """The valid motion that releases soonest, so far; None without any."""
        return min(self.certified, key=_rank, default=None)

    @property
    def release_time_s(self) -> float:
        """Release time of the best motion [s]; infinite without one."""
        best = self.best
        return math.inf if best is None else best.solution.trajectory.release_time_s

    @property
    def latest_useful_s(self) -> float:
        """Latest release time of a motion that is of use [s]: a tick before that of the best."""
        return self.release_time_s - self.problem.dt

    def is_of_use(self, release_time_s: float) -> bool:
        """Returns whether a motion with a release at this time [s], or later, can be better than the best one."""
        is_enough = self.is_for_any and self.best is not None
        return not is_enough and release_time_s < self.release_time_s

    def certify(self, backend: str, solution: Solution) -> CertifiedSolution:
        """Returns a motion with its checks, and keeps it: as an answer, or for the refusal."""
        found = CertifiedSolution(backend, solution, Examination(self.problem, solution.trajectory))
        (self.certified if found.is_valid else self.rejected).append(found)
        self.step(0)
        return found

    def step(self, candidates: int, _: float = 0.0) -> None:
        """Tells of a step, of this search or of one inside it, whose motions are none of this one's.

        Args:
            candidates: number of those that it begins with.
        """
        self.tell(candidates, self.release_time_s)

    @contextmanager
    def inner(self, problem: ThrowProblem) -> Iterator[PlanningSearch]:
        """Yields a search inside this one, for a motion that is a part of it; a refusal ends it without one.

        Its work counts in this one, and so does the time for which it stops the clock.

        Args:
            problem: of that motion.
        """
        found = PlanningSearch(problem, self.deadline_s, tell=self.step)
        with suppress(Infeasible, SolverFailed):
            yield found
        self.iterations += found.iterations
        self.extend_deadline(found.loading_s)

    def by_rank(self) -> list[CertifiedSolution]:
        """Returns the valid motions, the best first."""
        return sorted(self.certified, key=_rank)

    def log_attempt(self, backend: str, result: str, begun_s: float) -> None:
        """Adds an entry to the attempt log for work that began at `begun_s`."""
        self.attempts.append(Attempt(backend, result, time.perf_counter() - begun_s))

    def extend_deadline(self, seconds: float) -> None:
        """Moves the deadline by what was no work on the request: loading a solver [s]."""
        self.deadline_s += seconds
        self.loading_s += seconds

    def note_end(self) -> None:
        """Notes that the search has ended, by itself or by the deadline; fallbacks may follow."""
        self.was_cut_short = self.out_of_time

    @property
    def log(self) -> list[dict[str, Any]]:
        """The attempts, as documents tell them."""
        return [attempt.__dict__ for attempt in self.attempts]

    def failure(self, violations: Sequence[Violation]) -> Infeasible | SolverFailed:
        """Returns the error of a search without an answer: what ended it, and what stood in the way of every motion."""
        if self.out_of_time:
            return SolverFailed(TIME_LIMIT, self.iterations, self.log, violations)
        return Infeasible(violations, attempts=self.log)

    def violations(self) -> list[Violation]:
        """Returns the failed checks of the motion closest to a valid one; without any, that none was made, and why.

        Where a motion violates only the release window, these are its own.
        """
        nominal = [each for each in self.rejected if each.violates_window_alone]
        if nominal:
            return [check.as_violation() for check in min(nominal, key=_rank).examination.failures]
        if not self.rejected:
            said = "; ".join(f"{attempt.backend}: {attempt.result}" for attempt in self.attempts)
            return [nothing_found("motion", f"none was made: {said}" if said else "none was tried")]
        closest = min((each.examination.failures for each in self.rejected), key=_excess)
        return [check.as_violation() for check in closest]


def counted(number: int, thing: str) -> str:
    """Returns a number of things in words: "1 candidate", "2 candidates"."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"


def _excess(failures: Sequence[Check]) -> tuple[int, float]:
    """Returns the sort key of a rejected motion: number of failed checks, then total excess over their limits [-]."""
    over = sum(-check.margin / max(abs(check.limit), 1e-3) for check in failures)
    return len(failures), over


def _rank(found: CertifiedSolution) -> tuple[float, float]:
    """Returns the sort key of motions: release time, then duration [s]."""
    trajectory = found.solution.trajectory
    return trajectory.release_time_s, trajectory.duration_s
