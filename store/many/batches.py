"""Batches of planning requests and their results: queued by service or command line, planned by one driver at a time.

A driver claims a batch, and every write of its own checks that it still has it: a driver that was presumed dead and
comes back writes nothing. A result is written once, in one transaction with its plan and the batch's counts.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence

from sqlalchemy import Connection, insert, or_, select, update

from store.database import Repository, StoreError, reading, required_row, writing
from store.idempotency_and_audit import take_key, write_audit
from store.plans import insert_plan_if_new
from store.rows import DRIVER_FRESH_S, AuditLine, BatchResultRow, BatchRow, IdempotencyKey, PlanRow, new_id
from store.tables import batch_results, batches

HEAD_COLUMNS = [column for column in batches.c if column.name != "specification"]
UNFINISHED = batches.c.state != "finished"
PAGE = 10_000  # numbers read at once
RESULTS_PAGE = 1000  # results read at once


class BatchDriven(StoreError):
    """Another driver has the batch, and is alive."""


class BatchLost(StoreError):
    """Another driver has taken the batch over, or it was finished."""


class BatchRepository(Repository):
    """Tables `batches` and `batch_results`."""

    def add_batch(
        self,
        specification: bytes,
        total: int,
        created_by: str = "",
        driven_by: str = "service",
        key: IdempotencyKey | None = None,
        audit: AuditLine | None = None,
    ) -> BatchRow:
        """Queues a batch.

        Args:
            specification: Its requests.
            total: Their number.
            created_by: Who wants it.
            driven_by: Whose drivers take it up: "service" or "command".
            key: Idempotency key of the request.
            audit: Who creates it.

        Raises:
            KeyTaken: `key` is bound to another batch; nothing is stored.
        """
        id = new_id()
        now = time.time()
        row = {"id": id, "created_at": now, "created_by": created_by, "request_id": audit and audit.request_id}
        row |= {"driven_by": driven_by, "specification": specification, "total": total}
        with writing(self._engine) as connection:
            take_key(connection, key, id, now)
            connection.execute(insert(batches).values(**row, state="queued", counts={}, started_done=0))
            write_audit(connection, audit, f"/batches/{id}")
            return _read(connection, id)

    def batch(self, id: str, whole: bool = False) -> BatchRow | None:
        """Returns one batch; with its specification if `whole`."""
        columns = list(batches.c) if whole else HEAD_COLUMNS
        return self._row(BatchRow, select(*columns).where(batches.c.id == id))

    def batches(self, limit: int = 50, cursor: str | None = None) -> tuple[list[BatchRow], str | None]:
        """Returns batches, newest first, and the cursor of the next page (None after the last)."""
        return self._page(BatchRow, select(*HEAD_COLUMNS), batches, limit, cursor)

    def unfinished_batches(self, driven_by: str) -> list[BatchRow]:
        """Returns the batches that drivers of this kind have to plan, oldest first."""
        query = select(*HEAD_COLUMNS).where(UNFINISHED, batches.c.driven_by == driven_by)
        return self._rows(BatchRow, query.order_by(batches.c.id))

    def claim_batch(self, id: str, driver_id: str) -> BatchRow:
        """Makes a driver the one of an unfinished batch.

        Raises:
            UnknownRow: There is no such batch.
            BatchDriven: Another driver has it, and is alive.
            BatchLost: It is finished.
        """
        now = time.time()
        free = or_(
            batches.c.driver_id.is_(None),
            batches.c.driver_id == driver_id,
            batches.c.heartbeat_at < now - DRIVER_FRESH_S,
        )
        with writing(self._engine) as connection:
            row = _read(connection, id, lock=True)
            claim = update(batches).where(batches.c.id == id, UNFINISHED, free)
            values = {"state": "running", "driver_id": driver_id, "heartbeat_at": now, "started_at": now}
            if connection.execute(claim.values(**values, started_done=row.done)).rowcount:
                return _read(connection, id)
        if row.state == "finished":
            raise BatchLost(f"batch {id} is finished: {row.outcome}")
        raise BatchDriven(f"batch {id} is being planned by {row.driver_id}")

    def beat_batch(self, id: str, driver_id: str) -> BatchRow:
        """Records a heartbeat of a batch's driver; returns the batch.

        Raises:
            BatchLost: It is not this driver's any more.
        """
        with writing(self._engine) as connection:
            _require_driver(connection, id, driver_id)
            connection.execute(update(batches).where(batches.c.id == id).values(heartbeat_at=time.time()))
            return _read(connection, id)

    def add_batch_results(
        self, id: str, driver_id: str, results: Sequence[BatchResultRow], made: Sequence[PlanRow]
    ) -> BatchRow:
        """Stores results and their plans, each unless it is there already; returns the batch with its counts.

        Raises:
            BatchLost: It is not this driver's any more; nothing is stored.
        """
        with writing(self._engine) as connection:
            counts = Counter(_require_driver(connection, id, driver_id).counts)
            known = _known_numbers(connection, id, results)
            new = [row for row in results if row.number not in known]
            for plan in made:
                insert_plan_if_new(connection, plan)
            if new:
                connection.execute(insert(batch_results), [vars(row) for row in new])
            counts.update(row.outcome for row in new)
            values = {"counts": dict(counts), "heartbeat_at": time.time()}
            connection.execute(update(batches).where(batches.c.id == id).values(**values))
            return _read(connection, id)

    def release_batch(self, id: str, driver_id: str) -> None:
        """Puts a batch back into the queue: its driver stops before the end.

        Raises:
            BatchLost: It is not this driver's any more.
        """
        with writing(self._engine) as connection:
            _require_driver(connection, id, driver_id)
            values = {"state": "queued", "driver_id": None, "heartbeat_at": None}
            connection.execute(update(batches).where(batches.c.id == id).values(**values))

    def finish_batch(self, id: str, outcome: str, reason: str | None = None) -> bool:
        """Finishes a batch. Returns False if it was finished already."""
        with writing(self._engine) as connection:
            return _finish(connection, id, outcome, reason)

    def cancel_batch(self, id: str, audit: AuditLine | None = None) -> BatchRow:
        """Asks a batch's driver to stop; a batch without a driver ends immediately. Repeated requests change nothing.

        Raises:
            UnknownRow: There is no such batch.
        """
        with writing(self._engine) as connection:
            row = _read(connection, id, lock=True)
            first = update(batches).where(batches.c.id == id, UNFINISHED, batches.c.cancel_requested_at.is_(None))
            connection.execute(first.values(cancel_requested_at=time.time()))
            if not row.is_driven:
                _finish(connection, id, "cancelled", None)
            write_audit(connection, audit, f"/batches/{id}")
            return _read(connection, id)

    def batch_results(self, id: str, limit: int = 50, after: int = -1) -> tuple[list[BatchResultRow], int | None]:
        """Returns results in the order of their requests, and the number to go on after (None after the last)."""
        query = select(batch_results).where(batch_results.c.batch_id == id, batch_results.c.number > after)
        rows = self._rows(BatchResultRow, query.order_by(batch_results.c.number).limit(limit + 1))
        return rows[:limit], rows[limit - 1].number if len(rows) > limit else None

    def all_batch_results(self, id: str) -> Iterator[BatchResultRow]:
        """Yields all results in the order of their requests, read in pages."""
        after: int | None = -1
        while after is not None:
            rows, after = self.batch_results(id, RESULTS_PAGE, after)
            yield from rows

    def batch_numbers(self, id: str) -> Iterator[int]:
        """Yields the numbers of the requests that have a result."""
        after = -1
        while True:
            query = select(batch_results.c.number).where(batch_results.c.batch_id == id, batch_results.c.number > after)
            with reading(self._engine) as connection:
                numbers = list(connection.execute(query.order_by(batch_results.c.number).limit(PAGE)).scalars())
            yield from numbers
            if len(numbers) < PAGE:
                return
            after = numbers[-1]

    def batch_result_of(self, id: str, problem_sha256: str) -> BatchResultRow | None:
        """Returns the result of a problem in a batch: of the first of its requests that has one."""
        where = (batch_results.c.batch_id == id) & (batch_results.c.problem_sha256 == problem_sha256)
        return self._row(BatchResultRow, select(batch_results).where(where).order_by(batch_results.c.number).limit(1))


def _read(connection: Connection, id: str, lock: bool = False) -> BatchRow:
    query = select(*HEAD_COLUMNS).where(batches.c.id == id)
    return required_row(connection, BatchRow, query, f"batch {id!r}", lock)


def _require_driver(connection: Connection, id: str, driver_id: str) -> BatchRow:
    """Returns a batch, locked until the transaction ends, if it is this driver's."""
    row = _read(connection, id, lock=True)
    if row.driver_id != driver_id or row.state != "running":
        raise BatchLost(f"batch {id} is {row.state} now, its driver {row.driver_id}")
    return row


def _known_numbers(connection: Connection, id: str, results: Sequence[BatchResultRow]) -> set[int]:
    numbers = [row.number for row in results]
    where = (batch_results.c.batch_id == id) & batch_results.c.number.in_(numbers)
    return set(connection.execute(select(batch_results.c.number).where(where)).scalars())


def _finish(connection: Connection, id: str, outcome: str, reason: str | None) -> bool:
    values = {"state": "finished", "outcome": outcome, "reason": reason, "finished_at": time.time()}
    change = update(batches).where(batches.c.id == id, UNFINISHED).values(**values)
    return bool(connection.execute(change).rowcount)
