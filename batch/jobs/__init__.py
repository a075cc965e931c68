"""One planning job, the same wherever it runs: a request, a cell and its profile in, the JSON of a plan out."""

from batch.jobs.lifetime import end_with_parent, end_with_starter
from batch.jobs.refusals import refusal_of
from batch.jobs.work import Planned, PlanningJob, initialise, load, solve, warm_up_job

__all__ = [
    "Planned",
    "PlanningJob",
    "end_with_parent",
    "end_with_starter",
    "initialise",
    "load",
    "refusal_of",
    "solve",
    "warm_up_job",
]
