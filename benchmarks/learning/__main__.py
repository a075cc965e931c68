"""`python -m benchmarks.learning REPORT …`: what is learnt of hidden cells, and how well.

`timing`: lags from single runs. `gripper`: delay and jitter from calibration throws. `throws`: landing errors and odds
from ordinary throws. The hidden cells are drawn by the seed that is printed.
"""

from __future__ import annotations

import argparse
import secrets
from pathlib import Path
from typing import Any

from benchmarks.learning.gripper_calibration import gripper_report
from benchmarks.learning.hidden_timing import timing_report
from benchmarks.learning.ordinary_throws import throws_report
from benchmarks.learning.plans import kept_throws

TARGETS = 32  # each with a soonest throw and two robust ones
ON_THROWS = {"gripper": gripper_report, "throws": throws_report}


def main() -> None:
    """Runs the reports that the command line names."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.learning", description=__doc__)
    parser.add_argument("reports", nargs="+", choices=["timing", *ON_THROWS])
    parser.add_argument("--seed", type=int, help="of the hidden cells; default: a random one")
    parser.add_argument("--cells", type=int, help="hidden cells; default: 100 (gripper), 200 (throws)")
    parser.add_argument("--plans", type=Path, default=Path("learning-plans.pickle"), help="file that keeps the plans")
    parser.add_argument("--diagram", type=Path, help="file for the reliability diagram of throws (SVG)")
    options = parser.parse_args()
    seed = secrets.randbelow(1_000_000) if options.seed is None else options.seed
    for name in options.reports:
        if name == "timing":
            print(timing_report(seed), flush=True)
            continue
        some: dict[str, Any] = {} if options.cells is None else {"cells": options.cells}
        some |= {"diagram": options.diagram} if name == "throws" else {}
        print(ON_THROWS[name](kept_throws(options.plans, TARGETS), seed, **some), flush=True)


if __name__ == "__main__":
    main()
