"""Writes arm-capsules.md: what is left between arm and capsules, and how close certified throws come.

python -m benchmarks.arm_capsules.report [--throws 6] [--seed 0] [--out build/benchmarks/arm-capsules.md]
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import click
import numpy as np

from benchmarks.arm_capsules.extents import directions, measured, measured_arms
from benchmarks.arm_capsules.truth import flight_gaps, tool_gaps
from benchmarks.markdown import markdown_table
from planner.cell import Cell, parse_cell
from planner.errors import PlannerError
from planner.geometry import arm_capsules, point_segment_distance
from planner.planning import plan
from planner.problem import TargetRelease, ThrowProblem
from planner.robots import robot

OUT = Path(__file__).parents[2] / "build" / "benchmarks" / "arm-capsules.md"
CELL = """
robot = "{arm}"
[tool]
tcp_position_m = [0.0, 0.0, 0.17]
mass_kg = 0.5
capsules = [{{ from_m = [0.0, 0.0, 0.0], to_m = [0.0, 0.0, 0.15], radius_m = 0.05 }}]
[link]
kind = "sim"
"""
NEAREST = 0.2  # [-] of the arm's length: targets are that near to the base, or farther
FARTHEST = 0.6  # [-]
WINDOW_S = 0.005
TOLERANCE_M = 0.02
SELF_STEP_S = 0.02
HEAD = """# Capsules of the arms

Written by `python -m benchmarks.arm_capsules.report`. The arm itself is what was measured on the meshes of Universal
Robots, in 354 directions a part (docs/collision-geometry.md).

## What is left between arm and capsules

`outside`: the largest distance of a part outside of its capsule; none is. `median` and `largest`: by how much the
capsules reach beyond their parts, over all directions and capsules; the largest is beyond lids.
"""
THROWS = """
## Throws near the base

Targets on the floor at {nearest:g} to {farthest:g} arm lengths, with a release window of {window:g} ms; the cell's
clearance is 20 mm. Distances [mm] are the least of all certified throws: of the object in flight by the certificate,
and from the arm itself; of the tool from the arm itself.
"""


class Thrown(NamedTuple):
    """What was found of the throws of one arm: their number, those certified, and least distances [m]."""

    asked: int
    certified: int
    by_certificate: float
    object_to_arm: float
    tool_to_arm: float


def containment(arm: str) -> list[str]:
    """Returns the row of an arm: largest distance outside, median and largest spare [mm]."""
    capsules = {capsule.name: capsule for capsule in arm_capsules(robot(arm))}
    outside = []
    spare = []
    for part in measured(arm):
        c = capsules[part.name]
        outside.append(float((point_segment_distance(part.corners(), c.p0, c.p1) - c.radius_m).max()))
        n = directions(part.axis)
        spare.append(np.maximum(n @ c.p0, n @ c.p1) + c.radius_m - part.lengths)
    every = np.concatenate(spare)
    return [
        arm,
        f"{round(1e3 * max(outside), 1) + 0.0:.1f}",
        f"{1e3 * np.median(every):.1f}",
        f"{1e3 * every.max():.0f}",
    ]


def throws(arm: str, count: int, seed: int) -> Thrown:
    """Returns what was found of `count` random throws near the base of an arm."""
    cell = parse_cell(CELL.format(arm=arm), arm)
    length = float(np.abs(cell.robot.a).sum())
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        away = length * rng.uniform(NEAREST, FARTHEST)
        angle = rng.uniform(-np.pi, np.pi)
        place = away * np.array([np.cos(angle), np.sin(angle), 0.0])
        problem = ThrowProblem(cell, cell.home, TargetRelease(place), cell.limits, WINDOW_S, TOLERANCE_M)
        try:
            found.append(_least(problem, cell))
        except PlannerError:
            continue
    least = np.min(found, axis=0).tolist() if found else [np.nan] * 3
    return Thrown(count, len(found), *least)


def _least(problem: ThrowProblem, cell: Cell) -> tuple[float, float, float]:
    made = plan(problem)
    motion = made.trajectory
    flown = [min(flight_gaps(problem, motion, delay).values()) for delay in (-WINDOW_S, 0.0, WINDOW_S)]
    postures = motion.at(np.arange(0.0, motion.duration_s, SELF_STEP_S))[0]
    beside = min(min(tool_gaps(cell, q).values()) for q in postures)
    return made.certificate.check("flight_clearance").value, min(flown), beside


@click.command()
@click.option("--throws", "count", default=6, help="Throws of every arm; 0 leaves them out.")
@click.option("--seed", default=0)
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), default=OUT)
def main(count: int, seed: int, out: Path) -> None:
    """Writes the page."""
    columns = ["arm", "outside [mm]", "median [mm]", "largest [mm]"]
    lines = [HEAD, *markdown_table(columns, [containment(name) for name in measured_arms()])]
    if count > 0:
        lines += [THROWS.format(nearest=NEAREST, farthest=FARTHEST, window=1e3 * WINDOW_S), *_thrown(count, seed)]
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text("\n".join([*lines, ""]), encoding="utf-8")


def _thrown(count: int, seed: int) -> list[str]:
    """Returns the table of `count` throws of every arm."""
    rows = []
    for name in measured_arms():
        found = throws(name, count, seed)
        least = [f"{1e3 * value:.1f}" for value in found[2:]]
        rows.append([name, str(found.asked), str(found.certified), *least])
    return markdown_table(["arm", "throws", "certified", "certificate", "object to arm", "tool to arm"], rows)


if __name__ == "__main__":
    main()
