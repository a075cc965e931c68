"""The search of a back end requested by name: every variant on every candidate that could still be sooner."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from planner.backends import profiles, ruckig_otg, toppra_path
from planner.errors import SolverFailed
from planner.problem import ThrowProblem
from planner.search.incumbent import PlanningSearch, counted
from planner.seeds import Candidate
from planner.solution import Solution

Solve = Callable[[ThrowProblem, Candidate], Solution]

LAST_RESORT = partial(ruckig_otg.solve, variant=ruckig_otg.LAST_RESORT)  # tried only without an incumbent

# Every variant of every such back end, in the order in which they are tried.
VARIANTS_BY_BACKEND: dict[str, tuple[Solve, ...]] = {
    "ruckig": (*(partial(ruckig_otg.solve, variant=variant) for variant in ruckig_otg.VARIANTS[:-1]), LAST_RESORT),
    "toppra": tuple(partial(toppra_path.solve, variant=variant) for variant in toppra_path.VARIANTS),
    **{variant: (partial(profiles.solve, variant=variant),) for variant in profiles.VARIANTS},
}

# What each back end imports when it is used first; "auto" and "casadi" load the optimiser only where they come to it.
LIBRARIES: dict[str, Callable[[], object]] = {
    "auto": ruckig_otg.ruckig_module,
    "casadi": ruckig_otg.ruckig_module,
    "ruckig": ruckig_otg.ruckig_module,
    "toppra": toppra_path.toppra_module,
}


def load_libraries(backend: str) -> None:
    """Imports the libraries of a back end.

    Raises:
        BackendUnavailable: one is not installed.
    """
    if backend in LIBRARIES:
        LIBRARIES[backend]()


def search_sequential(search: PlanningSearch, backend: str, candidates: list[Candidate]) -> None:
    """Tries every variant of a back end on every candidate that could release sooner than the incumbent.

    Args:
        search: updated in place.
        backend: a key of `VARIANTS_BY_BACKEND`.
        candidates: by ascending lower bound on the launch time.
    """
    begun = time.perf_counter()
    tried = 0
    valid = 0
    failure = ""
    for candidate in candidates:
        if candidate.bound_s >= search.release_time_s or search.out_of_time:
            break
        for solve in VARIANTS_BY_BACKEND[backend]:
            if solve is LAST_RESORT and search.incumbent is not None:
                continue
            try:
                solution = solve(search.problem, candidate)
            except SolverFailed as error:
                failure = str(error)
                continue
            if solution.trajectory.release_time_s < search.release_time_s:
                tried += 1
                valid += search.certify(backend, solution).is_valid
    made = f"{valid} of {tried} motions certified" if tried else "no motion"
    result = f"{made} from {counted(len(candidates), 'candidate')}" + (f"; {failure}" if failure else "")
    search.log_attempt(backend, result, begun)
