"""The optimiser from one candidate: solved, certified, and solved again with wider margins after failed checks."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from planner.backends import casadi_nlp, ruckig_otg
from planner.backends.casadi_nlp import SolveOptions
from planner.certificate import Check
from planner.errors import SolverFailed
from planner.geometry import tool_state
from planner.problem import ThrowProblem
from planner.search.record import PlanningSearch
from planner.seeds import Candidate, InitialGuess, Seed
from planner.trajectory import Trajectory

ROUNDS = 4  # [-] solves from one initial guess, each after failed checks of the one before


def optimise(search: PlanningSearch, candidate: Candidate, guess: InitialGuess | None = None) -> bool:
    """Optimises from a candidate; returns whether a motion is certified, or known to be no sooner than the best.

    After failed checks it is solved again from there with wider margins.

    Args:
        search: updated in place.
        candidate: of its problem.
        guess: the initial guess. None: Ruckig's soonest motion; where Ruckig refuses the candidate, the optimiser's.
    """
    problem = search.problem
    search.step(1)
    begun_s = time.perf_counter() + _load(search)
    if guess is None:
        with suppress(SolverFailed):
            guess = ruckig_otg.initial_guess(problem, candidate)
    seed = Seed(candidate, guess)
    options = _first_options(search)
    is_settled = False
    result = ""
    for _ in range(ROUNDS):
        search.step(0)
        try:
            solution = casadi_nlp.solve(problem, seed, options)
        except casadi_nlp.SeedFailed as failure:
            search.iterations += failure.iterations
            result = str(failure)
            is_settled = failure.is_late
            break
        search.iterations += solution.iterations
        found = search.certify("casadi", solution)
        if found.is_valid:
            result = "certified"
            is_settled = True
            break
        failures = found.examination.failures
        result = f"not certified for {', '.join(check.name for check in failures)}"
        wider = _wider(problem, options.margins, failures, solution.trajectory)
        if wider is None:
            break
        seed = Seed(candidate, solution.trajectory)
        options = replace(options, margins=wider, groups=options.groups | solution.held)
    search.log_attempt("casadi", f"{candidate.label}: {result}", begun_s)
    return is_settled


def optimise_from(search: PlanningSearch, throw: Trajectory) -> None:
    """Optimises from a throw at another target: moved to this one.

    Its release state is the candidate, and its samples are the initial guess.

    Args:
        search: of a target, from the first sample of the throw; updated in place.
        throw: the throw.
    """
    k = throw.release_index
    optimise(search, Candidate(throw.q[k], throw.qd[k], 0.0, "moved throw"), throw)


def _load(search: PlanningSearch) -> float:
    """Loads the optimiser, once a process; returns the seconds it took, for which the request's clock stands still."""
    begun_s = time.perf_counter()
    casadi_nlp.load()
    taken_s = time.perf_counter() - begun_s
    search.extend_deadline(taken_s)
    return taken_s


def _first_options(search: PlanningSearch) -> SolveOptions:
    """Returns how the first solve from a candidate begins.

    Of many shapes, those near the motion in which one was met count; rows for whichever is near at first end many a
    solve.
    """
    few = len(search.problem.cell_with_bin.surroundings.keep_out) <= casadi_nlp.KEEP_OUT_SHAPES
    return SolveOptions(
        margins=casadi_nlp.Margins(heeds_shapes=few),
        deadline_s=search.deadline_s,
        latest_s=search.latest_useful_s,
    )


def _wider(
    problem: ThrowProblem, margins: casadi_nlp.Margins, failures: Sequence[Check], made: Trajectory
) -> casadi_nlp.Margins | None:
    """Returns the margins after a solution's failed checks; None where another motion would fail them, too."""
    if problem.target is None and all(
        check.name == "flight_clearance" and not casadi_nlp.meets_arm(check) for check in failures
    ):
        return None  # the flight is given, and meets something but a link
    return margins.widened(failures, partial(_tool_speed, problem, made))


def _tool_speed(problem: ThrowProblem, made: Trajectory, at_s: float) -> float:
    """Returns the tool's speed in a motion at a time [s], over its limit."""
    q, qd, _ = made.at(np.array([at_s]))
    return float(np.linalg.norm(tool_state(problem.cell, q[0], qd[0]).v_WT)) / problem.limits.tcp_speed_max
