"""The optimal control back end: launch and brake of least time next to a candidate. See docs/optimal-control.md.

A solve goes from module to module: symbols (formulas) and transcription (once per process and layout), then instance,
solver and answer. casadi is imported with the first use.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from planner.backends.casadi_nlp.flight_rows import starts_with_flight
from planner.backends.casadi_nlp.margins import DEFAULT_MARGINS, Margins, meets_arm
from planner.errors import BackendUnavailable, SolverFailed
from planner.problem import TargetRelease, ThrowProblem
from planner.seeds import Seed
from planner.solution import Solution

if TYPE_CHECKING:
    from planner.backends.casadi_nlp.instance import Instance
    from planner.backends.casadi_nlp.solver import Solver

__all__ = [
    "DEFAULT_MARGINS",
    "Margins",
    "SeedFailed",
    "SolveOptions",
    "build_solvers",
    "load",
    "meets_arm",
    "solve",
]

ITERATION_BUDGET = 1000  # [-] the most that one solve took in 947 plans of the benchmark is 260


@dataclass(frozen=True)
class SolveOptions:
    """Options of a solve.

    Attributes:
        margins: on every limit; wider ones after a certificate's failed checks.
        iteration_budget: no further solver call begins when the iterations of all calls reach it.
        deadline_s: on `time.perf_counter`; no further solver call begins after it. None for no deadline.
        latest_s: a motion that releases later than this is of no use; infinite for no such time.
    """

    margins: Margins = DEFAULT_MARGINS
    iteration_budget: int = ITERATION_BUDGET
    deadline_s: float | None = None
    latest_s: float = math.inf


class SeedFailed(SolverFailed):
    """No motion was found from a seed.

    Attributes:
        held: groups of rows that were included by then.
        is_late: whether a solution was found, or was to come, that releases too late.
        lacks_brake: whether no brake from the given release was found that is clear of the flight, wherever the joints
            may turn.
    """

    def __init__(
        self, status: str, iterations: int, held: frozenset[str], is_late: bool, lacks_brake: bool = False
    ) -> None:
        super().__init__(status, iterations)
        self.held = held
        self.is_late = is_late
        self.lacks_brake = lacks_brake


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
    from planner.backends.casadi_nlp.answer import SHORTENED_TICKS
    from planner.backends.casadi_nlp.instance import Instance
    from planner.backends.casadi_nlp.release_state import with_room
    from planner.backends.casadi_nlp.solver import Solver

    problem = with_room(problem)
    instance = Instance.of(problem, seed, options.margins)
    groups = options.margins.held
    groups |= {"flight"} if starts_with_flight(problem) else set()
    groups |= {"leaving"} if options.margins.leaves else set()  # it decides which objects have states
    latest_s = options.latest_s + SHORTENED_TICKS * problem.dt
    solver = Solver(options.iteration_budget, options.deadline_s, groups, latest_s)
    try:
        return _answer(instance, seed, options, solver)
    except SolverFailed as failure:
        lacks_brake = solver.lacks_brake and not problem.is_robust  # the throw without the window may have set it
        raise SeedFailed(failure.status, failure.iterations, solver.groups, solver.is_late, lacks_brake) from None


def _answer(instance: Instance, seed: Seed, options: SolveOptions, solver: Solver) -> Solution:
    """Returns the motion of `solve`.

    With a release window there are two initial guesses, the seed's and the throw without the window, and now and then
    only the other one leads to a solution. Where the release is given, the latter is the better one.

    Raises:
        SolverFailed: none was found.
    """
    from planner.backends.casadi_nlp.answer import answer, solved

    guesses: list[Callable[[], Instance]] = [lambda: instance]
    if (
        instance.problem.is_robust and options.margins.are_default
    ):  # with others, the guess is a motion, or was one in vain
        guesses.append(lambda: _near_the_throw_without_window(instance, seed, options, solver))
        if not isinstance(instance.problem.release, TargetRelease):
            guesses.reverse()
    *first, last = guesses
    for guess in first:
        try:
            return answer(*solved(guess(), solver), solver)
        except SolverFailed:
            if solver.is_late:  # no sooner than another
                raise
    return answer(*solved(last(), solver), solver)


def _near_the_throw_without_window(instance: Instance, seed: Seed, options: SolveOptions, solver: Solver) -> Instance:
    """Returns the instance with the throw without its release window as initial guess.

    Raises:
        SolverFailed: there is none.
    """
    from planner.backends.casadi_nlp.answer import KnotStates, solved
    from planner.backends.casadi_nlp.instance import Instance

    nominal = replace(instance.problem, release_window_s=0.0, landing_tolerance_m=0.0)
    without_window, z = solved(Instance.of(nominal, seed, options.margins), solver)
    close = instance.from_guess(KnotStates.of(z, without_window.stages.launch), landing_offsets=0.0)
    return replace(close, fitted_at=without_window.fitted_at, aim=without_window.aim)


def load() -> None:
    """Loads casadi and the functions of every formula, once per process.

    Raises:
        BackendUnavailable: casadi is not installed.
    """
    _require_casadi()
    from planner.backends.casadi_nlp.functions import all_blocks

    all_blocks()


def build_solvers() -> None:
    """Builds the common solvers of this process.

    Raises:
        BackendUnavailable: casadi is not installed.
    """
    _require_casadi()
    from planner.backends.casadi_nlp.fatrop import launch_of
    from planner.backends.casadi_nlp.instance import common_layouts

    for stages in common_layouts():
        launch_of(stages)


def _require_casadi() -> None:
    try:
        import casadi  # noqa: F401
    except ImportError as error:
        raise BackendUnavailable("casadi", "casadi") from error
