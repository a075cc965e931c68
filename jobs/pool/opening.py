"""Opening a pool: which engine its workers are of."""

from __future__ import annotations

import os

from jobs.planning import PlanningJob
from jobs.pool.local_engine import LocalEngine
from jobs.pool.planning_pool import GRACE_S, PlanningPool
from jobs.pool.ray_engine import RayEngine
from jobs.pool.results import PLANNING, Work


def open_pool(
    workers: int | None = None,
    ray_address: str | None = None,
    warm_up: PlanningJob | None = None,
    work: Work = PLANNING,
    grace_s: float = GRACE_S,
) -> PlanningPool:
    """Opens a pool. Its workers start at once; they are warm some seconds later, and jobs can be given before.

    Args:
        workers: Number of workers; None: one a core of this machine, or of the cluster.
        ray_address: Address of a Ray cluster; None: processes of this machine.
        warm_up: Planned by each worker when it starts.
        work: What a worker does; replaced in tests.
        grace_s: A worker that exceeds the time limit of its job by more than this is replaced [s].

    Raises:
        PoolBroken: Ray is not installed, or there is no cluster at this address.
    """
    if ray_address:
        return PlanningPool(RayEngine(ray_address, workers, warm_up, work), grace_s)
    return PlanningPool(LocalEngine(workers or os.cpu_count() or 1, warm_up, work), grace_s)
