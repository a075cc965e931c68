"""`python -m benchmarks.learning timing [--seed N]`: prints what is learnt of hidden cells, and how well."""

from __future__ import annotations

import argparse
import secrets

from benchmarks.learning.hidden_timing import timing_report

REPORTS = {"timing": timing_report}


def main() -> None:
    """Runs the reports that the command line names."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.learning", description=__doc__)
    parser.add_argument("report", nargs="+", choices=REPORTS)
    parser.add_argument("--seed", type=int, help="of the hidden cells; default: a random one, which is printed")
    options = parser.parse_args()
    seed = secrets.randbelow(1_000_000) if options.seed is None else options.seed
    for name in options.report:
        print(REPORTS[name](seed), flush=True)


if __name__ == "__main__":
    main()
