"""Writes the answers of a batch or a map in a thread of its own, several a transaction, with signs of life.

An outage of the database is waited for: answers stay in line meanwhile, which stops the planning once it is full.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from store import PlanRow, StoreError, StoreUnavailable

GROUP = 20  # answers in one transaction: a megabyte, and other writers wait for some ten milliseconds at most
LINE = 200  # answers that may wait to be written
FLUSH_S = 0.5  # [s] after which a smaller group is written
BEAT_S = 1.0  # [s] between two signs of life
OUTAGE_POLL_S = 1.0  # [s] between two attempts while the database does not answer

Put = Callable[[Any, PlanRow | None], None]  # a row of an answer, and its plan if that is new
Save = Callable[[Sequence[Any], Sequence[PlanRow]], bool]  # stores both; returns whether it was cancelled


class ResultWriter:
    """Writes answers while their driver plans; a context manager, whose end has everything written.

    Args:
        save: stores rows and plans in one transaction, none of them as a sign of life.
        is_cancelled: whether it was cancelled before.

    Attributes:
        is_cancelled: Whether the batch or map was cancelled.
        loss: Why nothing more is written: another driver has the batch, or it is gone; None while it is ours.
    """

    def __init__(self, save: Save, is_cancelled: bool) -> None:
        self._save = save
        self._line: queue.Queue[tuple[Any, PlanRow | None] | threading.Event | None] = queue.Queue(LINE)
        self._thread = threading.Thread(target=self._run, name="result writer", daemon=True)
        self._has_ended = False
        self.is_cancelled = is_cancelled
        self.loss: StoreError | None = None

    def __enter__(self) -> ResultWriter:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._put(None)
        self._thread.join()

    @property
    def must_stop(self) -> bool:
        """Whether further answers are not wanted."""
        return self.is_cancelled or self.loss is not None or self._has_ended

    def put(self, row: Any, plan: PlanRow | None) -> None:
        """Puts an answer in line, with its plan if that is new; waits while the line is full."""
        self._put((row, plan))

    def flush(self) -> None:
        """Returns once everything in line is written."""
        written = threading.Event()
        self._put(written)
        while not self._has_ended and not written.wait(FLUSH_S):
            pass

    def _put(self, one: tuple[Any, PlanRow | None] | threading.Event | None) -> None:
        while not self._has_ended:
            with suppress(queue.Full):
                return self._line.put(one, timeout=FLUSH_S)

    def _run(self) -> None:
        try:
            self._write_all()
        finally:
            self._has_ended = True  # of a bug, too: nobody waits for this thread then

    def _write_all(self) -> None:
        group: list[tuple[Any, PlanRow | None]] = []
        written_at = time.monotonic()
        while True:
            one: Any = None
            is_idle = False
            try:
                one = self._line.get(timeout=max(0.0, written_at + FLUSH_S - time.monotonic()))
            except queue.Empty:
                is_idle = True
            if isinstance(one, tuple):
                group.append(one)
            waits = not isinstance(one, tuple)  # nothing more comes soon, or the driver waits for what is there
            is_due = bool(group) and (waits or len(group) >= GROUP or time.monotonic() > written_at + FLUSH_S)
            if is_due or time.monotonic() > written_at + BEAT_S:
                self._write(group)
                group = []
                written_at = time.monotonic()
            if isinstance(one, threading.Event):
                one.set()
            elif one is None and not is_idle:
                return

    def _write(self, group: list[tuple[Any, PlanRow | None]]) -> None:
        """Writes a group, however long the database is away; nothing once the batch is lost."""
        rows = [row for row, _ in group]
        plans = [plan for _, plan in group if plan is not None]
        while self.loss is None:
            try:
                self.is_cancelled = self._save(rows, plans)
                return
            except StoreUnavailable:
                time.sleep(OUTAGE_POLL_S)
            except StoreError as loss:
                self.loss = loss
