"""`python -m benchmarks`: runs the problem sets and writes the report; `make bench` starts it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.results import write_report
from benchmarks.streaming import streaming_report
from benchmarks.suite import PAIR_SETS, QUICK_SETS, BenchmarkOptions, run
from planner.problem import BACKENDS

ROOT = Path(__file__).parents[1]


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Returns the parsed command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    sets = [*QUICK_SETS, *PAIR_SETS]
    parser.add_argument("--set", dest="sets", action="append", choices=sets, help="default: all quick ones")
    parser.add_argument("--backend", dest="backends", action="append", choices=BACKENDS, help="default: all installed")
    parser.add_argument("--count", type=int, help="problems per set (default: each set's own number)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--slow", action="store_true", help="also 2 x 2,800 pairs and 10,000 audited plans")
    parser.add_argument("--audited", type=int, help="plans audited by other libraries (default 200, slow 10,000)")
    parser.add_argument("--no-streaming", dest="streaming", action="store_false", help="leave the streaming part out")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "benchmarks", help="folder of the report")
    parser.add_argument("--rows", type=Path, default=ROOT / "build" / "benchmarks", help="folder of the raw rows")
    parser.add_argument("--resume", action="store_true", help="keep the rows of an interrupted run")
    return parser.parse_args(argv)


def main(argv: Sequence[str]) -> int:
    """Runs the benchmark. Returns the exit status."""
    given = parse(argv)
    sets = given.sets or [*QUICK_SETS, *(PAIR_SETS if given.slow else ())]
    audited = given.audited if given.audited is not None else (10_000 if given.slow else 200)
    options = BenchmarkOptions(
        sets=tuple(sets),
        backends=tuple(given.backends or ()),
        count=given.count,
        seed=given.seed,
        audited=audited,
        out=given.out,
        rows=given.rows,
        resume=given.resume,
        arguments=tuple(argv),
    )
    run(options)
    if given.streaming and given.sets is None:
        write_report(streaming_report(100 if given.slow else 30, 5), given.rows, "streaming.md")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
