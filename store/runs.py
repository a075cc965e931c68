"""Executions as the executor sees them: claim, go through the states, finish, record."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy import Connection, delete, insert, select, update

from store.area import Area
from store.engine import reading, writing
from store.errors import UnknownExecution
from store.rows import ExecutionRow
from store.tables import events, executions, recordings


def read_execution(connection: Connection, id: str) -> ExecutionRow:
    """Returns one execution, in the caller's transaction.

    Raises:
        UnknownExecution: there is none of this id.
    """
    row = connection.execute(select(executions).where(executions.c.id == id)).one_or_none()
    if row is None:
        raise UnknownExecution(id)
    return ExecutionRow(**row._mapping)


def write_event(connection: Connection, execution_id: str, kind: str, data: Mapping[str, Any], at: float) -> None:
    """Writes one event, in the caller's transaction."""
    row = {"execution_id": execution_id, "at": at, "kind": kind, "data": dict(data)}
    connection.execute(insert(events).values(**row))


class Runs(Area):
    """Statements about executions, for the executor."""

    def claim_execution(self, cell: str, executor_id: str) -> ExecutionRow | None:
        """Takes the queued execution of `cell`, if there is one: it is then `preparing` and this executor's own.

        Compare and set: of two executors one gets it.
        """
        with reading(self._engine) as connection:  # the poll takes no lock
            queued = select(executions.c.id).where(executions.c.cell == cell, executions.c.state == "queued")
            id = connection.execute(queued.limit(1)).scalar_one_or_none()
        if id is None:
            return None
        now = self._now()
        with writing(self._engine) as connection:
            mine = update(executions).where(executions.c.id == id, executions.c.state == "queued")
            mine = mine.values(state="preparing", executor_id=executor_id, claimed_at=now)
            if not connection.execute(mine).rowcount:
                return None
            write_event(connection, id, "state", {"state": "preparing"}, now)
            return read_execution(connection, id)

    def set_state(self, id: str, state: str, data: Mapping[str, Any] | None = None) -> bool:
        """Sets the state and writes its event. Returns False, and does nothing, where it is finished or already so."""
        with writing(self._engine) as connection:
            open_ones = update(executions).where(executions.c.id == id, executions.c.state.not_in(("finished", state)))
            if not connection.execute(open_ones.values(state=state)).rowcount:
                return False
            write_event(connection, id, "state", {"state": state, **(data or {})}, self._now())
            return True

    def add_event(self, id: str, kind: str, data: Mapping[str, Any]) -> None:
        """Writes one event of an execution."""
        with writing(self._engine) as connection:
            write_event(connection, id, kind, data, self._now())

    def abort_requested(self, id: str) -> bool:
        """Whether somebody asked for a brake."""
        query = select(executions.c.abort_requested_at).where(executions.c.id == id)
        with reading(self._engine) as connection:
            return connection.execute(query).scalar_one_or_none() is not None

    def finish_execution(
        self, id: str, outcome: str, reason: str | None = None, metrics: Mapping[str, Any] | None = None
    ) -> bool:
        """Ends an execution and writes its event. Returns False, and does nothing, where it had ended already."""
        with writing(self._engine) as connection:
            return _finish(connection, id, outcome, reason, metrics, self._now())

    def add_recording(self, execution_id: str, mcap: bytes, csv: bytes) -> None:
        """Stores the recording of an execution; a second one takes the place of the first."""
        with writing(self._engine) as connection:
            connection.execute(delete(recordings).where(recordings.c.execution_id == execution_id))
            connection.execute(insert(recordings).values(execution_id=execution_id, mcap=mcap, csv=csv))

    def close_open_executions(
        self, cell: str, outcome: str = "executor_lost", reason: str = "the executor was lost"
    ) -> list[str]:
        """Ends every execution of `cell` that is not finished, queued ones too: nothing old starts by surprise.

        Returns their ids.
        """
        query = select(executions.c.id).where(executions.c.cell == cell, executions.c.state != "finished")
        with writing(self._engine) as connection:
            ids = list(connection.execute(query).scalars())
            for id in ids:
                _finish(connection, id, outcome, reason, None, self._now())
        return ids


def _finish(
    connection: Connection, id: str, outcome: str, reason: str | None, metrics: Mapping[str, Any] | None, now: float
) -> bool:
    end = {"state": "finished", "outcome": outcome, "reason": reason, "finished_at": now}
    metrics = None if metrics is None else dict(metrics)
    unfinished = update(executions).where(executions.c.id == id, executions.c.state != "finished")
    if not connection.execute(unfinished.values(**end, metrics=metrics)).rowcount:
        return False
    data = {"state": "finished", "outcome": outcome, "reason": reason, "metrics": metrics}
    write_event(connection, id, "state", data, now)
    return True
