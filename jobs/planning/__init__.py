"""One planning job, the same wherever it runs: a request, a cell and its profile in, the JSON of a plan out."""

from jobs.planning.lifetime import end_with_parent, end_with_starter
from jobs.planning.refusals import refusal_of
from jobs.planning.work import Planned, PlanningJob, has_compiled_solvers, initialise, load, solve, warm_up_job

__all__ = [
    "Planned",
    "PlanningJob",
    "end_with_parent",
    "end_with_starter",
    "has_compiled_solvers",
    "initialise",
    "load",
    "refusal_of",
    "solve",
    "warm_up_job",
]
