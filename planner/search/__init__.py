"""The search for a plan: which back end, from which candidates, and what is feasible instead."""

from planner.search.auto import NOT_COMPILED, search_optimised
from planner.search.incumbent import Attempt, CertifiedSolution, PlanningSearch
from planner.search.nearest import nearest_problem
from planner.search.policy import LAST_POLICY, POLICY, SHORT_POLICY
from planner.search.proofs import farthest_target_m, of_candidates, refuse_impossible
from planner.search.ranking import Ranking
from planner.search.sequential import VARIANTS_BY_BACKEND, load_libraries, search_sequential
from planner.search.stops import search_with_stop
from planner.search.throw_range import shoulder_position
from planner.search.tighter import search_thoroughly
from planner.search.way_home import best_with_way_home

__all__ = [
    "LAST_POLICY",
    "NOT_COMPILED",
    "POLICY",
    "SHORT_POLICY",
    "VARIANTS_BY_BACKEND",
    "Attempt",
    "CertifiedSolution",
    "PlanningSearch",
    "Ranking",
    "best_with_way_home",
    "farthest_target_m",
    "load_libraries",
    "nearest_problem",
    "of_candidates",
    "refuse_impossible",
    "search_optimised",
    "search_sequential",
    "search_thoroughly",
    "search_with_stop",
    "shoulder_position",
]
