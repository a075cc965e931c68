"""Requests in files of JSON or TOML, or on standard input."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from planner.documents import NotToml, parse_json, parse_toml, read_file, read_standard_input
from planner.errors import FileRefused

REQUEST_BYTES = 1_000_000  # [byte] of one request; the service takes no more either
BATCH_BYTES = 300_000_000  # [byte] of a batch: a million requests of 300 bytes


def read_document(file: Path, most_bytes: int = REQUEST_BYTES) -> Any:
    """Returns the JSON in a file (`-`: standard input).

    Raises:
        FileRefused: It is no file, or larger than `most_bytes`.
        InvalidProblem: It is no JSON that means one thing; the same words as the service's.
    """
    text = read_standard_input(most_bytes) if str(file) == "-" else read_file(file, most_bytes)
    return parse_json(text)


def read_toml(file: Path) -> dict[str, Any]:
    """Returns the tables of a file of TOML.

    Raises:
        FileRefused: It is no file, is larger than `REQUEST_BYTES`, or is no TOML.
    """
    try:
        return parse_toml(read_file(file, REQUEST_BYTES))
    except NotToml as error:
        raise FileRefused(file, str(error)) from error
