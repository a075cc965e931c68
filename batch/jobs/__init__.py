"""One planning job, the same wherever it runs: a request, a cell and its profile in, the JSON of a plan out."""

from batch.jobs.refusals import refusal_of
from batch.jobs.work import (
    NICENESS,
    Planned,
    PlanningJob,
    end_with_parent,
    has_compiled_solvers,
    initialise,
    load,
    solve,
)

__all__ = [
    "NICENESS",
    "Planned",
    "PlanningJob",
    "end_with_parent",
    "has_compiled_solvers",
    "initialise",
    "load",
    "refusal_of",
    "solve",
]
