"""The optimal control back end: launch and brake of least time next to a candidate. See docs/optimal-control.md.

A solve goes from module to module: symbols (formulas) and transcription (once per process and layout), then instance,
solver and answer. casadi is imported with the first use.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from planner.backends.casadi_nlp.layout import KEEP_OUT_SHAPES
from planner.backends.casadi_nlp.margins import DEFAULT_MARGINS, Margins, meets_arm
from planner.backends.solution import Solution
from planner.errors import BackendUnavailable, SolverFailed
from planner.problem import ThrowProblem
from planner.seeds import Seed

__all__ = [
    "DEFAULT_MARGINS",
    "KEEP_OUT_SHAPES",
    "Margins",
    "SeedFailed",
    "SolveOptions",
    "load",
    "meets_arm",
    "solve",
]


@dataclass(frozen=True)
class SolveOptions:
    """Options of a solve.

    Attributes:
        margins: on every limit; wider ones after a certificate's failed checks.
        groups: rows that are included from the beginning, as those of a failed motion; others as they are violated.
        deadline_s: on `time.perf_counter`; no further solver call begins after it. None for no deadline.
        latest_s: a motion that releases later than this is of no use; infinite for no such time.
    """

    margins: Margins = DEFAULT_MARGINS
    groups: frozenset[str] = frozenset()
    deadline_s: float | None = None
    latest_s: float = math.inf


class SeedFailed(SolverFailed):
    """No motion was found from a seed.

    Attributes:
        is_late: whether a solution was found, or was to come, that releases too late.
    """

    def __init__(self, status: str, iterations: int, is_late: bool) -> None:
        super().__init__(status, iterations)
        self.is_late = is_late


def solve(problem: ThrowProblem, seed: Seed, options: SolveOptions = SolveOptions()) -> Solution:
    """Returns the motion of least release time next to a candidate.

    Args:
        problem: the problem.
        seed: the candidate, which `joint` and `pose` releases are held to, and a motion through it.
        options: margins and budgets.

    Raises:
        SeedFailed: no motion was found within the budget, or none that releases in time.
        BackendUnavailable: casadi is not installed.
    """
    _require_casadi()
    from planner.backends.casadi_nlp.answer import answer
    from planner.backends.casadi_nlp.instance import Instance
    from planner.backends.casadi_nlp.release_rows import with_room
    from planner.backends.casadi_nlp.solver import Solver, TooLate

    problem = with_room(problem)
    instance = Instance.of(problem, seed, options.margins)
    groups = options.groups | instance.first_groups
    solver = Solver(options.deadline_s, groups, options.latest_s)
    try:
        return answer(instance, solver)
    except SolverFailed as failure:
        is_late = isinstance(failure, TooLate)
        raise SeedFailed(failure.status, solver.iterations, is_late) from None


def load() -> None:
    """Loads casadi and the functions of every formula, once per process.

    Raises:
        BackendUnavailable: casadi is not installed.
    """
    _require_casadi()
    from planner.backends.casadi_nlp.functions import all_blocks

    all_blocks()


def _require_casadi() -> None:
    try:
        import casadi  # noqa: F401
    except ImportError as error:
        raise BackendUnavailable("casadi", "casadi") from error
