"""The search for a plan: which back end, from which candidates, and what is feasible instead."""

from planner.search.auto import NOT_COMPILED, search_optimised
from planner.search.incumbent import Attempt, CertifiedSolution, PlanningSearch
from planner.search.nearest import nearest_problem
from planner.search.policy import POLICY
from planner.search.proofs import of_candidates, refuse_impossible
from planner.search.sequential import VARIANTS_BY_BACKEND, load_libraries, search_sequential
from planner.search.stops import search_with_stop
from planner.search.way_home import best_with_way_home

__all__ = [
    "NOT_COMPILED",
    "POLICY",
    "VARIANTS_BY_BACKEND",
    "Attempt",
    "CertifiedSolution",
    "PlanningSearch",
    "best_with_way_home",
    "load_libraries",
    "nearest_problem",
    "of_candidates",
    "refuse_impossible",
    "search_optimised",
    "search_sequential",
    "search_with_stop",
]
