"""The pool of planner processes: those of this machine, or actors of a Ray cluster. The answers are the same.

`open_pool` opens one. `submit` plans one job and answers with a future; `plan_all` yields the results of many.
"""

from jobs.pool.lifetime import end_with_starter
from jobs.pool.pool import PlannerPool, open_pool
from jobs.pool.worker import BATCH_NICENESS, NICENESS, PLANNING, JobResult, PlannerBug, PoolBroken, Work, warm_up_job

__all__ = [
    "BATCH_NICENESS",
    "NICENESS",
    "PLANNING",
    "JobResult",
    "PlannerBug",
    "PlannerPool",
    "PoolBroken",
    "Work",
    "end_with_starter",
    "open_pool",
    "warm_up_job",
]
