"""Results of a batch as a table: plain rows, CSV, JSON lines and Parquet."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import IO, Any

import orjson

from store import BatchResultRow

PARQUET = "application/vnd.apache.parquet"
ADVICE = "needs pyarrow: pip install 'fling-robotics[parquet]'"
TEXT, INTEGER, NUMBER = "string", "int64", "float64"
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
ROW_GROUP = 10_000  # rows of one group of Parquet: what is in memory at once


class ParquetMissing(Exception):
    """The library for Parquet is not installed; the message says which extra has it."""

    def __init__(self) -> None:
        super().__init__(ADVICE)


def rows_of(results: Iterable[BatchResultRow]) -> Iterator[dict[str, Any]]:
    """Yields a row of the table for each result, in the order of `COLUMNS`; None where something is not known."""
    for result in results:
        refusal = result.refusal or {}
        violations = refusal.get("violations") or []
        row = {name: getattr(result, name) for name in COLUMNS if hasattr(result, name)}
        row["constraints"] = " ".join(one["constraint"] for one in violations) or None
        row["proven"] = any(one["proven"] for one in violations) if result.refusal else None
        row["detail"] = refusal.get("detail")
        yield {name: row[name] for name in COLUMNS}


def parquet_of(results: Iterable[BatchResultRow]) -> bytes:
    """Returns results as a Parquet file.

    Raises:
        ParquetMissing: Its library is not installed.
    """
    stream = io.BytesIO()
    _write_parquet(rows_of(results), stream)
    return stream.getvalue()


def writes_to(path: Path) -> bool:
    """Returns whether `write_table` can write this kind of file."""
    return path.suffix in WRITERS


def write_table(path: Path, results: Iterable[BatchResultRow]) -> None:
    """Writes results to a file: Parquet, CSV or JSON lines, by its ending.

    Raises:
        ValueError: The ending is another one.
        ParquetMissing: The library for Parquet is not installed.
    """
    if path.suffix not in WRITERS:
        raise ValueError(f"{path}: must end in {', '.join(WRITERS)}")
    with path.open("wb") as stream:
        WRITERS[path.suffix](rows_of(results), stream)


def _write_csv(rows: Iterable[dict[str, Any]], stream: IO[bytes]) -> None:
    text = io.TextIOWrapper(stream, encoding="utf-8", newline="")
    writer = csv.DictWriter(text, list(COLUMNS), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    text.flush()
    text.detach()


def _write_json_lines(rows: Iterable[dict[str, Any]], stream: IO[bytes]) -> None:
    for row in rows:
        stream.write(orjson.dumps(row) + b"\n")


def _write_parquet(rows: Iterable[dict[str, Any]], stream: IO[bytes]) -> None:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise ParquetMissing from None
    schema = pyarrow.schema([(name, pyarrow.type_for_alias(kind)) for name, kind in COLUMNS.items()])
    remaining = iter(rows)
    with pyarrow.parquet.ParquetWriter(stream, schema) as writer:
        while group := list(islice(remaining, ROW_GROUP)):
            writer.write_table(pyarrow.Table.from_pylist(group, schema))


WRITERS = {".parquet": _write_parquet, ".csv": _write_csv, ".jsonl": _write_json_lines}
