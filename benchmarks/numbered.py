"""Problems drawn by number and measured one after another: an interrupted run goes on after the rows that it has."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.results import add_row, kept_rows


def numbered_parser(description: str | None, count: int, rows: Path) -> argparse.ArgumentParser:
    """Returns a parser of which problems are measured, and where their rows are kept.

    Args:
        description: of the benchmark.
        count: how many problems are measured unless told.
        rows: file of the rows unless told.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=count)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rows", type=Path, default=rows)
    parser.add_argument("--resume", action="store_true", help="continue after the rows that the file has")
    return parser


def measured_rows(given: argparse.Namespace, measured: Callable[[int], dict[str, Any]]) -> list[dict[str, Any]]:
    """Returns the rows of the problems asked for, after those that the file had.

    Args:
        given: what `numbered_parser` read.
        measured: number of a problem -> its row, with its "number".
    """
    rows = kept_rows(given.rows, given.resume)
    done = {row["number"] for row in rows}
    for number in range(given.first, given.first + given.count):
        if number not in done:
            rows.append(measured(number))
            add_row(given.rows, rows[-1])
    return rows
