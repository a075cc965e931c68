"""`python -m tests.benchmarks`: runs the sets, writes the report. `fling bench` and `make bench` start it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from planner.problem import BACKENDS
from tests.benchmarks.streaming import report
from tests.benchmarks.suite import PAIRS, QUICK, Choice, run

ROOT = Path(__file__).parents[2]


def arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="fling bench", description=__doc__)
    parser.add_argument("--set", dest="sets", action="append", choices=[*QUICK, *PAIRS], help="default: all quick ones")
    parser.add_argument("--backend", dest="backends", action="append", choices=BACKENDS, help="default: all there are")
    parser.add_argument("--count", type=int, help="problems a set (default: each set's own number)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--slow", action="store_true", help="also 2 x 2,800 pairs and 10,000 judged plans")
    parser.add_argument("--judged", type=int, help="plans judged by other libraries (default 200, slow 10,000)")
    parser.add_argument("--no-peers", dest="peers", action="store_false", help="leave other planners out")
    parser.add_argument("--no-streaming", dest="streaming", action="store_false", help="leave the streaming half out")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "benchmarks", help="folder of the report")
    parser.add_argument("--rows", type=Path, default=ROOT / "build" / "benchmarks", help="folder of the raw rows")
    parser.add_argument("--resume", action="store_true", help="keep the rows of a run that was broken off")
    return parser.parse_args(argv)


def main(argv: Sequence[str]) -> int:
    given = arguments(argv)
    sets = given.sets or [*QUICK, *(PAIRS if given.slow else ())]
    judged = given.judged if given.judged is not None else (10_000 if given.slow else 200)
    choice = Choice(
        sets=tuple(sets),
        backends=tuple(given.backends or ()),
        count=given.count,
        seed=given.seed,
        judged=judged,
        peers=given.peers,
        out=given.out,
        rows=given.rows,
        resume=given.resume,
        given=tuple(argv),
    )
    run(choice)
    if given.streaming and given.sets is None:
        (given.out / "streaming.md").write_text(report(100 if given.slow else 30, 5))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
