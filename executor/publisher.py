"""Between a run and the store: its states and telemetry go there, and a client's request to abort comes from there.

A thread of its own: a database that does not answer holds up neither a stop nor the end of the run.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from executor.execution import Execution
from executor.records import row_document
from executor.worker import Worker
from store import Store

TELEMETRY_S = 0.04  # [s] between two telemetry events: 25 Hz


class Publisher(Worker):
    """Publishes one run, from its start until its end."""

    def __init__(self, execution: Execution, store: Store, attempt: Callable[[Callable[[], Any]], Any]) -> None:
        """Prepares it.

        Args:
            execution: whose run is started.
            store: to write to, and to read requests from.
            attempt: calls the store; None where that is not available.
        """
        super().__init__("publisher")
        self.execution = execution
        self.store = store
        self._attempt = attempt
        self._published = 1  # the claim was published as `preparing`

    def run(self) -> None:
        """Publishes until the run has ended."""
        run = self.execution.run
        id = self.execution.row.id
        assert run is not None
        while not run.wait(TELEMETRY_S):
            self._publish_states()
            if self._attempt(lambda: self.store.abort_requested(id)):
                run.abort()
            latest = run.latest_row()
            if latest is not None:
                document = row_document(latest)
                self._attempt(lambda document=document: self.store.add_event(id, "telemetry", document))
        self._publish_states()

    def _publish_states(self) -> None:
        """Publishes the states entered since, including ones shorter than the polling period."""
        entered = self.execution.states()
        while self._published < len(entered):
            state = entered[self._published]
            self._published += 1
            self._attempt(lambda state=state: self.store.set_state(self.execution.row.id, state))
