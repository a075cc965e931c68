"""`python -m benchmarks.maps --out build/benchmarks`: a map of 3 × 3 m at 5 cm, killed, gone on with and judged.

About 25 minutes on two cores that do nothing else; `--resolution 0.3 --sample 30` takes two.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.maps.report import MapTask, maps_report
from benchmarks.results import write_report
from jobs.maps import MapRequest
from planner.cell import read_source

ROOT = Path(__file__).parents[2]


def main() -> None:
    """Runs everything and writes `maps.md` and its picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cell", default="ur5e-sim")
    parser.add_argument("--extent", type=float, nargs=4, default=(-1.5, 1.5, -1.5, 1.5), help="x0 x1 y0 y1 [m]")
    parser.add_argument("--resolution", type=float, default=0.05, help="edge of a landing cell [m]")
    parser.add_argument("--robust", action="store_true", help="robust plans instead of soonest ones")
    parser.add_argument("--sample", type=int, default=2000, help="landing cells that are planned again")
    parser.add_argument("--workers", type=int, default=2, help="planner processes")
    parser.add_argument("--out", type=Path, help="folder of the report; default: standard output")
    given = parser.parse_args()
    x0, x1, y0, y1 = given.extent
    request = MapRequest(resolution_m=given.resolution, extent_m=(x0, x1, y0, y1), robust=given.robust)
    source = read_source(ROOT / "cells" / f"{given.cell}.toml")
    command = f"python -m benchmarks.maps {' '.join(sys.argv[1:])}".strip()
    task = MapTask(source, request, given.sample, given.workers, command)
    picture = (given.out or Path.cwd()) / f"map-{given.cell}.png"
    text = maps_report(task, picture)
    write_report(text, given.out, "maps.md")


if __name__ == "__main__":
    main()
