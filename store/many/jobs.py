"""Jobs of picks and throws and their motions: queued by the service, carried out by one driver at a time.

A driver claims a job, and every write of its own checks that it still has it. A motion and its execution are written in
one transaction: there is no execution that the job does not know, and none is asked for by a driver that was replaced.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from sqlalchemy import Connection, insert, or_, select, update

from store.database import Repository, StoreError, required_row, writing
from store.executions import insert_execution
from store.idempotency_and_audit import take_key, write_audit
from store.rows import DRIVER_FRESH_S, AuditLine, IdempotencyKey, JobCycleRow, JobRow, LandingRow, new_id
from store.tables import job_cycles, jobs, landings

HEAD_COLUMNS = [column for column in jobs.c if column.name != "ordered"]
UNFINISHED = jobs.c.state != "finished"


class JobDriven(StoreError):
    """Another driver has the job, and is alive."""


class JobLost(StoreError):
    """Another driver has taken the job over, or it was finished."""


class JobRepository(Repository):
    """Tables `jobs` and `job_cycles`."""

    def add_job(
        self,
        cell: str,
        ordered: Mapping[str, Any],
        total: int,
        created_by: str = "",
        key: IdempotencyKey | None = None,
        audit: AuditLine | None = None,
    ) -> JobRow:
        """Queues a job.

        Args:
            cell: Name of the cell.
            ordered: What was asked for.
            total: Number of its picks.
            created_by: Who wants it.
            key: Idempotency key of the request.
            audit: Who creates it.

        Raises:
            KeyTaken: `key` is bound to another job; nothing is stored.
        """
        id = new_id()
        now = time.time()
        row = {"id": id, "created_at": now, "created_by": created_by, "request_id": audit and audit.request_id}
        row |= {"cell": cell, "ordered": dict(ordered), "total": total}
        with writing(self._engine) as connection:
            take_key(connection, key, id, now)
            connection.execute(insert(jobs).values(**row, state="queued", revision=1))
            write_audit(connection, audit, f"/jobs/{id}")
            return _read(connection, id)

    def job(self, id: str) -> JobRow | None:
        """Returns one job, with what was ordered."""
        return self._row(JobRow, select(jobs).where(jobs.c.id == id))

    def jobs(self, limit: int = 50, cursor: str | None = None) -> tuple[list[JobRow], str | None]:
        """Returns jobs, newest first, and the cursor of the next page (None after the last)."""
        return self._page(JobRow, select(*HEAD_COLUMNS), jobs, limit, cursor)

    def unfinished_jobs(self) -> list[JobRow]:
        """Returns the jobs that are not finished, oldest first."""
        return self._rows(JobRow, select(*HEAD_COLUMNS).where(UNFINISHED).order_by(jobs.c.id))

    def job_cycles(self, id: str) -> list[JobCycleRow]:
        """Returns the motions of a job, in their order."""
        query = select(job_cycles).where(job_cycles.c.job_id == id)
        return self._rows(JobCycleRow, query.order_by(job_cycles.c.number))

    def landings_of_job(self, id: str) -> list[LandingRow]:
        """Returns the observations of all landings of a job, oldest first; not those that were withdrawn."""
        of_job = select(job_cycles.c.execution_id).where(job_cycles.c.job_id == id)
        query = select(landings).where(landings.c.execution_id.in_(of_job), landings.c.withdrawn_at.is_(None))
        return self._rows(LandingRow, query.order_by(landings.c.id))

    def claim_job(self, id: str, driver_id: str) -> JobRow:
        """Makes a driver the one of an unfinished job; returns it with what was ordered.

        A cell has one driven job at most. All its unfinished jobs are locked before they are looked at, so that of two
        services that claim two jobs of it the second one sees what the first one has.

        Raises:
            UnknownRow: There is no such job.
            JobDriven: Another driver has it, and is alive; or another job of its cell is driven.
            JobLost: It is finished.
        """
        now = time.time()
        free = or_(
            jobs.c.driver_id.is_(None), jobs.c.driver_id == driver_id, jobs.c.heartbeat_at < now - DRIVER_FRESH_S
        )
        with writing(self._engine) as connection:
            of_cell = select(*HEAD_COLUMNS).where(jobs.c.cell == _read(connection, id).cell, UNFINISHED)
            connection.execute(of_cell.order_by(jobs.c.id).with_for_update()).all()
            row = _read(connection, id, lock=True)
            others = (JobRow(**each._mapping) for each in connection.execute(of_cell.where(jobs.c.id != id)).all())
            if (driven := next((each for each in others if each.is_driven), None)) is not None:
                raise JobDriven(f"job {driven.id} of cell {row.cell!r} is driven by {driven.driver_id}")
            claim = update(jobs).where(jobs.c.id == id, UNFINISHED, free)
            values = {"driver_id": driver_id, "heartbeat_at": now, "started_at": row.started_at or now}
            if connection.execute(claim.values(**values)).rowcount:
                return JobRow(**connection.execute(select(jobs).where(jobs.c.id == id)).one()._mapping)
        if row.state == "finished":
            raise JobLost(f"job {id} is finished: {row.outcome}")
        raise JobDriven(f"job {id} is driven by {row.driver_id}")

    def beat_job(self, id: str, driver_id: str, state: str) -> JobRow:
        """Records a heartbeat of a job's driver, and the state; returns the job.

        Raises:
            JobLost: It is not this driver's any more.
        """
        with writing(self._engine) as connection:
            row = _require_driver(connection, id, driver_id)
            values: dict[str, Any] = {"heartbeat_at": time.time()}
            if row.state != state:
                values |= {"state": state, "revision": row.revision + 1}
            connection.execute(update(jobs).where(jobs.c.id == id).values(**values))
            return _read(connection, id)

    def ask_job_cycle(
        self, driver_id: str, cycle: JobCycleRow, cell: str, requested_by: str, audit: AuditLine | None = None
    ) -> JobCycleRow | None:
        """Stores a motion and queues its execution, both or neither; returns the motion.

        None: the job was asked to pause or to end meanwhile, and nothing is stored.

        Args:
            driver_id: Who drives the job.
            cycle: The motion, without its execution.
            cell: Name of the cell.
            requested_by: Who wants the job.
            audit: Who executes.

        Raises:
            CellBusy: The cell has an unfinished execution.
            JobLost: The job is not this driver's any more.
            KeyTaken: The motion has an execution already.
        """
        key = IdempotencyKey(f"job {cycle.job_id}", str(cycle.number), "")
        row = {"plan_id": cycle.plan_id, "cell": cell, "mode": "speedj", "dry_run": False}
        with writing(self._engine) as connection:
            job = _require_driver(connection, cycle.job_id, driver_id)
            if job.cancel_requested_at is not None or job.pause_requested_at is not None:
                return None
            execution = insert_execution(connection, {**row, "requested_by": requested_by}, key, audit)
            asked = replace(cycle, execution_id=execution.id, asked_at=execution.created_at)
            connection.execute(insert(job_cycles).values(**vars(asked)))
            _note_change(connection, job)
        return asked

    def add_job_cycle(self, driver_id: str, cycle: JobCycleRow) -> None:
        """Stores a motion that has ended before it had an execution.

        Raises:
            JobLost: The job is not this driver's any more.
        """
        with writing(self._engine) as connection:
            job = _require_driver(connection, cycle.job_id, driver_id)
            connection.execute(insert(job_cycles).values(**vars(cycle)))
            _note_change(connection, job)

    def end_job_cycle(self, driver_id: str, cycle: JobCycleRow) -> None:
        """Stores how the execution of a motion ended.

        Raises:
            JobLost: The job is not this driver's any more.
        """
        names = ("result", "outcome", "object_at", "reason", "ended_at")
        of_cycle = (job_cycles.c.job_id == cycle.job_id) & (job_cycles.c.number == cycle.number)
        with writing(self._engine) as connection:
            job = _require_driver(connection, cycle.job_id, driver_id)
            values = {name: getattr(cycle, name) for name in names}
            connection.execute(update(job_cycles).where(of_cycle).values(**values))
            _note_change(connection, job)

    def finish_job(self, id: str, driver_id: str, outcome: str, reason: str | None = None) -> None:
        """Finishes a job.

        Raises:
            JobLost: It is not this driver's any more.
        """
        with writing(self._engine) as connection:
            _finish(connection, _require_driver(connection, id, driver_id), outcome, reason)

    def release_job(self, id: str, driver_id: str) -> None:
        """Gives a job up, which another driver takes at once: this one ends.

        Raises:
            JobLost: It is not this driver's any more.
        """
        with writing(self._engine) as connection:
            _require_driver(connection, id, driver_id)
            connection.execute(update(jobs).where(jobs.c.id == id).values(driver_id=None, heartbeat_at=None))

    def pause_job(self, id: str, audit: AuditLine | None = None) -> JobRow:
        """Asks a job's driver to pause after the motion that runs; of a finished job nothing changes.

        Raises:
            UnknownRow: There is no such job.
        """
        with writing(self._engine) as connection:
            row = _read(connection, id, lock=True)
            if row.state != "finished" and row.pause_requested_at is None:
                _note_change(connection, row, pause_requested_at=time.time())
            write_audit(connection, audit, f"/jobs/{id}")
            return _read(connection, id)

    def resume_job(self, id: str, audit: AuditLine | None = None) -> JobRow:
        """Lets a job that is paused, or has stopped, go on; of any other nothing changes.

        Raises:
            UnknownRow: There is no such job.
        """
        with writing(self._engine) as connection:
            row = _read(connection, id, lock=True)
            if row.outcome == "stopped":
                again = {"state": "queued", "outcome": None, "reason": None, "finished_at": None}
                again |= {"driver_id": None, "heartbeat_at": None}
                _note_change(connection, row, **again, pause_requested_at=None, resumed_at=time.time())
            elif row.state != "finished" and row.pause_requested_at is not None:
                _note_change(connection, row, pause_requested_at=None)
            write_audit(connection, audit, f"/jobs/{id}")
            return _read(connection, id)

    def cancel_job(self, id: str, audit: AuditLine | None = None) -> JobRow:
        """Asks a job's driver to end it after the motion that runs; one that never had a driver ends at once.

        Raises:
            UnknownRow: There is no such job.
        """
        with writing(self._engine) as connection:
            row = _read(connection, id, lock=True)
            if row.state != "finished" and row.cancel_requested_at is None:
                _note_change(connection, row, cancel_requested_at=time.time())
            if row.state == "queued" and row.started_at is None:
                _finish(connection, _read(connection, id), "cancelled", None)
            write_audit(connection, audit, f"/jobs/{id}")
            return _read(connection, id)


def _read(connection: Connection, id: str, lock: bool = False) -> JobRow:
    query = select(*HEAD_COLUMNS).where(jobs.c.id == id)
    return required_row(connection, JobRow, query, f"job {id!r}", lock)


def _require_driver(connection: Connection, id: str, driver_id: str) -> JobRow:
    """Returns a job, locked until the transaction ends, if it is this driver's."""
    row = _read(connection, id, lock=True)
    if row.driver_id != driver_id or row.state == "finished":
        raise JobLost(f"job {id} is {row.state} now, its driver {row.driver_id}")
    return row


def _note_change(connection: Connection, row: JobRow, **values: Any) -> None:
    """Changes a job, and counts that."""
    changed = update(jobs).where(jobs.c.id == row.id)
    connection.execute(changed.values(**values, revision=row.revision + 1))


def _finish(connection: Connection, row: JobRow, outcome: str, reason: str | None) -> None:
    ended = {"state": "finished", "outcome": outcome, "reason": reason, "finished_at": time.time()}
    _note_change(connection, row, **ended)
