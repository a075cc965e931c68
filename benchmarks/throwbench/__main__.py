"""ThrowBench: asks planners for throws, judges their answers and writes one table.

    python -m benchmarks.throwbench --count 6                         # every built-in entry, 6 problems of each set
    python -m benchmarks.throwbench --entries mine.py:plan fling      # a function beside Fling
    python -m benchmarks.throwbench --entries mine=http://127.0.0.1:9000/plan --sets random-2
    python -m benchmarks.throwbench --export problems --seed 7        # the problems as files

docs/throwbench.md describes problems, answers, rules and entries.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.results import machine
from benchmarks.throwbench.entries import BUILT_IN, EntryMissing
from benchmarks.throwbench.run import ThrowBenchOptions, chosen_problems, run_entries
from benchmarks.throwbench.sets import HASHES, HIDDEN, HIDDEN_COUNT, export
from benchmarks.throwbench.table import write_table

TIME_LIMIT_S = 120.0
DEFAULT_PAGE = Path("build") / "benchmarks" / "throwbench.md"


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Returns the parsed command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.throwbench",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    names = ", ".join(BUILT_IN)
    parser.add_argument("--entries", nargs="+", default=list(BUILT_IN), help=f"default: {names}")
    parser.add_argument("--sets", nargs="+", choices=[*HASHES, HIDDEN], default=[*HASHES, HIDDEN])
    parser.add_argument("--count", type=_positive, help="problems per set, spread over it (default: all)")
    parser.add_argument("--seed", type=int, default=0, help="of the hidden cells")
    parser.add_argument("--time-limit", type=float, default=TIME_LIMIT_S, metavar="S", help="for one answer [s]")
    parser.add_argument("--out", type=_page, default=DEFAULT_PAGE, help="the page, a .md; default: %(default)s")
    parser.add_argument("--rows", type=Path, help="file of one line an answer; default: beside the page, .jsonl")
    parser.add_argument("--resume", action="store_true", help="keep the judged answers of an interrupted run")
    parser.add_argument("--export", type=Path, metavar="FOLDER", help="write the problems there instead")
    return parser.parse_args(argv)


def main(argv: Sequence[str]) -> int:
    """Runs ThrowBench. Returns the exit status."""
    given = parse(argv)
    if given.export is not None:
        for file in export(given.export, given.count or HIDDEN_COUNT, given.seed):
            print(file)
        return 0
    options = ThrowBenchOptions(
        entries=tuple(given.entries),
        sets=tuple(given.sets),
        count=given.count,
        seed=given.seed,
        time_limit_s=given.time_limit,
        rows=given.rows or given.out.with_suffix(".jsonl"),
        resume=given.resume,
    )
    about = machine() | {"command": " ".join(["python -m benchmarks.throwbench", *argv])}
    problems = chosen_problems(options)
    try:
        rows, missing = run_entries(options, problems)
    except EntryMissing as error:
        print(error, file=sys.stderr)
        return 2
    given.out.parent.mkdir(parents=True, exist_ok=True)
    write_table(given.out, about, rows, problems, missing)
    print(f"written: {given.out}", file=sys.stderr)
    return 0


def _page(text: str) -> Path:
    if not text.endswith(".md"):
        raise argparse.ArgumentTypeError(f"{text} does not end in .md; its numbers are written beside it, as .json")
    return Path(text)


def _positive(text: str) -> int:
    count = int(text)
    if count < 1:
        raise argparse.ArgumentTypeError(f"{count} is below 1")
    return count


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
