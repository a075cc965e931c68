"""The search for a plan: which back end, from which candidates, and what is feasible instead."""

from planner.search.auto import search_once
from planner.search.incumbent import Attempt, CertifiedSolution, PlanningSearch
from planner.search.nearest import nearest_problem
from planner.search.proofs import farthest_target_m, of_candidates, refuse_impossible
from planner.search.sequential import VARIANTS_BY_BACKEND, load_libraries, search_sequential
from planner.search.stops import search_with_stop
from planner.search.throw_range import shoulder_position
from planner.search.way_home import best_with_way_home

__all__ = [
    "VARIANTS_BY_BACKEND",
    "Attempt",
    "CertifiedSolution",
    "PlanningSearch",
    "best_with_way_home",
    "farthest_target_m",
    "load_libraries",
    "nearest_problem",
    "of_candidates",
    "refuse_impossible",
    "search_once",
    "search_sequential",
    "search_with_stop",
    "shoulder_position",
]
