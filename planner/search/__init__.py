"""The search for a plan: what is tried from which candidates, and the way home from what was found."""

from planner.search.chain import search_chain
from planner.search.optimise import optimise_from
from planner.search.record import CertifiedSolution, PlanningSearch
from planner.search.search import load_libraries, search_candidates
from planner.search.stops import certified_brake, search_after_brake, search_with_stop
from planner.search.tool_lines import line_motions
from planner.search.way_home import best_with_way_home, find_way_home

__all__ = [
    "CertifiedSolution",
    "PlanningSearch",
    "best_with_way_home",
    "certified_brake",
    "find_way_home",
    "line_motions",
    "load_libraries",
    "optimise_from",
    "search_after_brake",
    "search_candidates",
    "search_chain",
    "search_with_stop",
]
