"""Throws into bins behind walls: how many objects lie in the bin afterwards.

`python -m benchmarks.streaming.bins [--throws 30] [--seed 0]`. The simulated gripper scatters by a third of the release
window, so that the windows of the plans are used.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.streaming.arms import IDEAL, MEASURED, simulator_options
from planner.errors import Infeasible, SolverFailed
from tests.system.rig import Rig

THROWS_A_CELL = 10  # each cell has a wall of its own
ASKED_A_THROW = 4  # requests at most for each throw: not every drawn bin can be reached
WINDOW_S = 0.005  # [s] the default of a gripper without stated jitter
JITTER_S = WINDOW_S / 3.0  # [s] standard deviation of the simulated gripper: 99.7 % of releases are in the window

# What is drawn, uniformly [m, rad].
WALL_AT_M = (0.55, 0.8)
WALL_THICK_M = (0.03, 0.2)
WALL_HIGH_M = (0.2, 0.6)
BEHIND_M = (0.1, 0.4)  # from the wall's far face to the bin's near edge
BIN_RADIUS_M = (0.08, 0.15)
BIN_RIM_M = (0.1, 0.3)
ASIDE_RAD = (-0.4, 0.4)  # direction of the bin; the wall is wider


@dataclass
class BinThrows:
    """What became of the throws.

    Attributes:
        inside: Throws whose object lies in the bin.
        executed: Throws that were executed to their end.
        landed_on: What the objects landed on or were stopped by.
        held: Throws whose object was kept, because it would have missed the bin's mouth.
        refused: Requests without a plan.
        errors_m: Distances from the planned landing points [m].
    """

    inside: int = 0
    executed: int = 0
    landed_on: Counter[str] = field(default_factory=Counter)
    held: int = 0
    refused: int = 0
    errors_m: list[float] = field(default_factory=list)


def throw_into_bins(folder: Path, count: int, seed: int = 0, arm: str = IDEAL) -> BinThrows:
    """Plans and executes `count` throws into bins, in cells with a wall each.

    Args:
        folder: Folder for stores and logs.
        count: Number of throws.
        seed: Of the walls and bins.
        arm: The arm that throws.
    """
    random = np.random.default_rng(seed)
    found = BinThrows()
    left = count
    while left > 0:
        wall = _wall(random)
        _throw_over_wall(folder / str(left), wall, min(left, THROWS_A_CELL), random, found, arm)
        left -= THROWS_A_CELL
    return found


def _throw_over_wall(
    folder: Path, wall: Any, count: int, random: np.random.Generator, found: BinThrows, arm: str
) -> None:
    lower, upper = wall
    box = f"keep_out = [{{ lower_m = {lower}, upper_m = {upper} }}]"
    rig = Rig(folder, replace={"keep_out = []": box, "gripper_jitter_s = 0.0": f"gripper_jitter_s = {JITTER_S}"})
    rig.start_simulator(*simulator_options(folder, arm))
    rig.start_executor()
    try:
        throws = 0
        for _ in range(ASKED_A_THROW * count):
            if throws == count:
                break
            throws += _throw(rig, _bin(random, upper[0]), found)
    finally:
        rig.stop()


def _throw(rig: Rig, release: dict[str, Any], found: BinThrows) -> bool:
    """Throws into a bin and counts what became of it; returns whether there was a plan."""
    try:
        plan = rig.plan(release, backend="auto", release_window_s=WINDOW_S)
    except (Infeasible, SolverFailed):
        found.refused += 1
        return False
    row = rig.quiet_run(plan)
    if row.outcome == "completed" and row.metrics is not None:
        found.executed += 1
        found.landed_on[str(row.metrics["landed_on"])] += 1
        found.inside += row.metrics["landed_on"] == "bin"
        found.errors_m.append(row.metrics["landing_error_m"])
    found.held += row.outcome == "held"
    if rig.is_latched():
        rig.recover()
        rig.acknowledge()
    return True


def _wall(random: np.random.Generator) -> tuple[list[float], list[float]]:
    """Returns the lower and upper corner of a wall across the x axis [m]."""
    near, thick, high = (float(random.uniform(*drawn)) for drawn in (WALL_AT_M, WALL_THICK_M, WALL_HIGH_M))
    return [near, -0.6, 0.0], [near + thick, 0.6, high]


def _bin(random: np.random.Generator, wall_end_m: float) -> dict[str, Any]:
    """Returns the release of a throw into a bin behind the wall."""
    radius, rim, behind, aside = (
        float(random.uniform(*drawn)) for drawn in (BIN_RADIUS_M, BIN_RIM_M, BEHIND_M, ASIDE_RAD)
    )
    x = wall_end_m + behind + radius
    opening = {"radius_m": radius, "rim_height_m": rim}
    return {"kind": "target", "position": [x, x * float(np.tan(aside)), 0.0], "opening": opening}


def main() -> None:
    """Throws and prints one JSON document."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--throws", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--measured", action="store_true", help=f"{MEASURED}, instead of the {IDEAL}")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        arm = MEASURED if options.measured else IDEAL
        print(json.dumps(vars(throw_into_bins(Path(folder), options.throws, options.seed, arm)), indent=1))


if __name__ == "__main__":
    main()
