"""Why a database cannot be used, told apart by its driver's error, and one line in the log for each outage."""

from __future__ import annotations

import errno
import logging
import sqlite3
import threading
import time
from typing import Any

DISK_FULL = "disk_full"
LOCKED = "locked"
READ_ONLY = "read_only"
CORRUPT = "corrupt"
UNREACHABLE = "unreachable"
WORDS = {
    DISK_FULL: "the disk of the database is full",
    LOCKED: "the database is locked by another process",
    READ_ONLY: "the database is read-only",
    CORRUPT: "the database is damaged",
    UNREACHABLE: "the database cannot be reached",
}
SQLITE_KINDS = {  # by primary error code
    sqlite3.SQLITE_FULL: DISK_FULL,
    sqlite3.SQLITE_IOERR: DISK_FULL,  # what SQLite makes of a write beyond a quota or limit
    sqlite3.SQLITE_BUSY: LOCKED,
    sqlite3.SQLITE_LOCKED: LOCKED,
    sqlite3.SQLITE_READONLY: READ_ONLY,
    sqlite3.SQLITE_CORRUPT: CORRUPT,
    sqlite3.SQLITE_NOTADB: CORRUPT,
}
IO_READ_CODES = (266, 522)  # SQLITE_IOERR_READ, SQLITE_IOERR_SHORT_READ: no matter of room; source: sqlite.org/rescode
POSTGRES_KINDS = {  # by SQLSTATE; source: PostgreSQL's manual, appendix A
    "53100": DISK_FULL,
    "55P03": LOCKED,
    "40P01": LOCKED,
    "25006": READ_ONLY,
    "XX001": CORRUPT,
    "XX002": CORRUPT,
}
REPEAT_S = 60.0  # [s] after which an outage that goes on is logged again
LOG = logging.getLogger("fling.store")


def kind_of(error: BaseException) -> str:
    """Returns the kind of an outage from the error of SQLAlchemy or of the driver."""
    driver: Any = getattr(error, "orig", None) or error
    code = getattr(driver, "sqlite_errorcode", None)
    if code is not None and code not in IO_READ_CODES:
        return SQLITE_KINDS.get(code & 0xFF, UNREACHABLE)
    if getattr(driver, "errno", None) == errno.ENOSPC:
        return DISK_FULL
    return POSTGRES_KINDS.get(getattr(driver, "sqlstate", None) or "", UNREACHABLE)


class OutageLog:
    """Logs the begin of an outage, its end, and in between once a minute, however many calls fail.

    Attributes:
        kind: Of the outage; None while the database answers.
        is_muted: Whether nothing is logged yet: whoever opens the database reports a failure himself.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._logged_at = self._began_at = 0.0
        self._failures = 0
        self.kind: str | None = None
        self.is_muted = True

    def failed(self, kind: str, cause: str) -> None:
        """Notes a call that failed."""
        if self.is_muted:
            return
        now = time.monotonic()
        with self._lock:
            is_new = kind != self.kind
            if self.kind is None:
                self._began_at = now
                self._failures = 0
            self.kind = kind
            self._failures = self._failures + 1
            if not is_new and now - self._logged_at < REPEAT_S:
                return
            self._logged_at = now
        LOG.error("%s: %s", WORDS[kind], cause, extra={"fields": {"outage": kind, "failures": self._failures}})

    def wrote(self) -> None:
        """Notes a transaction that was written: an outage is over."""
        if self.kind is None:
            return
        with self._lock:
            fields = {"outage": self.kind, "failures": self._failures}
            fields["duration_s"] = round(time.monotonic() - self._began_at, 3)
            self.kind = None
        LOG.warning("the database is written to again", extra={"fields": fields})
