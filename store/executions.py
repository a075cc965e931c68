"""Executions as the service sees them: queue, look, ask to abort."""

from __future__ import annotations

from sqlalchemy import Connection, func, insert, select, update
from sqlalchemy.exc import IntegrityError

from store.access import take_key
from store.area import Area
from store.engine import reading, writing
from store.errors import CellBusy, UnknownPlan
from store.identifiers import new_id
from store.rows import EventRow, ExecutionRow, IdempotencyKey, RecordingRow
from store.runs import read_execution, write_event
from store.tables import events, executions, plans, recordings


class Executions(Area):
    """Statements about executions, for the service."""

    def queue_execution(
        self,
        plan_id: str,
        cell: str,
        mode: str = "speedj",
        dry_run: bool = False,
        requested_by: str = "",
        key: IdempotencyKey | None = None,
    ) -> ExecutionRow:
        """Queues one execution of a plan.

        Raises:
            CellBusy: the cell has one that is not finished.
            KeyTaken: `key` stands for another execution already.
            UnknownPlan: there is no such plan.
        """
        id, now = new_id(), self._now()
        row = {"id": id, "plan_id": plan_id, "cell": cell, "mode": mode, "dry_run": dry_run}
        with writing(self._engine) as connection:
            take_key(connection, key, id, now)
            if connection.execute(select(plans.c.id).where(plans.c.id == plan_id)).one_or_none() is None:
                raise UnknownPlan(plan_id)
            try:
                insertion = insert(executions).values(**row, requested_by=requested_by, created_at=now, state="queued")
                connection.execute(insertion)
            except IntegrityError as error:
                raise CellBusy(cell) from error
            write_event(connection, id, "state", {"state": "queued"}, now)
            return read_execution(connection, id)

    def execution(self, id: str) -> ExecutionRow | None:
        """Returns one execution."""
        with reading(self._engine) as connection:
            row = connection.execute(select(executions).where(executions.c.id == id)).one_or_none()
        return None if row is None else ExecutionRow(**row._mapping)

    def executions(self, limit: int = 50, cursor: str | None = None) -> tuple[list[ExecutionRow], str | None]:
        """Returns executions, newest first, and the cursor of the next page (None: no more)."""
        query = select(executions).order_by(executions.c.id.desc()).limit(limit + 1)
        if cursor is not None:
            query = query.where(executions.c.id < cursor)
        with reading(self._engine) as connection:
            rows = [ExecutionRow(**row._mapping) for row in connection.execute(query)]
        return rows[:limit], rows[limit - 1].id if len(rows) > limit else None

    def open_execution(self, cell: str) -> str | None:
        """Returns the id of the execution of `cell` that is not finished."""
        query = select(executions.c.id).where(executions.c.cell == cell, executions.c.state != "finished")
        with reading(self._engine) as connection:
            return connection.execute(query).scalar_one_or_none()

    def execution_counts(self) -> dict[str, int]:
        """Returns how many executions ended with each outcome; those not finished under their state."""
        label = func.coalesce(executions.c.outcome, executions.c.state)
        with reading(self._engine) as connection:
            return {name: count for name, count in connection.execute(select(label, func.count()).group_by(label))}

    def request_abort(self, id: str) -> ExecutionRow:
        """Asks for a brake. What no executor has claimed yet ends here; asking twice changes nothing.

        Raises:
            UnknownExecution: there is none of this id.
        """
        now = self._now()
        with writing(self._engine) as connection:
            asked = update(executions).where(executions.c.id == id, executions.c.abort_requested_at.is_(None))
            connection.execute(asked.where(executions.c.state != "finished").values(abort_requested_at=now))
            _abort_unclaimed(connection, id, now)
            return read_execution(connection, id)

    def events(self, execution_id: str, after_id: int = 0, limit: int = 1000) -> list[EventRow]:
        """Returns events of an execution after the event `after_id`, oldest first."""
        query = select(events).where(events.c.execution_id == execution_id, events.c.id > after_id)
        with reading(self._engine) as connection:
            return [EventRow(**row._mapping) for row in connection.execute(query.order_by(events.c.id).limit(limit))]

    def recording(self, execution_id: str) -> RecordingRow | None:
        """Returns the recording of an execution."""
        query = select(recordings).where(recordings.c.execution_id == execution_id)
        with reading(self._engine) as connection:
            row = connection.execute(query).one_or_none()
        return None if row is None else RecordingRow(**row._mapping)


def _abort_unclaimed(connection: Connection, id: str, now: float) -> None:
    end = {"state": "finished", "outcome": "aborted", "reason": "no executor had taken it yet", "finished_at": now}
    unclaimed = update(executions).where(executions.c.id == id, executions.c.state == "queued").values(**end)
    if connection.execute(unclaimed).rowcount:
        write_event(connection, id, "state", {k: end[k] for k in ("state", "outcome", "reason")}, now)
