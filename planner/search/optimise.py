"""The optimiser from one seed: solved, certified, and solved again with wider margins after failed checks."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from planner.backends import casadi_nlp
from planner.backends.casadi_nlp import SolveOptions
from planner.certificate import Check
from planner.geometry import tool_state
from planner.problem import TargetRelease, ThrowProblem
from planner.search.incumbent import PlanningSearch
from planner.seeds import Seed
from planner.solution import Solution
from planner.trajectory import Trajectory

ROUNDS = 4  # [-] solves from one seed at most
SOLVE_ITERATIONS = (
    150  # [-] at least for a solve that is begun: what is left of a budget is no reason to give up half way
)


def optimise(search: PlanningSearch, problem: ThrowProblem, own: Seed, end: int, rounds: int = ROUNDS) -> bool:
    """Optimises from a seed until a motion is certified; returns whether one is.

    After failed checks it solves again with wider margins, from that motion, or where that leads nowhere from the seed
    itself.

    Raises:
        SeedFailed: the optimiser came to no motion, or to none that is sooner than the incumbent.
    """
    options = SolveOptions(
        replace(casadi_nlp.DEFAULT_MARGINS, held=search.held),
        deadline_s=search.deadline_s,
        latest_s=search.latest_useful_s,
    )
    seeds = (own,)
    for _ in range(rounds):
        solution = _from_any(search, problem, seeds, options, end)
        found = search.certify("casadi", solution)
        if found.is_valid:
            return True
        wider = _wider(search.problem, options.margins, found.certificate.failures, solution)
        if wider is None:
            return False
        seeds = (Seed(own.candidate, solution.trajectory), own)
        options = replace(options, margins=wider)
    return False


def load_optimiser(search: PlanningSearch) -> None:
    """Loads the optimiser; the request's clock stands still meanwhile."""
    begun = time.perf_counter()
    casadi_nlp.load()
    search.extend_deadline(time.perf_counter() - begun)


def _from_any(
    search: PlanningSearch, problem: ThrowProblem, seeds: Sequence[Seed], options: SolveOptions, end: int
) -> Solution:
    """Returns the optimiser's motion from the first seed that leads to one, until it is clear that it is too late."""
    for i, seed in enumerate(seeds):
        budget = max(end - search.iterations, SOLVE_ITERATIONS)
        try:
            solution = casadi_nlp.solve(problem, seed, replace(options, iteration_budget=budget))
        except casadi_nlp.SeedFailed as error:
            search.iterations += error.iterations
            search.held |= error.held
            if error.is_late or i == len(seeds) - 1:
                raise
        else:
            search.iterations += solution.iterations
            return solution
    raise AssertionError("no seed")


def _wider(
    problem: ThrowProblem, margins: casadi_nlp.Margins, failures: Sequence[Check], solution: Solution
) -> casadi_nlp.Margins | None:
    """Returns the margins after a solution's failed checks; None where another motion would fail them, too."""
    aims = isinstance(problem.release, TargetRelease)
    made = solution.trajectory
    if not aims and all(check.name == "flight_clearance" and not casadi_nlp.meets_arm(check) for check in failures):
        return None  # the flight is given, and meets something but a link
    return margins.widened(failures, solution, partial(_tool_speed, problem, made))


def _tool_speed(problem: ThrowProblem, made: Trajectory, at_s: float) -> float:
    """Returns the tool's speed in a motion at a time [s], over its limit."""
    q, qd, _ = made.at(np.array([at_s]))
    return float(np.linalg.norm(tool_state(problem.cell, q[0], qd[0]).v_WT)) / problem.limits.tcp_speed_max
