"""Writes the results of a batch in a thread of its own, several a transaction, and gives the driver's signs of life.

An outage of the database is waited for: results stay in line meanwhile, which stops the planning once it is full.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from store import BatchLost, BatchResultRow, BatchRow, PlanRow, Store, StoreUnavailable, UnknownBatch

GROUP = 20  # results in one transaction: a megabyte, and other writers wait for some ten milliseconds at most
LINE = 200  # results that may wait to be written
FLUSH_S = 0.5  # [s] after which a smaller group is written
BEAT_S = 1.0  # [s] between two signs of life
OUTAGE_POLL_S = 1.0  # [s] between two attempts while the database does not answer

Written = tuple[BatchResultRow, PlanRow | None]


class ResultWriter:
    """Writes results of a batch while its driver plans; a context manager, whose end has everything written.

    Args:
        store: of the batch.
        row: the batch, claimed.
        on_progress: called with the batch after each transaction, in the writer's thread.

    Attributes:
        is_cancelled: Whether somebody has asked for the batch's end.
        loss: Why nothing more is written: the batch is another driver's, or gone; None while it is ours.
    """

    def __init__(self, store: Store, row: BatchRow, on_progress: Callable[[BatchRow], None]) -> None:
        assert row.driver_id is not None  # as of every batch that is claimed
        self._store = store
        self._id = row.id
        self._driver_id = row.driver_id
        self._on_progress = on_progress
        self._line: queue.Queue[Written | None] = queue.Queue(LINE)
        self._thread = threading.Thread(target=self._run, name="result writer", daemon=True)
        self.is_cancelled = row.cancel_requested_at is not None
        self.loss: BatchLost | UnknownBatch | None = None
        self._has_ended = False

    def __enter__(self) -> ResultWriter:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._put(None)
        self._thread.join()

    @property
    def must_stop(self) -> bool:
        """Whether further results are not wanted."""
        return self.is_cancelled or self.loss is not None or self._has_ended

    def put(self, result: BatchResultRow, plan: PlanRow | None) -> None:
        """Puts a result in line, with its plan if that is new; waits while the line is full."""
        self._put((result, plan))

    def _put(self, one: Written | None) -> None:
        while not self._has_ended:
            with suppress(queue.Full):
                return self._line.put(one, timeout=FLUSH_S)

    def _run(self) -> None:
        try:
            self._write_all()
        finally:
            self._has_ended = True  # of a bug, too: nobody waits for this thread then

    def _write_all(self) -> None:
        group: list[Written] = []
        until = time.monotonic() + FLUSH_S
        beat_at = time.monotonic()
        ended = False
        while not ended:
            try:
                one = self._line.get(timeout=max(0.0, until - time.monotonic()))
                ended = one is None
                if one is not None:
                    group.append(one)
            except queue.Empty:
                until = time.monotonic() + FLUSH_S
            is_due = ended or len(group) >= GROUP or time.monotonic() >= until
            if (group and is_due) or time.monotonic() - beat_at >= BEAT_S:
                self._write(group)
                group = []
                beat_at = time.monotonic()
                until = time.monotonic() + FLUSH_S

    def _write(self, group: list[Written]) -> None:
        """Writes a group, however long the database is away; nothing once the batch is lost."""
        results = [result for result, _ in group]
        plans = [plan for _, plan in group if plan is not None]
        while self.loss is None:
            try:
                if group:
                    row = self._store.add_batch_results(self._id, self._driver_id, results, plans)
                else:
                    row = self._store.beat_batch(self._id, self._driver_id)
            except StoreUnavailable:
                time.sleep(OUTAGE_POLL_S)
            except (BatchLost, UnknownBatch) as loss:
                self.loss = loss
            else:
                self.is_cancelled = row.cancel_requested_at is not None
                self._on_progress(row)
                return
