"""`python -m benchmarks.batches --count 20000 --out build/benchmarks`: batches through both engines, with kills.

Ray is measured where it is installed (`pip install -r requirements/ray.txt`), else left out, loudly.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from pathlib import Path

from benchmarks.batches.report import batches_report
from benchmarks.results import write_report


def main() -> None:
    """Runs everything and writes `batches.md`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=400, help="requests of each batch with kills")
    parser.add_argument("--costs", type=int, default=200, help="requests of each measurement of costs")
    parser.add_argument("--out", type=Path, help="folder of the report; default: standard output")
    given = parser.parse_args()
    with_ray = importlib.util.find_spec("ray") is not None
    if not with_ray:
        print("RAY IS NOT INSTALLED AND NOT MEASURED: pip install -r requirements/ray.txt", file=sys.stderr)
    text = batches_report(given.count, given.costs, with_ray)
    write_report(text, given.out, "batches.md")


if __name__ == "__main__":
    main()
