"""A pool that plans many jobs: warm processes of this machine, or those of a Ray cluster. The same answers either way.

`open_pool` opens one, `plan_all` yields a result for each job, in the order in which they are made.
"""

from batch.pool.opening import open_pool
from batch.pool.planning_pool import PlanningPool, PoolBroken
from batch.pool.results import PLANNING, JobResult, Work

__all__ = ["PLANNING", "JobResult", "PlanningPool", "PoolBroken", "Work", "open_pool"]
