"""Executions with their events and recordings: queued by the service, run by the executor."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from sqlalchemy import ColumnElement, Connection, delete, false, func, insert, select, update
from sqlalchemy.exc import IntegrityError

from store.database import Repository, StoreError, UnknownRow, required_row, writing
from store.idempotency_and_audit import take_key, write_audit
from store.rows import AuditLine, EventRow, ExecutionRow, IdempotencyKey, RecordingRow, new_id
from store.tables import cells, events, executions, experiments, plans, recordings

LOST = "executor_lost"
TICK_PASSED = "tick passed"  # how the reason of a refused replacement begins that came too late
UNFINISHED = executions.c.state != "finished"


class CellBusy(StoreError):
    """The cell has an unfinished execution; each cell runs one at a time."""

    def __init__(self, cell: str) -> None:
        super().__init__(f"cell {cell!r} already has an execution that is not finished")
        self.cell = cell


class ExecutionRepository(Repository):
    """Tables `executions`, `events` and `recordings`.

    Queueing and abort requests come from the service; claiming, states, results and recordings from the executor.
    """

    def queue_execution(
        self,
        plan_id: str,
        cell: str,
        mode: str = "speedj",
        dry_run: bool = False,
        requested_by: str = "",
        key: IdempotencyKey | None = None,
        experiment_id: str | None = None,
        audit: AuditLine | None = None,
        trace: Mapping[str, str] | None = None,
    ) -> ExecutionRow:
        """Queues one execution of a plan, as part of an experiment if one is named; the same transaction audits it.

        `trace` is the trace context of the request, for the executor: it stands in the first event.

        Raises:
            CellBusy: The cell has an unfinished execution.
            KeyTaken: `key` is bound to another execution.
            UnknownRow: There is no such plan, or experiment.
        """
        row = {"plan_id": plan_id, "cell": cell, "mode": mode, "dry_run": dry_run}
        row |= {"experiment_id": experiment_id, "requested_by": requested_by}
        with writing(self._engine) as connection:
            return insert_execution(connection, row, key, audit, trace)

    def execution(self, id: str) -> ExecutionRow | None:
        """Returns one execution."""
        return self._row(ExecutionRow, select(executions).where(executions.c.id == id))

    def executions(
        self, limit: int = 50, cursor: str | None = None, cell: str | None = None, outcome: str | None = None
    ) -> tuple[list[ExecutionRow], str | None]:
        """Returns executions, newest first, and the cursor of the next page (None after the last).

        Args:
            limit: Length of the page.
            cursor: Of the page.
            cell: Whose executions; None: of all cells.
            outcome: How they ended; None: in any way, or not yet.
        """
        query = select(executions)
        if cell is not None:
            query = query.where(executions.c.cell == cell)
        if outcome is not None:
            query = query.where(executions.c.outcome == outcome)
        return self._page(ExecutionRow, query, executions, limit, cursor)

    def executions_of_cell(self, cell: str, limit: int = 200) -> list[ExecutionRow]:
        """Returns the finished executions of a cell, newest first."""
        query = select(executions).where(executions.c.cell == cell, executions.c.state == "finished")
        return self._rows(ExecutionRow, query.order_by(executions.c.id.desc()).limit(limit))

    def open_execution(self, cell: str) -> str | None:
        """Returns the id of the cell's unfinished execution, or None."""
        return self._value(select(executions.c.id).where(executions.c.cell == cell, UNFINISHED))

    def open_executions(self) -> list[ExecutionRow]:
        """Returns the unfinished executions of all cells."""
        return self._rows(ExecutionRow, select(executions).where(UNFINISHED))

    def latest_execution_id(self) -> str:
        """Returns the id of the newest execution; empty without one."""
        return self._value(select(func.max(executions.c.id))) or ""

    def executions_after(self, id: str, limit: int = 1000) -> list[ExecutionRow]:
        """Returns the executions that were queued after another, oldest first."""
        return self._rows(
            ExecutionRow, select(executions).where(executions.c.id > id).order_by(executions.c.id).limit(limit)
        )

    def request_abort(self, id: str, audit: AuditLine | None = None) -> ExecutionRow:
        """Requests a brake. A queued execution ends at once; a repeated request changes nothing.

        Raises:
            UnknownRow: There is no such execution.
        """
        now = time.time()
        with writing(self._engine) as connection:
            requested = update(executions).where(executions.c.id == id, executions.c.abort_requested_at.is_(None))
            connection.execute(requested.where(UNFINISHED).values(abort_requested_at=now))
            _abort_unclaimed(connection, id, now)
            row = _read_execution(connection, id)
            write_audit(connection, audit, f"/executions/{id}")
            return row

    def abort_requested(self, id: str) -> bool:
        """Returns whether an abort was requested."""
        return self._value(select(executions.c.abort_requested_at).where(executions.c.id == id)) is not None

    def request_replacement(self, id: str, plan_id: str, who: str, audit: AuditLine | None = None) -> str | None:
        """Asks the executor of a running execution to go on with another plan.

        Returns:
            The id of the request; None where an earlier one is still open, or the execution has ended.

        Raises:
            UnknownRow: There is no such execution.
        """
        request = {"id": new_id(), "plan_id": plan_id, "requested_by": who, "requested_at": time.time()}
        with writing(self._engine) as connection:
            row = _read_execution(connection, id)
            if row.state == "finished" or row.open_replacement is not None:
                return None
            connection.execute(update(executions).where(executions.c.id == id).values(replace_request=request))
            write_audit(connection, audit, f"/executions/{id}")
        return request["id"]

    def answer_replacement(self, id: str, request: Mapping[str, Any], joins_s: float | None, reason: str) -> None:
        """Records what became of a request for a replacement, once.

        Args:
            id: Of the execution.
            request: As in its row.
            joins_s: When the plan begins, on the execution's clock [s]; None: the running plan goes on.
            reason: Of a refusal.
        """
        answer = {"id": request["id"], "plan_id": request["plan_id"], "joins_s": joins_s, "reason": reason}
        with writing(self._engine) as connection:
            before = _read_execution(connection, id).replacements or []
            if request["id"] in [each["id"] for each in before]:
                return
            answers = [*before, answer]
            connection.execute(update(executions).where(executions.c.id == id).values(replacements=answers))

    def claim_execution(self, cell: str, executor_id: str) -> ExecutionRow | None:
        """Claims the cell's queued execution, if any, and sets it to `preparing`; only the cell's executor can.

        Compare and set: if two executors try at once, one of them gets it. An executor runs nothing while it claims, so
        one that it has claimed before is its own again: the answer to that claim was lost.
        """
        holder = select(cells.c.executor_id).where(cells.c.cell == cell).scalar_subquery()
        queued = executions.c.state == "queued"
        own = (executions.c.state == "preparing") & (executions.c.executor_id == executor_id)
        claimable = select(executions.c.id).where(executions.c.cell == cell, queued | own)
        id = self._value(claimable.limit(1))  # polling takes no lock
        if id is None:
            return None
        now = time.time()
        with writing(self._engine) as connection:
            claim = update(executions).where(executions.c.id == id, queued, holder == executor_id)
            claim = claim.values(state="preparing", executor_id=executor_id, claimed_at=now)
            if connection.execute(claim).rowcount:
                _write_event(connection, id, "state", {"state": "preparing"}, now)
            claimed = select(executions.c.id).where(executions.c.id == id, own, holder == executor_id)
            return _read_execution(connection, id) if connection.execute(claimed).first() else None

    def set_state(self, id: str, state: str, data: Mapping[str, Any] | None = None) -> bool:
        """Sets the state and writes its event. Returns False if the execution is finished or already in that state."""
        with writing(self._engine) as connection:
            change = update(executions).where(executions.c.id == id, executions.c.state.not_in(("finished", state)))
            if not connection.execute(change.values(state=state)).rowcount:
                return False
            _write_event(connection, id, "state", {"state": state, **(data or {})}, time.time())
            return True

    def finish_execution(
        self,
        id: str,
        outcome: str,
        reason: str | None = None,
        metrics: Mapping[str, Any] | None = None,
        is_known: bool = False,
    ) -> bool:
        """Finishes an execution and writes its event. Returns False if it was finished already.

        With `is_known` the executor that ran it says so, which replaces the `executor_lost` that another one assumed.
        """
        assumed = (executions.c.outcome == LOST) if is_known and outcome != LOST else false()
        with writing(self._engine) as connection:
            return _finish(connection, id, outcome, reason, metrics, UNFINISHED | assumed)

    def close_open_executions(self, cell: str, reason: str = "the executor was lost") -> list[str]:
        """Finishes every open execution of a cell as `executor_lost`, queued ones too, so that no old one starts later.

        Returns:
            The ids of the executions it finished.
        """
        query = select(executions.c.id).where(executions.c.cell == cell, UNFINISHED)
        with writing(self._engine) as connection:
            ids = list(connection.execute(query).scalars())
            for id in ids:
                _finish(connection, id, LOST, reason, None, UNFINISHED)
        return ids

    def add_event(self, id: str, kind: str, data: Mapping[str, Any]) -> None:
        """Appends an event to an execution."""
        with writing(self._engine) as connection:
            _write_event(connection, id, kind, data, time.time())

    def events(self, execution_id: str, after_id: int = 0, limit: int = 1000) -> list[EventRow]:
        """Returns the events of an execution that follow event `after_id`, oldest first."""
        query = select(events).where(events.c.execution_id == execution_id, events.c.id > after_id)
        return self._rows(EventRow, query.order_by(events.c.id).limit(limit))

    def states_of(self, execution_id: str) -> list[str]:
        """Returns the states of an execution, in their order."""
        query = select(events).where(events.c.execution_id == execution_id, events.c.kind == "state")
        return [row.data["state"] for row in self._rows(EventRow, query.order_by(events.c.id))]

    def newest_event(self, execution_id: str, kind: str) -> EventRow | None:
        """Returns the newest event of a kind of an execution; None without one."""
        query = select(events).where(events.c.execution_id == execution_id, events.c.kind == kind)
        return self._row(EventRow, query.order_by(events.c.id.desc()).limit(1))

    def add_recording(self, execution_id: str, mcap: bytes, samples: bytes) -> None:
        """Stores the recording of an execution, with samples from `pack_samples`, and replaces an earlier one."""
        with writing(self._engine) as connection:
            connection.execute(delete(recordings).where(recordings.c.execution_id == execution_id))
            row = {"execution_id": execution_id, "mcap": mcap, "samples": samples, "csv": b""}
            connection.execute(insert(recordings).values(**row))

    def recording(self, execution_id: str) -> RecordingRow | None:
        """Returns the recording of an execution."""
        columns: list[Any] = [recordings.c.execution_id, recordings.c.mcap, recordings.c.samples]
        query: Any = select(*columns, recordings.c.csv.label("earlier_csv"))
        return self._row(RecordingRow, query.where(recordings.c.execution_id == execution_id))


