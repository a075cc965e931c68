"""Release states that the search starts from, ranked by a lower bound on their launch time."""

from planner.seeds.candidates import POSITION_SLACK, Candidate, InitialGuess, Seed, candidates
from planner.seeds.neighbours import ReleaseState, neighbour_candidates
from planner.seeds.quasi_random import SPREAD_RAD
from planner.seeds.sampling import farthest_reach, tool_jacobian
from planner.seeds.soonest_states import least_time
from planner.seeds.velocity_allocation import allocate_velocity

__all__ = [
    "POSITION_SLACK",
    "SPREAD_RAD",
    "Candidate",
    "InitialGuess",
    "ReleaseState",
    "Seed",
    "allocate_velocity",
    "candidates",
    "farthest_reach",
    "least_time",
    "neighbour_candidates",
    "tool_jacobian",
]
