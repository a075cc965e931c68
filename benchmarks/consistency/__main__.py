"""`python -m benchmarks.consistency --problems 200 --searched 25 --out docs/benchmarks`: runs this part alone."""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.consistency.report import consistency_report
from benchmarks.results import write_report


def main() -> None:
    """Runs the comparison and writes `consistency.md`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=200, help="problems that are loosened")
    parser.add_argument("--searched", type=int, default=25, help="problems of each set that are searched from 48 seeds")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="folder of the report; default: standard output")
    given = parser.parse_args()
    text = consistency_report(given.problems, given.searched, given.seed)
    write_report(text, given.out, "consistency.md")


main()
