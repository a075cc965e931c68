"""Throwing against placing: the same picks and bins, the same limits; time a cycle over the distance of the bin.

    python -m benchmarks.pick_and_place [--count 12] [--cell ur5e-sim] [--chart docs/img/pick-and-place.svg]

A cycle begins at rest at a pick, the object gripped, and ends at rest at the next pick. Throwing is one motion, as jobs
plan it. Placing is two by the same planner: line up and on to rest over the bin, the object's lowest point at its rim;
and, once the gripper has opened, from there to the next pick. The bin is met upright, as a person would teach it. The
gripper's closing counts in neither. Each distance has `--count` random pairs of picks and directions of the bin.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jobs.cycles import PickLines, motion_request
from planner.cell import Cell, load_cell
from planner.errors import PlannerError
from planner.planning import SearchHints, plan
from planner.request import problem_from_request
from planner.trajectory import Trajectory

CELLS = Path(__file__).parents[1] / "cells"
DISTANCES_M = tuple(round(0.4 + 0.1 * k, 1) for k in range(17))
PICK_SHARE = (0.4, 0.65)  # [-] of the reach: horizontal distance of picks
PICK_HEIGHT_M = 0.15  # [m] above the floor
SIDE_RAD = 0.9  # [rad] of picks and bins to either side of the middle
APART_RAD = 0.5  # [rad] a bin is at least turned from the picks: an arm does not reach over one to the other
DOWN = (math.pi, 0.0, 0.0)
BIN = {"radius_m": 0.12, "rim_height_m": 0.15}
LINES = PickLines(0.1, 0.25)
NO_NEAREST = SearchHints(offers_nearest=False)


@dataclass(frozen=True)
class Pair:
    """One draw: times of a cycle [s], None where it cannot be done."""

    throwing_s: float | None
    placing_s: float | None


def main() -> None:
    """Measures, prints a line a distance, and draws."""
    given = _arguments()
    cell = load_cell(CELLS / f"{given.cell}.toml")
    rng = np.random.default_rng(given.seed)
    found = {}
    print("bin at [m]  thrown  placed  s a cycle thrown, placed (medians where both)  ratio")
    for distance_m in DISTANCES_M:
        pairs = [_pair(cell, rng, distance_m) for _ in range(given.count)]
        found[distance_m] = pairs
        print(_line(distance_m, pairs), flush=True)
    if given.chart is not None:
        _draw(found, cell, given.chart)


def _pair(cell: Cell, rng: np.random.Generator, distance_m: float) -> Pair:
    reach_m = float(np.abs(cell.robot.a).sum())
    bin_rad = float(rng.uniform(-SIDE_RAD, SIDE_RAD))
    picks = []
    while len(picks) < 2:
        angle = float(rng.uniform(-SIDE_RAD - APART_RAD, SIDE_RAD + APART_RAD))
        if abs(angle - bin_rad) > APART_RAD:
            height_m = cell.surroundings.floor_z_m + PICK_HEIGHT_M
            place = _place(cell, reach_m * float(rng.uniform(*PICK_SHARE)), angle, height_m)
            picks.append({"position": place, "rotation_vector": list(DOWN)})
    centre = _place(cell, distance_m, bin_rad, cell.surroundings.floor_z_m)
    start = _planned(cell, motion_request(cell.name, cell.home.tolist(), LINES, next_pick=picks[0]))
    if start is None:
        return _pair(cell, rng, distance_m)  # the pick itself is out of reach: it is nobody's
    at_pick = start.q[-1].tolist()
    target = {"kind": "target", "position": centre, "opening": BIN}
    thrown = _planned(cell, motion_request(cell.name, at_pick, LINES, picks[0], target, picks[1]))
    return Pair(None if thrown is None else thrown.duration_s, _placing_s(cell, at_pick, picks, centre))


def _placing_s(cell: Cell, at_pick: list[float], picks: Sequence[dict[str, Any]], centre: list[float]) -> float | None:
    above = {
        "position": [*centre[:2], centre[2] + BIN["rim_height_m"] + cell.object.radius_m],
        "rotation_vector": list(DOWN),
    }
    there = motion_request(cell.name, at_pick, LINES, picks[0])
    there["end"] = {"kind": "pose", "pose": above}
    carried = _planned(cell, there)
    if carried is None:
        return None
    back = _planned(cell, motion_request(cell.name, carried.q[-1].tolist(), LINES, next_pick=picks[1]))
    return None if back is None else carried.duration_s + cell.gripper.delay_s + back.duration_s


def _planned(cell: Cell, request: dict[str, Any]) -> Trajectory | None:
    try:
        return plan(problem_from_request(request, cell), NO_NEAREST).trajectory
    except PlannerError:
        return None


def _place(cell: Cell, distance_m: float, angle_rad: float, height_m: float) -> list[float]:
    x, y = cell.X_WB[:2, 3] + distance_m * np.array([math.cos(angle_rad), math.sin(angle_rad)])
    return [float(x), float(y), float(height_m)]


def _line(distance_m: float, pairs: Sequence[Pair]) -> str:
    both = [(each.throwing_s, each.placing_s) for each in pairs if each.throwing_s and each.placing_s]
    thrown = sum(each.throwing_s is not None for each in pairs)
    placed = sum(each.placing_s is not None for each in pairs)
    share = f"{distance_m:.1f}  {thrown}/{len(pairs)}  {placed}/{len(pairs)}"
    if not both:
        times = [each.throwing_s for each in pairs if each.throwing_s is not None]
        return f"{share}  {np.median(times):.2f}, –  –" if times else f"{share}  –"
    throwing, placing = np.array(both).T
    return f"{share}  {np.median(throwing):.2f}, {np.median(placing):.2f}  {np.median(throwing / placing):.2f}"


def _draw(found: dict[float, list[Pair]], cell: Cell, file: Path) -> None:
    """Draws both times over the distance, one point a draw, with the medians."""
    from matplotlib import pyplot  # a second to load, and only for the picture

    figure, axes = pyplot.subplots(figsize=(7.0, 3.6), layout="constrained")
    for name, colour in (("throwing_s", "#1f6feb"), ("placing_s", "#b35900")):
        points = [(d, s) for d, pairs in found.items() for each in pairs if (s := getattr(each, name)) is not None]
        medians = {d: np.median([s for at, s in points if at == d]) for d in sorted({d for d, _ in points})}
        axes.plot(*zip(*points, strict=True), ".", color=colour, alpha=0.35)
        axes.plot(list(medians), list(medians.values()), color=colour, label=name.removesuffix("_s"))
    axes.set_xlabel("distance of the bin from the arm [m]")
    axes.set_ylabel("from pick to pick [s]")
    axes.set_ylim(bottom=0.0)
    axes.set_title(f"{cell.robot.name}: bins that can be reached are served by both, the others by throwing")
    axes.legend()
    axes.grid(alpha=0.3)
    figure.savefig(file, metadata={"Date": None})


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=12, help="draws a distance")
    parser.add_argument("--cell", default="ur5e-sim")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--chart", type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main()
