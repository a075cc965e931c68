"""The journal: what must survive this process and the database, in a folder of its own.

A result is written here first and delivered to the store after; a latched fault stays here until a person has looked.
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

from store import Store, StoreUnavailable

FAULT_FILE = "fault.json"
ROOM_BYTES = 100_000_000  # a recording takes one; below this the disk is as good as full


class Locked(Exception):
    """Another executor of this cell is running."""


@dataclass(frozen=True)
class Result:
    """How one execution ended; the recording where there is one."""

    execution_id: str
    outcome: str
    reason: str
    metrics: dict[str, Any] | None
    mcap: bytes = b""
    csv: bytes = b""


class Journal:
    """Results not delivered yet, and the latched fault. One process at a time owns it.

    Where the disk is full both are kept in memory: a result until it is delivered, a fault until a person has looked.
    """

    def __init__(self, folder: Path) -> None:
        """Opens the folder.

        Raises:
            Locked: another process has it.
        """
        self.folder = folder
        self._results: list[Result] = []
        self._fault: dict[str, Any] | None = None
        folder.mkdir(parents=True, exist_ok=True)
        self._lock = (folder / "lock").open("w")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self._lock.close()
            raise Locked(f"another executor of this cell is running (it holds {folder})") from error

    def close(self) -> None:
        """Gives the folder free."""
        self._lock.close()

    def waiting(self) -> bool:
        """Whether a result is not delivered yet."""
        return bool(self._results) or next(self.folder.glob("*.result.json"), None) is not None

    def has_room(self) -> bool:
        """Whether the disk has room for what an execution leaves behind."""
        return shutil.disk_usage(self.folder).free >= ROOM_BYTES

    def keep(self, result: Result) -> None:
        """Writes a result to the disk; it is complete or not there at all."""
        summary = {"outcome": result.outcome, "reason": result.reason, "metrics": result.metrics}
        data = orjson.dumps(summary, option=orjson.OPT_SERIALIZE_NUMPY)
        id = result.execution_id
        try:
            for name, content in ((f"{id}.mcap", result.mcap), (f"{id}.csv", result.csv), (f"{id}.result.json", data)):
                self._write(name, content)
        except OSError:  # the disk is full
            for path in self.folder.glob(f"{id}.*"):
                path.unlink()
            self._results.append(result)

    def deliver(self, store: Store) -> int:
        """Hands every kept result to the store and forgets it; returns how many are left."""
        with contextlib.suppress(StoreUnavailable):  # the database is gone: later
            while self._results:
                deliver(store, self._results[0])
                del self._results[0]
            for path in sorted(self.folder.glob("*.result.json")):
                self._deliver_one(store, path)
        return len(self._results) + len(list(self.folder.glob("*.result.json")))

    def fault(self) -> dict[str, Any] | None:
        """Returns the latched fault."""
        path = self.folder / FAULT_FILE
        return self._fault or (orjson.loads(path.read_bytes()) if path.exists() else None)

    def latch(self, fault: dict[str, Any]) -> None:
        """Latches a fault, beyond the life of this process."""
        self._fault = fault
        with contextlib.suppress(OSError):  # the disk is full: then in this process alone
            self._write(FAULT_FILE, orjson.dumps(fault))

    def clear_fault(self) -> None:
        """A person has looked."""
        self._fault = None
        (self.folder / FAULT_FILE).unlink(missing_ok=True)

    def _deliver_one(self, store: Store, path: Path) -> None:
        execution_id = path.name.removesuffix(".result.json")
        summary = orjson.loads(path.read_bytes())
        mcap, csv = (self.folder / f"{execution_id}{kind}" for kind in (".mcap", ".csv"))
        recording = [file.read_bytes() if file.exists() else b"" for file in (mcap, csv)]
        deliver(store, Result(execution_id, summary["outcome"], summary["reason"], summary["metrics"], *recording))
        for file in (path, mcap, csv):
            file.unlink(missing_ok=True)

    def _write(self, name: str, data: bytes) -> None:
        part = self.folder / f"{name}.part"
        with part.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(self.folder / name)


def deliver(store: Store, result: Result) -> None:
    """Hands one result to the store, the recording first; nothing where the store does not know the execution.

    Raises:
        StoreUnavailable: the database is gone.
    """
    if store.execution(result.execution_id) is None:
        return  # another database by now: there is nobody to tell
    if result.mcap:
        store.add_recording(result.execution_id, result.mcap, result.csv)
    store.finish_execution(result.execution_id, result.outcome, result.reason, result.metrics)
