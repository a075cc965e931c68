"""What refuses a problem, and what is offered instead: proofs that need no search, and a feasible problem near it."""

from planner.refusal.nearest import nearest_problem
from planner.refusal.proofs import farthest_target_m, of_candidates, refuse_impossible
from planner.refusal.throw_range import shoulder_position

__all__ = [
    "farthest_target_m",
    "nearest_problem",
    "of_candidates",
    "refuse_impossible",
    "shoulder_position",
]
