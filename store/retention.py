"""Retention: deletes what is old or too much, in short transactions; never a plan in use.

An execution goes with its events, recording and landings, if it has finished and belongs to no experiment and no job. A
plan goes if no execution, batch, map or job refers to it any more, a finished batch with its results. Jobs stay.
Idempotency keys go with what they stand for.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, Connection, delete, exists, select, tuple_

from store.database import Repository, writing
from store.tables import (
    batch_results,
    batches,
    events,
    executions,
    idempotency,
    job_cycles,
    landing_cells,
    landings,
    plans,
    recordings,
)

DAY_S = 86400.0  # [s]
YOUNG_S = 600.0  # [s] a plan this young may be about to be executed
RESULTS = 1000  # rows of results, which are small, in one transaction
BATCH = 20  # rows in one transaction: other writers wait for some ten milliseconds at most
# Nothing refers to a plan.
UNUSED = (
    ~exists().where(executions.c.plan_id == plans.c.id)
    & ~exists().where(batch_results.c.plan_id == plans.c.id)
    & ~exists().where(landing_cells.c.plan_id == plans.c.id)
    & ~exists().where(job_cycles.c.plan_id == plans.c.id)
)
OF_NO_JOB = ~exists().where(job_cycles.c.execution_id == executions.c.id)


@dataclass(frozen=True)
class Retention:
    """How much is kept; None: everything.

    Attributes:
        plans, plans_days: Number and age [days] of the plans that no execution, batch, map or job refers to.
        executions, executions_days: Number and age [days] of the finished executions.
        batches, batches_days: Number and age [days] of the finished batches.
    """

    plans: int | None = None
    plans_days: float | None = None
    executions: int | None = None
    executions_days: float | None = None
    batches: int | None = None
    batches_days: float | None = None


class RetentionRepository(Repository):
    """Deletes rows of plans and executions, and of what belongs to them."""

    def retain(self, keep: Retention) -> tuple[int, int]:
        """Deletes what `keep` gives up. Returns the numbers of deleted plans and executions."""
        finished = (executions.c.state == "finished") & executions.c.experiment_id.is_(None) & OF_NO_JOB
        bound = self._bound(executions, finished, keep.executions, keep.executions_days, 0.0)
        runs = 0 if bound is None else self._delete_all(executions, bound & finished, _delete_executions)
        bound = self._bound(plans, UNUSED, keep.plans, keep.plans_days, YOUNG_S)
        return (0 if bound is None else self._delete_all(plans, bound & UNUSED, _delete_plans)), runs

    def retain_batches(self, keep: Retention) -> int:
        """Deletes the finished batches that `keep` gives up, with their results; returns their number."""
        finished = batches.c.state == "finished"
        bound = self._bound(batches, finished, keep.batches, keep.batches_days, 0.0)
        if bound is None:
            return 0
        of_these = batch_results.c.batch_id.in_(select(batches.c.id).where(bound & finished))
        self._delete_results(of_these)
        return self._delete_all(batches, bound & finished, _delete_batches)

    def _delete_results(self, where: ColumnElement[bool]) -> None:
        key = tuple_(batch_results.c.batch_id, batch_results.c.number)
        some = select(batch_results.c.batch_id, batch_results.c.number).where(where).limit(RESULTS)
        while True:
            with writing(self._engine) as connection:
                if connection.execute(delete(batch_results).where(key.in_(some))).rowcount < RESULTS:
                    return

    def _bound(
        self, table: Any, where: ColumnElement[bool], count: int | None, days: float | None, young_s: float
    ) -> ColumnElement[bool] | None:
        """Returns the condition of what is too old or too much; None where everything is kept."""
        now = time.time()
        bounds = []
        if days is not None:
            bounds.append(table.c.created_at < now - days * DAY_S)
        if count is not None:
            newest = select(table.c.id).where(where).order_by(table.c.id.desc()).offset(count).limit(1)
            bounds.append(table.c.id <= (self._value(newest) or ""))
        if not bounds:
            return None
        either = bounds[0] if len(bounds) == 1 else bounds[0] | bounds[1]
        return either & (table.c.created_at < now - young_s)

    def _delete_all(self, table: Any, where: ColumnElement[bool], remove: Any) -> int:
        """Deletes every row that meets the condition; returns their number."""
        total = 0
        while True:
            with writing(self._engine) as connection:
                some = select(table.c.id).where(where).limit(BATCH).with_for_update(skip_locked=True)
                ids = list(connection.execute(some).scalars())
                total += remove(connection, ids) if ids else 0
            if len(ids) < BATCH:
                return total


def _delete_executions(connection: Connection, ids: list[str]) -> int:
    of_landings = select(landings.c.id).where(landings.c.execution_id.in_(ids))
    connection.execute(delete(idempotency).where(idempotency.c.resource_id.in_(of_landings)))
    for table in (events, recordings, landings):
        connection.execute(delete(table).where(table.c.execution_id.in_(ids)))
    connection.execute(delete(idempotency).where(idempotency.c.resource_id.in_(ids)))
    return connection.execute(delete(executions).where(executions.c.id.in_(ids))).rowcount


def _delete_batches(connection: Connection, ids: list[str]) -> int:
    connection.execute(delete(idempotency).where(idempotency.c.resource_id.in_(ids)))
    return connection.execute(delete(batches).where(batches.c.id.in_(ids))).rowcount


def _delete_plans(connection: Connection, ids: list[str]) -> int:
    """Deletes plans; one that was put to use since the ids were read is kept."""
    gone = delete(plans).where(plans.c.id.in_(ids), UNUSED).returning(plans.c.id)
    deleted = list(connection.execute(gone).scalars())
    connection.execute(delete(idempotency).where(idempotency.c.resource_id.in_(deleted)))
    return len(deleted)
