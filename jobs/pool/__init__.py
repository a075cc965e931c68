"""A pool that plans many jobs: warm processes of this machine, or those of a Ray cluster. The same answers either way.

`open_pool` opens one, `plan_all` yields a result for each job, in the order in which they are made.
"""

from jobs.pool.opening import open_pool
from jobs.pool.planning_pool import PlanningPool, PoolBroken
from jobs.pool.results import PLANNING, JobResult, Work

__all__ = ["PLANNING", "JobResult", "PlanningPool", "PoolBroken", "Work", "open_pool"]
