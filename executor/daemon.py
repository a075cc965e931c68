"""The daemon of one cell: claims queued executions, runs them one at a time, and reports to the store."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from executor import realtime
from executor.cell_watch import CellWatch
from executor.execution import Execution
from executor.heartbeat import Heartbeat
from executor.logs import log
from executor.ownership import CellTaken, take_cell, take_controller
from executor.preflight import ExecutionRefused, verify_content
from executor.publisher import Publisher
from executor.records import MIN_FREE_BYTES, ExecutionResult, Journal
from executor.replacement import Certifier
from executor.replacer import Replacer
from executor.robot import ActionRefused, DashboardClient, RobotSession, stop_program
from executor.stop_listener import StopListener
from executor.stream_process import SpareStream, end_orphan
from executor.streaming.state_checks import safety_words
from executor.worker import Worker
from fling import tracing
from planner.cell import Cell, read_source
from planner.errors import CellError
from store import ExecutionRow, RobotAction, Store, StoreUnavailable, new_id

POLL_S = 0.02  # [s] between two queries for a queued execution
OPERATE_S = 0.1  # [s] between two looks whether somebody asks to operate the robot
WATCH_S = 0.04  # [s] between two looks at a run for SIGTERM; the stop listener does not wait for them
STORE_PAUSE_S = 1.0  # [s] without queries after one has failed: each may take five seconds
STREAM_END_S = 30.0  # [s] longest wait for an aborted streaming process
ASKED_TO_END = "the executor was asked to end (SIGTERM or Ctrl-C) and braked first"
BEFORE_MOTION = "the abort came before anything moved"
ENDED_BEFORE_MOTION = "the executor was asked to end (SIGTERM or Ctrl-C) before anything moved"
HARMLESS = ("completed", "refused", "held")  # outcomes that latch no fault; neither does an abort that ended in order

T = TypeVar("T")


class Daemon:
    """The executor of one cell."""

    def __init__(self, session: RobotSession, store: Store, journal: Journal) -> None:
        self.session = session
        self.store = store
        self.journal = journal
        self.cell = session.cell.name
        self.executor_id = new_id()
        self._store_paused_until = 0.0
        self.spare = SpareStream(session.settings.data)
        self._is_recovered = False
        self._has_ended_program = False
        self._operate_at = 0.0
        self._answered: tuple[str, bool, str] = ("", False, "")  # the newest request to operate the robot
        self.watch = CellWatch(session.cell, session.settings.cell_path)
        self.stops = StopListener(journal.folder)
        self.certifier = Certifier()
        self.heartbeat = self._new_heartbeat()

    def take(self) -> None:
        """Takes the cell, at its controller and in the store, and touches nothing where another executor has it.

        Raises:
            CellTaken: another executor has it.
            StoreUnavailable: the database is gone.
        """
        self.session.monitor.start()
        try:
            take_controller(self.session.monitor)
            take_cell(self.store, self.session.cell, self.executor_id, self.journal.earlier_executor())
        except (CellTaken, StoreUnavailable):
            self.session.monitor.stop()
            raise
        self.journal.note_executor(self.executor_id)

    def run(self, ended: threading.Event) -> bool:
        """Serves the cell that was taken until `ended`; a running execution brakes first.

        Returns:
            False where another executor took the cell over meanwhile.
        """
        self.recover()
        self._note_version()
        self._operate("the executor was started meanwhile")
        if not self.session.settings.read_only:
            self.spare.prepare()
        self.heartbeat.start()
        self.stops.start()
        self.certifier.start()
        try:
            while not (ended.is_set() or self.heartbeat.is_replaced):
                self._poll(ended)
                ended.wait(POLL_S)
        finally:
            for worker in self._workers():
                worker.stop()
            self.certifier.stop()
            self.spare.close()
            self.session.console.close()
            self._try_store(lambda: self.store.leave_cell(self.cell, self.executor_id))
        return not self.heartbeat.is_replaced

    def _workers(self) -> tuple[Worker, ...]:
        """Returns the threads that work as long as the daemon does."""
        return self.session.monitor, self.heartbeat, self.stops

    def recover(self) -> None:
        """Delivers the results of an earlier daemon and closes its executions; latches a fault if one was claimed.

        Results come first: what the database could not take yet is no lost execution. Executions are closed last: after
        a kill before that the next daemon finds them open. What the database cannot take now is done before the next
        claim.
        """
        self.spare.close()  # it would look like an orphan
        for file in self.spare.logs:
            orphan = end_orphan(file)
            if orphan is not None:
                log("a streaming process of an earlier executor was killed", process=orphan)
        self._deliver_kept()
        if self.journal.has_undelivered():
            return
        left = self._try_store(self.store.open_executions)
        if left is None:
            return
        reason = self._restart_words()
        claimed = [row for row in left if row.cell == self.cell and row.claimed_at]
        if claimed and not self._has_ended_program:  # once: later a person may run a program
            self._has_ended_program = True
            self._latch("executor_lost", "the executor was lost during an execution", claimed[0].id)
            self._stop_controller()
            self.heartbeat.report()
        closed = self._try_store(lambda: self.store.close_open_executions(self.cell, reason))
        self._is_recovered = closed is not None

    def _restart_words(self) -> str:
        """Returns why an execution was lost, with the controller's safety state where that is not the normal one."""
        reason = f"the executor was restarted{self._last_words()}"
        state = self.session.monitor.fresh()
        words = "" if state is None else safety_words(state.safety_bits)
        return reason if not words or words in reason else f"{reason}; the controller reports: {words}"

    def _stop_controller(self) -> None:
        """Ends whatever program plays on the controller, by every way there is; without a controller nothing moves."""
        host = self.session.cell.link.host
        stop_program(host)
        dashboard = DashboardClient(host)
        with contextlib.suppress(OSError):  # PolyScope X has none
            dashboard.ask("stop")
        dashboard.close()

    def _last_words(self) -> str:
        """Returns for a reason how the stream of the lost execution ended by its own account, where it left one."""
        try:
            lines = self.spare.logs[0].read_text(errors="replace").split("\n")[-2:-1]
        except OSError:
            return ""
        return "".join(f"; the stream ended as {line}" for line in lines)

    def _new_heartbeat(self) -> Heartbeat:
        session = self.session
        own = RobotSession.open(session.cell, session.settings, session.monitor)
        return Heartbeat(own, self.store, self.journal, self.watch, self.executor_id, self._unfit)

    def _unfit(self) -> list[str]:
        """Returns why this executor itself is not fit to move anything; empty where it is."""
        return [text for worker in self._workers() if (text := worker.complaint())]

    def _note_version(self) -> None:
        """Keeps the cell's files as a version, as the executor uses them from now on."""
        try:
            source = read_source(self.session.settings.cell_path)
        except CellError:  # gone: the watch reports it
            return
        if source.sha256 == self.session.cell.sha256:  # not changed again meanwhile
            files = source.sha256, source.text, source.calibration
            self._try_store(lambda: self.store.note_cell_version(self.cell, *files, "executor", source.meshes))

    def _continue_with(self, cell: Cell) -> None:
        """Continues with another version of the cell file, at another address if it has one; nothing is executed."""
        self.heartbeat.stop()
        if cell.link == self.session.cell.link:
            self.session.cell = cell
        else:
            self.session.monitor.stop()
            self.session.console.close()
            self.session = RobotSession.open(cell, self.session.settings)
            self.session.monitor.start()
        self.heartbeat = self._new_heartbeat()
        self.heartbeat.start()
        self._note_version()

    def _poll(self, ended: threading.Event) -> None:
        for worker in self._workers():
            worker.revive()
        changed = self.watch.look()
        if changed is not None:
            self._continue_with(changed)
        if not self._is_recovered:
            self.recover()
            return
        self._deliver_kept()
        if time.monotonic() >= self._operate_at:
            self._operate_at = time.monotonic() + OPERATE_S
            self._operate()
        if self.journal.has_undelivered():  # what has run is not claimed again
            return
        row = self._try_store(lambda: self.store.claim_execution(self.cell, self.executor_id))
        if row is not None:
            self._execute(row, ended)
            self._operate("an execution was running")

    def _operate(self, refusal: str = "") -> None:
        """Answers the request to operate the robot, if there is one: obeys it, or refuses it for a reason.

        One that could not be answered in the store is not obeyed again.
        """
        row = self._try_store(lambda: self.store.cell_status(self.cell))
        request = None if row is None else row.open_robot_request
        if request is None:
            return
        id = request["id"]
        if id != self._answered[0]:
            done, text = (False, refusal) if refusal else self._act(request["action"])
            self._answered = (id, done, text)
            log("robot", cell=self.cell, action=request["action"], who=request["requested_by"], done=done, answer=text)
        self._try_store(lambda: self.store.answer_robot_request(self.cell, *self._answered))

    def _act(self, action: RobotAction) -> tuple[bool, str]:
        """Operates the robot; returns whether that was done, and by what or why not."""
        if self.session.settings.read_only:
            return False, "this executor is read-only"
        try:
            return True, f"by the {self.session.console.act(action)}"
        except ActionRefused as error:
            return False, str(error)

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
        self.certifier.start()
        self.stops.execution = execution
        log("claimed", **_log_fields(row))
        self.heartbeat.idle = False
        with contextlib.suppress(OSError):  # what it says is of an earlier execution
            self.spare.logs[0].unlink(missing_ok=True)
        result = ExecutionResult(row.id, "executor_lost", "the executor failed", None)
        publisher = None
        try:
            self._admit()
            plan = self.store.plan(row.plan_id)
            if plan is None:
                raise ExecutionRefused(f"there is no plan {row.plan_id}")
            verify_content(plan)
            execution.profile = self.store.profile_in_use(self.cell, plan.cell_sha256)
            job = execution.prepare(plan.document)
            if ended.is_set() or self._is_aborted(row):
                reason = ENDED_BEFORE_MOTION if ended.is_set() else BEFORE_MOTION
                result = ExecutionResult(row.id, "aborted", reason, None)
                return
            publisher = Publisher(execution, self.store, self._try_store)
            replacer = Replacer(execution, self.store, self._try_store, self.certifier)
            with realtime.real_time_process():
                execution.start(job, self.spare)
                publisher.start()
                replacer.start()
                self._watch(execution, (publisher, replacer), ended)
            replacer.stop()
            self.spare.prepare()
            result = execution.finish()
        except (ExecutionRefused, OSError, StoreUnavailable) as error:
            outcome = "refused" if execution.run is None else "executor_lost"
            result = ExecutionResult(row.id, outcome, str(error), None)
        finally:
            if execution.run is not None:
                execution.run.abort()
                execution.run.wait(STREAM_END_S)
            execution.close()
            self.spare.prepare()
            self._keep(execution, result)
            self.stops.execution = None
            self._deliver(publisher)
            self.heartbeat.idle = True

    def _admit(self) -> None:
        """Checks that this executor may move at all.

        Raises:
            ExecutionRefused: a fault is latched, a thread of this executor died, it is read-only, the cell file is
                refused, or the disk is full.
        """
        fault = self.journal.fault()
        if fault is not None:
            text = f"a fault is latched ({fault['outcome']}: {fault['reason']}): check the robot, then acknowledge"
            raise ExecutionRefused(text)
        if unfit := self._unfit():
            raise ExecutionRefused("; ".join(unfit))
        if self.session.settings.read_only:
            raise ExecutionRefused("this executor is read-only")
        if self.watch.fault is not None:
            raise ExecutionRefused(self.watch.fault["reason"])
        if not self.journal.has_room():
            text = f"the disk is full: less than {MIN_FREE_BYTES / 1e6:.0f} MB are left for the recording"
            raise ExecutionRefused(text)

    def _watch(self, execution: Execution, helpers: tuple[Worker, ...], ended: threading.Event) -> None:
        """Passes on requests to end or to brake, until the run has ended; nothing here waits for the database."""
        run = execution.run
        assert run is not None
        noted = 1  # the claim is no news
        while True:
            over = run.wait(WATCH_S)
            for state in execution.states()[noted:]:
                execution.note(state)
                execution.span.event(state)
                noted += 1
            if over:
                return
            if ended.is_set():
                run.abort(ASKED_TO_END)
            elif self.stops.is_asked(execution.row.id):
                run.abort()
            for worker in (*self._workers(), *helpers):
                worker.revive()

    def _is_aborted(self, row: ExecutionRow) -> bool:
        """Whether a client asked for the brake, at this executor or in the database, where that can be read."""
        requested = self._try_store(lambda: self.store.abort_requested(row.id))
        return bool(requested) or self.stops.is_asked(row.id)

    def _keep(self, execution: Execution, result: ExecutionResult) -> None:
        """Latches a fault where the end was not in order, then keeps the result on the disk."""
        run = execution.run
        in_order = run is None or (run.result is not None and run.result.in_order)
        if result.outcome not in HARMLESS and not (result.outcome == "aborted" and in_order):
            self._latch(result.outcome, result.reason, result.execution_id)
        self.journal.keep(result)
        execution.span.set(fling__outcome=result.outcome, fling__reason=result.reason or None)
        if result.outcome not in HARMLESS:
            execution.span.fail(result.outcome)
        log("finished", **_log_fields(execution.row), outcome=result.outcome, reason=result.reason)

    def _deliver(self, publisher: Publisher | None) -> None:
        """Delivers what was kept, after what is still to be published of its run."""
        if publisher is not None:
            publisher.stop()
        self.heartbeat.report()
        self._deliver_kept()

    def _deliver_kept(self) -> None:
        """Delivers what is kept on the disk, where the database takes it."""
        if self.journal.has_undelivered():
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
