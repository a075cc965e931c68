"""The audit of many problems on the pool of planner processes, this machine's or a Ray cluster's."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from audit.record import AuditRecord, rows_sha256, signature
from audit.summary import AuditSummary, summary_of
from audit.trial import AuditTask, Trial, tried
from jobs.pool import BATCH_NICENESS, JobResult, Work, open_pool

GRACE_S = 600.0  # [s] beyond a search's time limit, for judge and verifier on a busy machine


@dataclass(frozen=True)
class AuditOptions:
    """What is audited, and where.

    Attributes:
        count: problems, of the indices from 0 on.
        seed: of the problems.
        out: folder of the record.
        resume: whether to continue what is there.
        proofs: share of the plans that the verifier is asked for, too [-].
        workers: processes; None: one a core.
        ray_address: of a Ray cluster; None: processes of this machine.
    """

    count: int
    seed: int
    out: Path
    resume: bool = False
    proofs: float = 0.0
    workers: int | None = None
    ray_address: str | None = None


def run_audit(
    options: AuditOptions,
    tell: Callable[[Trial], None] = lambda trial: None,
    must_stop: Callable[[], bool] = lambda: False,
) -> AuditSummary:
    """Tries the problems that the record lacks, and returns what the record says then.

    Args:
        options: what is audited.
        tell: told of each problem as it is done.
        must_stop: asked every second; true ends the audit, and what is done stays.

    Raises:
        RecordRefused: there is a record already, or one of another commit or seed.
        PoolBroken: no worker can be started.
    """
    with AuditRecord(options.out, signature(options.seed, options.proofs), options.resume) as record:
        lacking = [index for index in range(options.count) if index not in record.rows]
        for trial in _trials(options, lacking, must_stop) if lacking else ():
            record.add(trial)
            tell(trial)
        rows = {index: row for index, row in record.rows.items() if index < options.count}
        summary = summary_of(rows, rows_sha256(rows), record.size_bytes)
        record.end(summary.as_document())
    return summary


def _trials(options: AuditOptions, indices: list[int], must_stop: Callable[[], bool]) -> Iterator[Trial]:
    """Yields what becomes of problems, in the order in which they are done."""
    work = Work(load=_nothing, solve=cast(Any, tried), niceness=BATCH_NICENESS)
    tasks = [AuditTask(options.seed, index, options.proofs) for index in indices]
    with open_pool(options.workers, options.ray_address, work, GRACE_S) as pool:
        for result in pool.plan_all(cast(Any, tasks), must_stop):
            yield _trial(tasks[result.number], result)


def _trial(task: AuditTask, result: JobResult) -> Trial:
    """Returns the trial that a worker answers with; of one that broke down, its error."""
    if result.planned is not None:
        return cast(Trial, result.planned)
    return Trial(task.index, "unknown", "unknown", "error", why=str(result.error))


def _nothing(warm_up: object) -> None:
    """Loads nothing before the first task."""
