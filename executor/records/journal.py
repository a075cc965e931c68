"""The journal: a folder for results and faults that must survive this process and the database.

A result is written here first and delivered to the store afterwards; a latched fault stays until it is acknowledged.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import orjson

from executor.logs import log
from store import Store, samples_of_csv

CAMERA = "sim-camera"  # source of the landings that a simulated controller reports
FAULT_FILE = "fault.json"
EXECUTOR_FILE = "executor"
RESULT = ".result.json"
MIN_FREE_BYTES = 100_000_000  # [bytes] a recording takes a hundredth of it


class JournalLocked(Exception):
    """Another executor of this cell is running."""


@dataclass(frozen=True)
class ExecutionResult:
    """End of one execution, with its recording and the observed landing where there is one.

    Attributes:
        landing: `id`, `at` [s since the epoch], `position` [m] and `std_m` [m] of what the simulated camera observed.
    """

    execution_id: str
    outcome: str
    reason: str
    metrics: dict[str, Any] | None
    mcap: bytes = b""
    samples: bytes = b""
    landing: dict[str, Any] | None = None


class Journal:
    """Undelivered results and the latched fault; one process at a time owns the folder.

    On a full disk both stay in memory: a result until it is delivered, a fault until it is acknowledged.
    """

    def __init__(self, folder: Path) -> None:
        """Creates and locks the folder.

        Raises:
            JournalLocked: another process holds it.
        """
        self.folder = folder
        self._results: list[ExecutionResult] = []
        self._unknown: set[str] = set()  # executions that the database does not know
        self._fault: dict[str, Any] | None = None
        folder.mkdir(parents=True, exist_ok=True)
        self._lock = (folder / "lock").open("w")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self._lock.close()
            raise JournalLocked(f"another executor of this cell is running (it holds {folder})") from error

    def close(self) -> None:
        """Unlocks the folder."""
        self._lock.close()

    def earlier_executor(self) -> str | None:
        """Returns the id of the executor that had this folder before, and has ended; None without one."""
        path = self.folder / EXECUTOR_FILE
        return path.read_text() if path.exists() else None

    def note_executor(self, executor_id: str) -> None:
        """Notes the id of the executor that has this folder now."""
        with contextlib.suppress(OSError):  # the disk is full: the next one waits for the lease
            self._write(EXECUTOR_FILE, executor_id.encode())

    def has_undelivered(self) -> bool:
        """Whether a result is still to be delivered to this database."""
        in_memory = any(result.execution_id not in self._unknown for result in self._results)
        return in_memory or bool(self._waiting())

    def has_room(self) -> bool:
        """Whether the disk has room for the records of an execution."""
        return shutil.disk_usage(self.folder).free >= MIN_FREE_BYTES

    def keep(self, result: ExecutionResult) -> None:
        """Writes a result to the disk, completely or not at all."""
        summary = {"outcome": result.outcome, "reason": result.reason, "metrics": result.metrics}
        summary |= {"landing": result.landing}
        data = orjson.dumps(summary, option=orjson.OPT_SERIALIZE_NUMPY)
        id = result.execution_id
        try:
            for name, content in (
                (f"{id}.mcap", result.mcap),
                (f"{id}.samples", result.samples),
                (f"{id}{RESULT}", data),
            ):
                self._write(name, content)
        except OSError:  # the disk is full
            for path in self.folder.glob(f"{id}.*"):
                path.unlink()
            self._results.append(result)

    def deliver(self, store: Store) -> None:
        """Delivers every kept result to the store, and deletes it once the store has it.

        A result of an execution that this database does not know is kept, for the next process to try again.

        Raises:
            StoreUnavailable: the database is gone; the rest is delivered later.
        """
        for result in [result for result in self._results if result.execution_id not in self._unknown]:
            if self._is_confirmed(store, result):
                self._results.remove(result)
        for path in self._waiting():
            self._deliver_one(store, path)

    def fault(self) -> dict[str, Any] | None:
        """Returns the latched fault; None without one."""
        path = self.folder / FAULT_FILE
        return self._fault or (orjson.loads(path.read_bytes()) if path.exists() else None)

    def latch(self, fault: dict[str, Any]) -> None:
        """Latches a fault that outlives this process."""
        self._fault = fault
        with contextlib.suppress(OSError):  # the disk is full: kept in this process only
            self._write(FAULT_FILE, orjson.dumps(fault))

    def clear_fault(self) -> None:
        """Deletes the latched fault; it was acknowledged."""
        self._fault = None
        (self.folder / FAULT_FILE).unlink(missing_ok=True)

    def _waiting(self) -> list[Path]:
        """Returns the files of the results that this database may take, oldest first."""
        files = sorted(self.folder.glob(f"*{RESULT}"))
        return [file for file in files if file.name.removesuffix(RESULT) not in self._unknown]

    def _deliver_one(self, store: Store, path: Path) -> None:
        execution_id = path.name.removesuffix(RESULT)
        summary = orjson.loads(path.read_bytes())
        mcap, samples, csv = (self.folder / f"{execution_id}.{kind}" for kind in ("mcap", "samples", "csv"))
        if csv.exists():  # written by an earlier version of Fling
            samples.write_bytes(samples_of_csv(csv.read_bytes()))
        recording = [file.read_bytes() if file.exists() else b"" for file in (mcap, samples)]
        result = ExecutionResult(execution_id, **summary, mcap=recording[0], samples=recording[1])
        if self._is_confirmed(store, result):
            for file in (path, mcap, samples, csv):
                file.unlink(missing_ok=True)

    def _is_confirmed(self, store: Store, result: ExecutionResult) -> bool:
        """Delivers a result; returns whether the store has it now."""
        if deliver(store, result):
            return True
        self._unknown.add(result.execution_id)
        log("a result is kept, as the database does not know its execution", execution=result.execution_id)
        return False

    def _write(self, name: str, data: bytes) -> None:
        part = self.folder / f"{name}.part"
        with part.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(self.folder / name)


def deliver(store: Store, result: ExecutionResult) -> bool:
    """Delivers one result to the store, its end last; returns whether the store has it now.

    Raises:
        StoreUnavailable: the database is gone.
    """
    id = result.execution_id
    if store.execution(id) is None:
        return False
    if result.mcap:
        store.add_recording(id, result.mcap, result.samples)
    if result.landing:
        store.add_landing(execution_id=id, source=CAMERA, **result.landing)
    store.finish_execution(id, result.outcome, result.reason, result.metrics, is_known=True)
    row = store.execution(id)
    return row is not None and row.outcome == result.outcome
