"""The daemon: one cell, one execution at a time. Polls the store, judges, starts, watches, records."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from executor.execution import Execution
from executor.heartbeat import Heartbeat
from executor.journal import ROOM_BYTES, Journal, Result
from executor.liveview import row_document
from executor.preflight import Refused
from executor.punctuality import punctual
from executor.station import Station
from store import ExecutionRow, Store, StoreUnavailable, new_id

POLL_S = 0.02  # [s] between two looks for a queued execution
TELEMETRY_S = 0.04  # [s] between two telemetry events: 25 Hz
STORE_GONE_S = 1.0  # [s] a database that did not answer is left alone: asking it may take five seconds each time
HARMLESS = ("completed", "refused")  # ends that need no person to look, nor does an abort that ended in order

STATES = ("preparing", "approaching", "streaming", "braking")  # as the contract has them, in order

T = TypeVar("T")


class Daemon:
    """The executor of one cell."""

    def __init__(self, station: Station, store: Store, journal: Journal) -> None:
        self.station, self.store, self.journal = station, store, journal
        self.cell = station.cell.name
        self.executor_id = new_id()
        self._store_gone_until = 0.0
        eyes = Station.of(station.cell, station.settings, station.monitor)
        self.heartbeat = Heartbeat(eyes, store, journal, self.executor_id)

    def run(self, ended: threading.Event) -> None:
        """Serves until `ended`; an execution that is under way then brakes first."""
        self.recover()
        self.station.monitor.start()
        self.heartbeat.start()
        try:
            while not ended.is_set():
                self._turn(ended)
                ended.wait(POLL_S)
        finally:
            self.heartbeat.stop()
            self.station.monitor.stop()
            self.station.close()

    def recover(self) -> None:
        """Delivers what an earlier daemon left, closes what it left open, and latches if it was moving."""
        self._tell(lambda: self.journal.deliver(self.store))
        reason = "the executor was restarted"
        left = self._tell(lambda: self.store.close_open_executions(self.cell, reason=reason)) or []
        rows = [row for id in left if (row := self._tell(lambda id=id: self.store.execution(id))) and row.claimed_at]
        if not rows:
            return
        self.journal.latch({"outcome": "executor_lost", "reason": "the executor was lost during an execution",
                            "execution_id": rows[0].id, "at": time.time()})  # fmt: skip
        with contextlib.suppress(OSError):  # no controller: nothing moves
            self.station.dashboard.ask("stop")

    def _turn(self, ended: threading.Event) -> None:
        if self.journal.waiting():
            self._tell(lambda: self.journal.deliver(self.store))
        row = self._tell(lambda: self.store.claim_execution(self.cell, self.executor_id))
        if row is not None:
            self._execute(row, ended)

    def _execute(self, row: ExecutionRow, ended: threading.Event) -> None:
        """Carries one execution through; its result is on the disk before the store hears of it."""
        execution = Execution(self.station, row)
        self.heartbeat.idle = False
        result = Result(row.id, "executor_lost", "the executor failed", None)
        try:
            self._admit()
            plan = self.store.plan(row.plan_id)
            if plan is None:
                raise Refused(f"there is no plan {row.plan_id}")
            job = execution.prepare(plan.document)
            with punctual():
                execution.start(job)
                self._watch(execution, ended)
            result = execution.finish()
        except (Refused, OSError, StoreUnavailable) as error:
            result = Result(row.id, "refused" if execution.run is None else "executor_lost", str(error), None)
        finally:
            if execution.run is not None:
                execution.run.abort()
                execution.run.wait(30.0)
            self._close(execution, result)
            self.heartbeat.idle = True

    def _admit(self) -> None:
        fault = self.journal.fault()
        if fault is not None:
            raise Refused(f"a fault is latched ({fault['outcome']}: {fault['reason']}): look, then acknowledge")
        if self.station.settings.read_only:
            raise Refused("this executor is read-only")
        if not self.journal.has_room():
            raise Refused(f"the disk is full: less than {ROOM_BYTES / 1e6:.0f} MB are left for the recording")

    def _watch(self, execution: Execution, ended: threading.Event) -> None:
        run, row = execution.run, execution.row
        assert run is not None
        told = 0
        while not run.wait(TELEMETRY_S):
            told = self._tell_states(execution, told)
            if ended.is_set() or self._tell(lambda: self.store.abort_requested(row.id)):
                run.abort()
            latest = run.latest_row()
            if latest is not None:
                self._tell(lambda latest=latest: self.store.add_event(row.id, "telemetry", row_document(latest)))
        self._tell_states(execution, told)

    def _tell_states(self, execution: Execution, told: int) -> int:
        """Tells every state reached since `told`; one that is shorter than our period is told all the same."""
        reached = STATES.index(execution.state())
        for state in STATES[told + 1 : reached + 1]:
            execution.note(state)
            self._tell(lambda state=state: self.store.set_state(execution.row.id, state))
        return max(told, reached)

    def _close(self, execution: Execution, result: Result) -> None:
        run = execution.run
        orderly = run is None or (run.result is not None and run.result.in_order)
        if result.outcome not in HARMLESS and not (result.outcome == "aborted" and orderly):
            self.journal.latch({"outcome": result.outcome, "reason": result.reason,
                                "execution_id": result.execution_id, "at": time.time()})  # fmt: skip
        self.journal.keep(result)
        self.heartbeat.beat()
        self._tell(lambda: self.journal.deliver(self.store))

    def _tell(self, call: Callable[[], T]) -> T | None:
        """Calls the store; None where the database is gone: the robot does not wait for it, nor ask again at once."""
        if time.monotonic() < self._store_gone_until:
            return None
        try:
            return call()
        except StoreUnavailable:
            self._store_gone_until = time.monotonic() + STORE_GONE_S
            return None
