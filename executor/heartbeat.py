"""The heartbeat: tells the store, a few times a second, that this executor lives and what its robot does.

A thread of its own with its own line to the dashboard: judging a plan for seconds must not make the executor look dead.
"""

from __future__ import annotations

import threading

from executor.journal import Journal
from executor.liveview import robot_document
from executor.station import Station
from store import Store, StoreUnavailable

BEAT_S = 0.25  # [s] the service takes an executor for gone after two seconds


class Heartbeat:
    """Beats until stopped, and hears acknowledgements."""

    def __init__(self, station: Station, store: Store, journal: Journal, executor_id: str) -> None:
        self.station, self.store, self.journal, self.executor_id = station, store, journal, executor_id
        self.idle = True  # the dashboard is asked only while nothing moves
        self._reasons: list[str] = []
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._go_on, name="heartbeat", daemon=True)

    def start(self) -> None:
        """Starts beating."""
        self._thread.start()

    def stop(self) -> None:
        """Stops beating."""
        self._ended.set()
        self._thread.join(5.0)
        self.station.close()

    def beat(self) -> None:
        """Beats once; a database that is gone is tried again at the next beat."""
        station = self.station
        if self.idle:
            self._reasons = station.refusals()
        try:
            if self.store.acknowledge_requested(station.cell.name):
                self.journal.clear_fault()
                self.store.clear_acknowledge(station.cell.name)
            robot = robot_document(station.monitor.fresh(), self._reasons)
            self.store.beat(station.cell.name, self.executor_id, station.cell.link.kind, robot, self.journal.fault(),
                            station.settings.read_only)  # fmt: skip
        except StoreUnavailable:
            return

    def _go_on(self) -> None:
        while not self._ended.wait(BEAT_S):
            self.beat()
