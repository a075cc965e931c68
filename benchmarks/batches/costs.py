"""What a plan of a batch costs beside its planning: the engine's time, the store's time and bytes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from jobs.planning import PlanningJob, PlanRecord
from jobs.pool import JobResult, Work, open_pool, warm_up_job
from jobs.writer import GROUP
from planner.cell import read_source
from planner.cell_folder import default_cells_folder
from planner.progress import Observer
from store import BatchResultRow, PlanRow, Store, new_id

CELL = "ur5e-sim"
ALONE_COUNT = 1000  # results of an engine alone
SUMMARY_BYTES = 6_500
SAMPLES_BYTES = 50_000  # of a usual plan


@dataclass(frozen=True)
class EngineCost:
    """An engine's run over jobs, from when all workers were warm.

    Attributes:
        workers: their number.
        plans_per_s: results per second [1/s].
        overhead_ms: time of a worker per result beyond its planning [ms], waiting at the end included.
        planning_ms: mean planning time [ms].
        alone_ms: time per result of one worker whose planning is to answer with stored bytes [ms].
    """

    workers: int
    plans_per_s: float
    overhead_ms: float
    planning_ms: float
    alone_ms: float


@dataclass(frozen=True)
class StoreCost:
    """What storing one plan and its result takes [ms], and its bytes in the database."""

    time_ms: float
    plan_bytes: float


def engine_cost(requests: Sequence[dict], workers: int, ray: str | None) -> tuple[EngineCost, list[JobResult]]:
    """Plans requests in a pool alone, without a store; returns the cost and the results."""
    source = read_source(default_cells_folder() / f"{CELL}.toml")
    jobs = [PlanningJob(new_id(), 0.0, source, {**request, "cell": CELL}) for request in requests]
    with open_pool(workers, ray, Work(warm_up=warm_up_job(source))) as pool:
        pool.wait_until_warm()
        began = time.perf_counter()
        results = list(pool.plan_all(jobs))
        duration_s = time.perf_counter() - began
    planning_s = sum(result.duration_s for result in results)
    count = len(results)
    overhead_ms = 1e3 * (workers * duration_s - planning_s) / count
    alone_ms = _engine_alone_ms(jobs[0], ray)
    return EngineCost(workers, count / duration_s, overhead_ms, 1e3 * planning_s / count, alone_ms), results


def _engine_alone_ms(job: PlanningJob, ray: str | None) -> float:
    with open_pool(1, ray, work=Work(_load_nothing, _answer_bytes)) as pool:
        pool.wait_until_warm()
        list(pool.plan_all([job] * ALONE_COUNT))
        began = time.perf_counter()
        list(pool.plan_all([job] * ALONE_COUNT))
        return 1e3 * (time.perf_counter() - began) / ALONE_COUNT


def _load_nothing(_: PlanningJob | None) -> None: ...


def _answer_bytes(_: PlanningJob, observer: Observer | None) -> PlanRecord:
    return PlanRecord(PlanRow("", 0.0, CELL, "", "none", bytes(SUMMARY_BYTES), None, bytes(SAMPLES_BYTES)), 0.3, 0.6)


def store_cost(folder: Path, results: Sequence[JobResult]) -> StoreCost:
    """Stores the plans of these results as a driver does, and nothing else."""
    store = Store.open(f"sqlite:///{folder / 'cost.db'}")
    planned = [result.planned for result in results if result.planned is not None]
    id = store.add_batch(b"", len(planned)).id
    store.claim_batch(id, "benchmark")
    empty_bytes = _size(folder)
    began = time.perf_counter()
    for first in range(0, len(planned), GROUP):
        group = planned[first : first + GROUP]
        ids = [new_id() for _ in group]
        rows = [
            BatchResultRow(id, first + k, f"{first + k:064x}", "planned", 0.1, ids[k], f"{k:064x}", 0.3, 0.6)
            for k in range(len(group))
        ]
        plans = [replace(one.row, id=ids[k]) for k, one in enumerate(group)]
        store.add_batch_results(id, "benchmark", rows, plans)
    duration_s = time.perf_counter() - began
    store.close()
    return StoreCost(1e3 * duration_s / len(planned), (_size(folder) - empty_bytes) / len(planned))


def _size(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.iterdir() if file.name.startswith("cost.db"))
