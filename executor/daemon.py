"""The daemon of one cell: claims queued executions, runs them one at a time, and reports to the store."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from executor import realtime
from executor.cell_watch import CellWatch
from executor.execution import STREAM_LOG, Execution
from executor.logs import log
from executor.preflight import ExecutionRefused, PreflightReport, readiness
from executor.records import MIN_FREE_BYTES, ExecutionResult, Journal, row_document
from executor.robot import RobotSession, robot_document
from fling import tracing
from planner.cell import Cell, read_source
from planner.errors import CellError
from store import ExecutionRow, Store, StoreUnavailable, new_id

POLL_S = 0.02  # [s] between two queries for a queued execution
TELEMETRY_S = 0.04  # [s] between two telemetry events: 25 Hz
BEAT_S = 0.25  # [s] the service considers an executor gone after two seconds
STORE_PAUSE_S = 1.0  # [s] without queries after one has failed: each may take five seconds
STREAM_END_S = 30.0  # [s] longest wait for an aborted streaming process
ASKED_TO_END = "the executor was asked to end (SIGTERM or Ctrl-C) and braked first"
BEFORE_MOTION = "the abort came before anything moved"
ENDED_BEFORE_MOTION = "the executor was asked to end (SIGTERM or Ctrl-C) before anything moved"
HARMLESS = ("completed", "refused", "held")  # outcomes that latch no fault; neither does an abort that ended in order

T = TypeVar("T")


class Heartbeat(threading.Thread):
    """Reports to the store several times a second that this executor is alive, with the robot's live state.

    A thread with a dashboard connection of its own: verifying a plan takes seconds.
    """

    def __init__(
        self, session: RobotSession, store: Store, journal: Journal, watch: CellWatch, executor_id: str
    ) -> None:
        super().__init__(name="heartbeat", daemon=True)
        self.session = session
        self.store = store
        self.journal = journal
        self.executor_id = executor_id
        self.watch = watch
        self.idle = True  # the dashboard is queried only while nothing moves
        self._ready = PreflightReport([])
        self._ended = threading.Event()

    def stop(self) -> None:
        """Ends the thread."""
        self._ended.set()
        self.join(5.0)
        self.session.dashboard.close()

    def beat(self) -> None:
        """Reports once, and clears an acknowledged fault; an unavailable database is tried again at the next beat."""
        cell = self.session.cell
        session = self.session
        if self.idle:
            self._ready = readiness(session)
        try:
            if self.store.acknowledge_requested(cell.name):
                self.journal.clear_fault()
                self.store.clear_acknowledge(cell.name)
            ready = self._ready
            findings = robot_document(session.monitor.fresh(), ready.refusals, ready.warnings, ready.serial)
            robot = {**findings, "cell_sha256": cell.sha256}
            fault = self.journal.fault() or self.watch.fault
            read_only = session.settings.read_only
            self.store.record_heartbeat(cell.name, self.executor_id, cell.link.kind, robot, fault, read_only)
        except StoreUnavailable:
            return

    def run(self) -> None:
        """Reports until the end."""
        while not self._ended.wait(BEAT_S):
            self.beat()


class Daemon:
    """The executor of one cell."""

    def __init__(self, session: RobotSession, store: Store, journal: Journal) -> None:
        self.session = session
        self.store = store
        self.journal = journal
        self.cell = session.cell.name
        self.executor_id = new_id()
        self._store_paused_until = 0.0
        self._stream_log = session.settings.data / STREAM_LOG
        self.watch = CellWatch(session.cell, session.settings.cell_path)
        self.heartbeat = self._new_heartbeat()

    def run(self, ended: threading.Event) -> None:
        """Serves until `ended`; a running execution brakes first."""
        self.recover()
        self._note_version()
        self.session.monitor.start()
        self.heartbeat.start()
        try:
            while not ended.is_set():
                self._poll(ended)
                ended.wait(POLL_S)
        finally:
            self.heartbeat.stop()
            self.session.monitor.stop()
            self.session.dashboard.close()

    def recover(self) -> None:
        """Delivers the results of an earlier daemon and closes its executions; latches a fault if one was claimed."""
        self._try_store(lambda: self.journal.deliver(self.store))
        reason = f"the executor was restarted{self._safety_words()}{self._last_words()}"
        left = self._try_store(lambda: self.store.close_open_executions(self.cell, reason=reason)) or []
        rows = [self._try_store(lambda id=id: self.store.execution(id)) for id in left]
        claimed = [row for row in rows if row and row.claimed_at]
        if not claimed:
            return
        self._latch("executor_lost", "the executor was lost during an execution", claimed[0].id)
        with contextlib.suppress(OSError):  # no controller: nothing moves
            self.session.dashboard.ask("stop")

    def _safety_words(self) -> str:
        """Returns the controller's safety state for a reason, where it is not the normal one."""
        try:
            answer = self.session.dashboard.ask("safetystatus")
        except OSError:
            return ""
        return "" if "NORMAL" in answer else f"; the controller reports '{answer}'"

    def _last_words(self) -> str:
        """Returns for a reason how the stream of the lost execution ended by its own account, where it left one."""
        try:
            lines = self._stream_log.read_text(errors="replace").split("\n")[-2:-1]
        except OSError:
            return ""
        return "".join(f"; the stream ended as {line}" for line in lines)

    def _new_heartbeat(self) -> Heartbeat:
        session = self.session
        own = RobotSession.open(session.cell, session.settings, session.monitor)
        return Heartbeat(own, self.store, self.journal, self.watch, self.executor_id)

    def _note_version(self) -> None:
        """Keeps the cell's files as a version, as the executor uses them from now on."""
        try:
            source = read_source(self.session.settings.cell_path)
        except CellError:  # gone: the watch reports it
            return
        if source.sha256 == self.session.cell.sha256:  # not changed again meanwhile
            files = source.sha256, source.text, source.calibration
            self._try_store(lambda: self.store.note_cell_version(self.cell, *files, "executor"))

    def _continue_with(self, cell: Cell) -> None:
        """Continues with another version of the cell file, at another address if it has one; nothing is executed."""
        self.heartbeat.stop()
        if cell.link == self.session.cell.link:
            self.session.cell = cell
        else:
            self.session.monitor.stop()
            self.session.dashboard.close()
            self.session = RobotSession.open(cell, self.session.settings)
            self.session.monitor.start()
        self.heartbeat = self._new_heartbeat()
        self.heartbeat.start()
        self._note_version()

    def _poll(self, ended: threading.Event) -> None:
        changed = self.watch.look()
        if changed is not None:
            self._continue_with(changed)
        if self.journal.has_undelivered():
            self._try_store(lambda: self.journal.deliver(self.store))
        row = self._try_store(lambda: self.store.claim_execution(self.cell, self.executor_id))
        if row is not None:
            self._execute(row, ended)

    def _execute(self, row: ExecutionRow, ended: threading.Event) -> None:
        """Runs one execution within the trace of the request that queued it."""
        first = (self._try_store(lambda: self.store.events(row.id, limit=1)) or [None])[0]
        parent = {} if first is None else first.data.get("trace") or {}
        fields = {f"fling__{name}": value for name, value in _log_fields(row).items()}
        with tracing.traced("execution", "consumer", parent, **fields) as span:
            self._run_execution(row, ended, span)

    def _run_execution(self, row: ExecutionRow, ended: threading.Event, span: tracing.TracedSpan) -> None:
        """Runs one execution; its result is on the disk before the store is informed."""
        execution = Execution(self.session, row, span=span)
        log("claimed", **_log_fields(row))
        self.heartbeat.idle = False
        with contextlib.suppress(OSError):  # what it says is of an earlier execution
            self._stream_log.unlink(missing_ok=True)
        result = ExecutionResult(row.id, "executor_lost", "the executor failed", None)
        try:
            self._admit()
            plan = self.store.plan(row.plan_id)
            if plan is None:
                raise ExecutionRefused(f"there is no plan {row.plan_id}")
            execution.profile = self.store.profile_in_use(self.cell, plan.cell_sha256)
            job = execution.prepare(plan.document)
            if ended.is_set() or self._abort_requested(row):
                reason = ENDED_BEFORE_MOTION if ended.is_set() else BEFORE_MOTION
                result = ExecutionResult(row.id, "aborted", reason, None)
                return
            with realtime.real_time_process():
                execution.start(job)
                self._watch(execution, ended)
            result = execution.finish()
        except (ExecutionRefused, OSError, StoreUnavailable) as error:
            outcome = "refused" if execution.run is None else "executor_lost"
            result = ExecutionResult(row.id, outcome, str(error), None)
        finally:
            if execution.run is not None:
                execution.run.abort()
                execution.run.wait(STREAM_END_S)
            self._close(execution, result)
            self.heartbeat.idle = True

    def _admit(self) -> None:
        """Checks that this executor may move at all.

        Raises:
            ExecutionRefused: a fault is latched, the executor is read-only, the cell file is refused, or the disk is
                full.
        """
        fault = self.journal.fault()
        if fault is not None:
            text = f"a fault is latched ({fault['outcome']}: {fault['reason']}): check the robot, then acknowledge"
            raise ExecutionRefused(text)
        if self.session.settings.read_only:
            raise ExecutionRefused("this executor is read-only")
        if self.watch.fault is not None:
            raise ExecutionRefused(self.watch.fault["reason"])
        if not self.journal.has_room():
            text = f"the disk is full: less than {MIN_FREE_BYTES / 1e6:.0f} MB are left for the recording"
            raise ExecutionRefused(text)

    def _watch(self, execution: Execution, ended: threading.Event) -> None:
        """Publishes states and telemetry, and passes on requests to abort, until the run ends."""
        run = execution.run
        row = execution.row
        assert run is not None
        published = 1  # the claim was published as `preparing`
        while not run.wait(TELEMETRY_S):
            published = self._publish_states(execution, published)
            if ended.is_set():
                run.abort(ASKED_TO_END)
            elif self._abort_requested(row):
                run.abort()
            latest = run.latest_row()
            if latest is not None:
                document = row_document(latest)
                self._try_store(lambda document=document: self.store.add_event(row.id, "telemetry", document))
        self._publish_states(execution, published)

    def _publish_states(self, execution: Execution, published: int) -> int:
        """Publishes the states entered after the first `published`, including ones shorter than the polling period."""
        entered = execution.states()
        for state in entered[published:]:
            execution.note(state)
            execution.span.event(state)
            self._try_store(lambda state=state: self.store.set_state(execution.row.id, state))
        return max(published, len(entered))

    def _abort_requested(self, row: ExecutionRow) -> bool:
        """Whether a client asked for the brake; False where the database cannot be read."""
        return bool(self._try_store(lambda: self.store.abort_requested(row.id)))

    def _close(self, execution: Execution, result: ExecutionResult) -> None:
        """Latches a fault where the end was not in order, then keeps and delivers the result."""
        run = execution.run
        in_order = run is None or (run.result is not None and run.result.in_order)
        if result.outcome not in HARMLESS and not (result.outcome == "aborted" and in_order):
            self._latch(result.outcome, result.reason, result.execution_id)
        self.journal.keep(result)
        execution.span.set(fling__outcome=result.outcome, fling__reason=result.reason or None)
        if result.outcome not in HARMLESS:
            execution.span.fail(result.outcome)
        log("finished", **_log_fields(execution.row), outcome=result.outcome, reason=result.reason)
        self.heartbeat.beat()
        self._try_store(lambda: self.journal.deliver(self.store))

    def _latch(self, outcome: str, reason: str, execution_id: str) -> None:
        self.journal.latch({"outcome": outcome, "reason": reason, "execution_id": execution_id, "at": time.time()})

    def _try_store(self, call: Callable[[], T]) -> T | None:
        """Calls the store; None where the database is unavailable: the robot does not wait for it."""
        if time.monotonic() < self._store_paused_until:
            return None
        try:
            return call()
        except StoreUnavailable:
            self._store_paused_until = time.monotonic() + STORE_PAUSE_S
            return None


def _log_fields(row: ExecutionRow) -> dict[str, str | None]:
    return {"cell": row.cell, "execution": row.id, "plan": row.plan_id, "request_id": row.request_id}
