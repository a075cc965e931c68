"""Results of a batch as a table: plain rows, CSV, JSON lines and Parquet."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from itertools import chain, islice
from pathlib import Path
from typing import IO, Any

import orjson

from store import BatchResultRow

PARQUET = "application/vnd.apache.parquet"
ADVICE = "needs pyarrow: pip install 'fling-robotics[parquet]'"
TEXT = "string"
INTEGER = "int64"
NUMBER = "float64"
TEXTS = "list of string"  # with blanks between in CSV
COLUMNS = {
    "number": INTEGER,
    "outcome": TEXT,
    "plan_id": TEXT,
    "problem_sha256": TEXT,
    "trajectory_sha256": TEXT,
    "release_time_s": NUMBER,
    "duration_s": NUMBER,
    "release_speed_m_s": NUMBER,
    "hit_probability": NUMBER,
    "planning_time_s": NUMBER,
    "constraints": TEXT,  # names of the constraints that refuse a request, with spaces between
    "proven": "bool",
    "detail": TEXT,
}
Parameters = Mapping[str, float | str]  # values of a grid's axes in one request, by path; columns after the number
ROW_GROUP = 10_000  # rows of one group of Parquet: what is in memory at once


class ParquetMissing(Exception):
    """The library for Parquet is not installed; the message says which extra has it."""

    def __init__(self) -> None:
        super().__init__(ADVICE)


def row_of(result: BatchResultRow, parameters: Parameters) -> dict[str, Any]:
    """Returns the row of a result; None where something is not known.

    Args:
        result: of one request.
        parameters: what the grid gave this request.
    """
    refusal = result.refusal or {}
    violations = refusal.get("violations") or []
    row = {name: getattr(result, name) for name in COLUMNS if hasattr(result, name)}
    row["constraints"] = " ".join(one["constraint"] for one in violations) or None
    row["proven"] = any(one["proven"] for one in violations) if result.refusal else None
    row["detail"] = refusal.get("detail")
    return {**row, **parameters}


def _columns(parameters: Parameters) -> dict[str, str]:
    """Returns the types of a table's columns, by name, in their order."""
    axes = {path: TEXT if isinstance(value, str) else NUMBER for path, value in parameters.items()}
    return {"number": COLUMNS["number"], **axes, **COLUMNS}


def writes_to(path: Path) -> bool:
    """Returns whether `write_table` can write this kind of file."""
    return path.suffix in WRITERS


def write_table(path: Path, results: Iterable[tuple[BatchResultRow, Parameters]]) -> None:
    """Writes results to a file: Parquet, CSV or JSON lines, by its ending.

    Args:
        path: of the file.
        results: each with what the grid gave its request; all have the same axes.

    Raises:
        ValueError: The ending is another one.
        ParquetMissing: The library for Parquet is not installed.
    """
    if path.suffix not in WRITERS:
        raise ValueError(f"{path}: must end in {', '.join(WRITERS)}")
    remaining = iter(results)
    first = list(islice(remaining, 1))
    columns = _columns(first[0][1] if first else {})
    rows = (row_of(*pair) for pair in chain(first, remaining))
    with path.open("wb") as stream:
        WRITERS[path.suffix](columns, rows, stream)


def write_csv(columns: Mapping[str, str], rows: Iterable[dict[str, Any]], stream: IO[bytes]) -> None:
    """Writes a table as CSV with a header.

    Args:
        columns: types by name, in their order.
        rows: values by name; None where something is not known.
        stream: takes it.
    """
    text = io.TextIOWrapper(stream, encoding="utf-8", newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        cells = [row[name] for name in columns]
        writer.writerow([" ".join(cell) if isinstance(cell, list) else cell for cell in cells])
    text.flush()
    text.detach()


def _write_json_lines(columns: Mapping[str, str], rows: Iterable[dict[str, Any]], stream: IO[bytes]) -> None:
    for row in rows:
        stream.write(orjson.dumps({name: row[name] for name in columns}) + b"\n")


def write_parquet(columns: Mapping[str, str], rows: Iterable[dict[str, Any]], stream: IO[bytes]) -> None:
    """Writes a table as Parquet; see `write_csv`.

    Raises:
        ParquetMissing: The library for Parquet is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise ParquetMissing from None
    types = {TEXTS: pyarrow.list_(pyarrow.string())}
    schema = pyarrow.schema([(name, types.get(kind) or pyarrow.type_for_alias(kind)) for name, kind in columns.items()])
    remaining = ({name: row[name] for name in columns} for row in rows)
    with pyarrow.parquet.ParquetWriter(stream, schema) as writer:
        while group := list(islice(remaining, ROW_GROUP)):
            writer.write_table(pyarrow.Table.from_pylist(group, schema))


WRITERS = {".parquet": write_parquet, ".csv": write_csv, ".jsonl": _write_json_lines}
