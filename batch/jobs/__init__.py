"""One planning job, the same wherever it runs: a request, a cell and its profile in, the JSON of a plan out."""

from batch.jobs.work import Planned, PlanningJob, has_compiled_solvers, initialise, solve

__all__ = ["Planned", "PlanningJob", "has_compiled_solvers", "initialise", "solve"]
