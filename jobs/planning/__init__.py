"""One planning job, the same wherever it runs: a request, a cell and its profile in, a plan's document out."""

from jobs.planning.job import PlanningJob, PlanRecord, solve
from jobs.planning.refusals import refusal_of

__all__ = ["PlanRecord", "PlanningJob", "refusal_of", "solve"]