def insert_execution(
    connection: Connection,
    row: Mapping[str, Any],
    key: IdempotencyKey | None,
    audit: AuditLine | None,
    trace: Mapping[str, str] | None = None,
) -> ExecutionRow:
    """Queues one execution within the caller's transaction; see `ExecutionRepository.queue_execution`."""
    id = new_id()
    now = time.time()
    take_key(connection, key, id, now)
    if connection.execute(select(plans.c.id).where(plans.c.id == row["plan_id"])).one_or_none() is None:
        raise UnknownRow(f"no plan {row['plan_id']!r}")
    _require_experiment(connection, row.get("experiment_id"))
    values = {**row, "id": id, "request_id": audit and audit.request_id, "created_at": now, "state": "queued"}
    try:
        connection.execute(insert(executions).values(**values))
    except IntegrityError as error:
        raise CellBusy(row["cell"]) from error
    _write_event(connection, id, "state", {"state": "queued", **({"trace": dict(trace)} if trace else {})}, now)
    write_audit(connection, audit, f"/executions/{id}")
    return _read_execution(connection, id)


def _require_experiment(connection: Connection, id: str | None) -> None:
    if id is not None and connection.execute(select(experiments.c.id).where(experiments.c.id == id)).first() is None:
        raise UnknownRow(f"no experiment {id!r}")


