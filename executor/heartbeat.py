"""The heartbeat: the service and everybody else see by it that this executor is alive, and how its robot is."""

from __future__ import annotations

from collections.abc import Callable

from executor.cell_watch import CellWatch
from executor.ownership import where_it_runs
from executor.preflight import PreflightReport, gripper_document, readiness
from executor.records import Journal
from executor.robot import RobotSession, robot_document
from executor.worker import Worker
from store import Store, StoreUnavailable

BEAT_S = 0.25  # [s] the service considers an executor gone after two seconds


class Heartbeat(Worker):
    """Reports to the store several times a second that this executor is alive, with the robot's live state.

    A thread with connections of its own: verifying a plan takes seconds.

    Attributes:
        idle: whether nothing moves.
        is_replaced: whether another executor has taken the cell, because this one was silent for long.
    """

    def __init__(
        self,
        session: RobotSession,
        store: Store,
        journal: Journal,
        watch: CellWatch,
        executor_id: str,
        unfit: Callable[[], list[str]],
    ) -> None:
        """Prepares it.

        Args:
            session: with a console of its own.
            store: to report to.
            journal: has the latched fault.
            watch: of the cell file.
            executor_id: of this executor.
            unfit: returns why the executor itself may move nothing.
        """
        super().__init__("heartbeat")
        self.unfit = unfit
        self.session = session
        self.store = store
        self.journal = journal
        self.executor_id = executor_id
        self.watch = watch
        self.is_replaced = False
        self.idle = True  # the controller is asked only while nothing moves
        self._ready = PreflightReport([])

    def stop(self) -> None:
        """Ends the thread."""
        super().stop()
        self.session.console.close()

    def beat(self) -> None:
        """Looks at the robot where nothing moves, and reports."""
        if self.idle:
            self._ready = readiness(self.session)
        self.report()

    def report(self) -> None:
        """Reports once, and clears an acknowledged fault; an unavailable database is tried again at the next beat."""
        cell = self.session.cell
        session = self.session
        try:
            if self.store.acknowledge_requested(cell.name):
                self._acknowledge()
            ready = self._ready
            refusals = [*self.unfit(), *ready.refusals]
            known = (ready.serial, session.monitor.version)
            findings = robot_document(session.monitor.fresh(), refusals, ready.warnings, *known)
            robot = {**findings, **gripper_document(cell, session.monitor.fresh()), "cell_sha256": cell.sha256}
            fault = self.journal.fault() or self.watch.fault
            read_only = session.settings.read_only
            given = (cell.name, self.executor_id, cell.link.kind, robot, fault, read_only)
            self.is_replaced = not (self.store.record_heartbeat(*given) or self._take_again())
        except StoreUnavailable:
            return

    def _acknowledge(self) -> None:
        """Clears the fault that a person acknowledged: the one that the cell showed, and none that was latched since.

        The request is taken back first: whatever ends this in between, it never clears a later fault.
        """
        row = self.store.cell_status(self.session.cell.name)
        self.store.clear_acknowledge(self.session.cell.name)
        if row is not None and row.fault == self.journal.fault():
            self.journal.clear_fault()

    def _take_again(self) -> bool:
        """Takes the cell again where nobody has it: the database was replaced."""
        cell = self.session.cell
        return self.store.take_cell(cell.name, self.executor_id, cell.link.kind, where_it_runs())

    def run(self) -> None:
        """Reports until the end."""
        while not self.ended.wait(BEAT_S):
            self.beat()
