"""The executor's log: one JSON object a line on standard error."""

from __future__ import annotations

import logging
import sys
from datetime import UTC, datetime
from typing import Any

import orjson

LOG = logging.getLogger("fling.executor")


class LineFormatter(logging.Formatter):
    """Formats a record as one line of JSON; the attribute `fields` of a record adds members."""

    def format(self, record: logging.LogRecord) -> str:
        """Returns the line."""
        at = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        line = {"at": at, "level": record.levelname.lower(), "message": record.getMessage()}
        return orjson.dumps({**line, **getattr(record, "fields", {})}, default=str).decode()


def configure_logs() -> None:
    """Writes the log of this process to standard error."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(LineFormatter())
    logger = logging.getLogger("fling")
    logger.handlers = [handler]
    logger.propagate = False
    logger.setLevel(logging.INFO)


def log(message: str, **fields: Any) -> None:
    """Writes one line with these members."""
    LOG.info(message, extra={"fields": fields})
