"""The search for a plan: which back end, from which candidates, and what is feasible instead."""

from planner.search.auto import search_optimised
from planner.search.incumbent import Attempt, CertifiedSolution, PlanningSearch
from planner.search.nearest import nearest_release
from planner.search.policy import POLICY
from planner.search.sequential import VARIANTS_BY_BACKEND, search_sequential

__all__ = [
    "POLICY",
    "VARIANTS_BY_BACKEND",
    "Attempt",
    "CertifiedSolution",
    "PlanningSearch",
    "nearest_release",
    "search_optimised",
    "search_sequential",
]
