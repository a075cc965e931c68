"""Release states that the search starts from, ranked by a lower bound on their launch time."""

from planner.seeds.aspects import ASPECTS, aspects, first_rows, least_times_to_aspects
from planner.seeds.candidates import Candidate, InitialGuess, NoCandidates, Seed, candidates
from planner.seeds.nearby_postures import near_candidates
from planner.seeds.neighbours import ReleaseState, neighbour_candidates
from planner.seeds.quasi_random import SPREAD_RAD
from planner.seeds.sampling import farthest_reach
from planner.seeds.soonest_states import least_time
from planner.seeds.state_limits import POSITION_SLACK
from planner.seeds.velocity_allocation import allocate_velocity, tool_jacobian

__all__ = [
    "ASPECTS",
    "POSITION_SLACK",
    "SPREAD_RAD",
    "Candidate",
    "InitialGuess",
    "NoCandidates",
    "ReleaseState",
    "Seed",
    "allocate_velocity",
    "aspects",
    "candidates",
    "farthest_reach",
    "first_rows",
    "least_time",
    "least_times_to_aspects",
    "near_candidates",
    "neighbour_candidates",
    "tool_jacobian",
]
