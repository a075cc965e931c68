"""The search for the soonest motion of a problem.

    candidates, in order of a proven lower bound on their release time
      → from each, until two led to a motion: Ruckig where the joint states are given, and the optimiser
      → certificate
      → keep the best; drop what its release time excludes
      → nothing certified: Ruckig's slower motions, then a launch from another posture at rest

Counts alone decide what is tried, so the answer does not depend on the load of the machine. The only clock is the
request's own time limit.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from planner.backends import profiles, ruckig_otg, toppra_path
from planner.backends.solution import Solution
from planner.errors import SolverFailed
from planner.problem import ThrowProblem
from planner.search.optimise import optimise
from planner.search.record import PlanningSearch, counted
from planner.seeds import Candidate, aspects, least_times_to_aspects

Solve = Callable[[ThrowProblem, Candidate], Solution]

ENOUGH = 2  # [-] candidates that lead to a certified motion, or to none that is sooner: the best of them is kept
CANDIDATES = 10  # [-] that a search starts from; of a pose most others are full turns away
TICK_SLACK = 1e-6  # [ticks] for rounding

# Every motion of the back ends that try them all on every candidate.
MOTIONS: dict[str, tuple[Solve, ...]] = {
    "ruckig": tuple(partial(ruckig_otg.solve, variant=variant) for variant in ruckig_otg.VARIANTS),
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


def search_candidates(search: PlanningSearch, found: Sequence[Candidate], at_most: int = CANDIDATES) -> None:
    """Searches for the soonest motion to one of the candidates, by the problem's back end.

    Args:
        search: updated in place.
        found: candidates of its problem, by ascending lower bound on the launch time.
        at_most: how many of them the optimiser and the fallback start from; a back end that is named tries all.
    """
    problem = search.problem
    if problem.backend in MOTIONS:
        try_motions(search, problem.backend, found, MOTIONS[problem.backend])
        return
    is_auto = problem.backend == "auto"
    if is_auto and problem.fixes_joints:
        # Its soonest motion heeds nothing that couples joints.
        try_motions(search, "ruckig", found[:1], MOTIONS["ruckig"][:1])
    tried = 0
    settled = 0
    for candidate, least_s in _first(search, found):
        if tried == at_most or settled == ENOUGH or search.out_of_time:
            break
        if search.is_of_use(least_s):
            tried += 1
            settled += optimise(search, candidate)
    if is_auto and search.best is None and not search.out_of_time:
        try_motions(search, "ruckig", found[:at_most], MOTIONS["ruckig"])


def try_motions(search: PlanningSearch, backend: str, found: Sequence[Candidate], solvers: Sequence[Solve]) -> None:
    """Certifies the motions of a back end to candidates where they are sooner than the best.

    Args:
        search: updated in place.
        backend: that makes them.
        found: candidates by ascending lower bound.
        solvers: each makes one motion to a candidate.
    """
    begun_s = time.perf_counter()
    tried = 0
    valid = 0
    failure = ""
    for candidate in found:
        search.step(1)
        for solve in solvers:
            if not search.is_of_use(candidate.bound_s) or search.out_of_time:
                break
            try:
                motion = solve(search.problem, candidate)
            except SolverFailed as error:
                failure = f"; {error}"
                continue
            if search.is_of_use(motion.trajectory.release_time_s):
                tried += 1
                valid += search.certify(backend, motion).is_valid
    made = f"{valid} of {tried} motions certified" if tried else "no motion"
    search.log_attempt(backend, f"{made} from {counted(len(found), 'candidate')}{failure}", begun_s)


def _first(search: PlanningSearch, found: Sequence[Candidate]) -> Iterator[tuple[Candidate, float]]:
    """Yields the candidates to optimise from, each with a lower bound on the time of its release [s].

    Where the joint states are given, the optimiser keeps them: none releases before its slowest joint alone arrives.
    Otherwise it moves them within their aspect, and none releases before the arm can be there. The soonest candidate of
    every aspect comes first, then the second of every aspect, and so on.
    """
    problem = search.problem
    if problem.fixes_joints:
        for candidate in found:
            if not search.is_of_use(candidate.bound_s):  # nor is any that follows
                return
            yield candidate, _least_release_time(problem, candidate)
        return
    aspect = aspects(problem.cell.robot, np.array([each.q for each in found])).tolist()
    least_s = least_times_to_aspects(problem)
    place = [aspect[:row].count(aspect[row]) for row in range(len(found))]
    for row in sorted(range(len(found)), key=place.__getitem__):
        yield found[row], float(least_s[aspect[row]])


def _least_release_time(problem: ThrowProblem, candidate: Candidate) -> float:
    """Returns the first tick at which the slowest joint can be at a given state [s]; infinite if Ruckig refuses it."""
    arrival = ruckig_otg.arrival(problem, candidate)
    if arrival is None:
        return math.inf
    return problem.dt * (max(math.ceil(arrival.time_s / problem.dt - TICK_SLACK), ruckig_otg.TICKS_MIN) + TICK_SLACK)
