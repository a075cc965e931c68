"""How candidates become answers: one back end over all candidates, soonest first."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from planner.backends import profiles, ruckig_otg, toppra_path
from planner.errors import Infeasible, SolverFailed
from planner.problem import ThrowProblem
from planner.search.incumbent import Search
from planner.seeds.candidates import Candidate
from planner.solution import Solution

Solve = Callable[[ThrowProblem, Candidate], Solution]

SPARE = partial(ruckig_otg.solve, variant=ruckig_otg.LAST_RESORT)  # tried only while there is no answer

# Every way of every back end that answers for one candidate at a time, in the order in which they are tried.
WAYS: dict[str, tuple[Solve, ...]] = {
    "ruckig": (*(partial(ruckig_otg.solve, variant=variant) for variant in ruckig_otg.VARIANTS[:-1]), SPARE),
    "toppra": tuple(partial(toppra_path.solve, variant=variant) for variant in toppra_path.VARIANTS),
    **{variant: (partial(profiles.solve, variant=variant),) for variant in profiles.VARIANTS},
}


def one_by_one(search: Search, backend: str, seeds: list[Candidate]) -> None:
    """Tries every way of a back end on every candidate that could still be sooner than the best answer."""
    begun, tried, valid, failure = time.perf_counter(), 0, 0, ""
    for seed in seeds:
        if seed.bound_s >= search.release_time_s or search.left_s <= 0.0:
            break
        for solve in WAYS[backend]:
            if solve is SPARE and search.best is not None:
                continue
            try:
                solution = solve(search.problem, seed)
            except (SolverFailed, Infeasible) as error:
                failure = str(error)
                continue
            if solution.trajectory.release_time_s < search.release_time_s:
                tried += 1
                valid += search.judge(backend, solution).valid
    result = f"{valid} of {tried} motions certified" + (f"; {failure}" if failure else "")
    search.tell(backend, result, begun)