def _read_execution(connection: Connection, id: str) -> ExecutionRow:
    return required_row(connection, ExecutionRow, select(executions).where(executions.c.id == id), f"execution {id!r}")


def _write_event(connection: Connection, execution_id: str, kind: str, data: Mapping[str, Any], at: float) -> None:
    row = {"execution_id": execution_id, "at": at, "kind": kind, "data": dict(data)}
    connection.execute(insert(events).values(**row))


def _abort_unclaimed(connection: Connection, id: str, now: float) -> None:
    result = {"state": "finished", "outcome": "aborted", "reason": "no executor had claimed it yet"}
    unclaimed = update(executions).where(executions.c.id == id, executions.c.state == "queued")
    if connection.execute(unclaimed.values(**result, finished_at=now)).rowcount:
        _write_event(connection, id, "state", result, now)


def _finish(
    connection: Connection,
    id: str,
    outcome: str,
    reason: str | None,
    metrics: Mapping[str, Any] | None,
    where: ColumnElement[bool],
) -> bool:
    now = time.time()
    metrics = None if metrics is None else dict(metrics)
    result = {"state": "finished", "outcome": outcome, "reason": reason, "metrics": metrics}
    changed = update(executions).where(executions.c.id == id, where)
    if not connection.execute(changed.values(**result, finished_at=now)).rowcount:
        return False
    _write_event(connection, id, "state", result, now)
    return True
