"""Cycles of jobs at random picks and targets: the share that is planned, and how straight the last way down is.

    python -m benchmarks.cycles --count 50 [--cells ur5e-sim] [--brake 1.5] [--speed 0.25]

Picks lie before the arm, the tool looking down; targets on the floor beyond its reach. Of each draw the approach to the
first pick and the cycle from there over the throw to the second are planned, by one planner process alone.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path
from typing import Any

import numpy as np

from jobs.cycles import BRAKE_M_S2, PickLines, motion_request
from planner.cell import Cell, load_cell
from planner.errors import PlannerError
from planner.geometry import tool_state
from planner.planning import SearchHints, plan
from planner.request import problem_from_request
from planner.trajectory import Trajectory

CELLS = Path(__file__).parents[1] / "cells"
SHIPPED = ("ur3e-sim", "ur5e-sim", "ur10e-sim", "ur15-sim", "ur5-sim")
DOWN = (math.pi, 0.0, 0.0)
PICK_SHARE = (0.4, 0.65)  # [-] of the reach: horizontal distance of picks
HEIGHT_M = (0.1, 0.25)  # [m] of picks above the floor: the held object is clear of it in every cell
TARGET_SHARE = (1.0, 1.5)  # [-] of the reach: distance of targets
SIDE_RAD = 0.9  # [rad] of both, to either side of the middle
NO_NEAREST = SearchHints(offers_nearest=False)


def main() -> None:
    """Measures, and prints a line a cell."""
    arguments = _arguments()
    print("cell  planned  ms (median, p95)  cycle s  sideways mm (median, max)  below mm  fastest m/s")
    for name in arguments.cells:
        print(measured(load_cell(CELLS / f"{name}.toml"), arguments))


def measured(cell: Cell, arguments: argparse.Namespace) -> str:
    """Returns the line of one cell."""
    rng = np.random.default_rng([arguments.seed, len(cell.name)])
    found: list[tuple[float, float, float, float, float]] = []
    lines = BrakedLines(arguments.approach, arguments.speed, arguments.brake)
    refused = 0
    for _ in range(arguments.count):
        reach_m = _reach_m(cell)
        first, second = (_pick(rng, cell, reach_m) for _ in range(2))
        target = {"kind": "target", "position": _place(rng, cell, reach_m, TARGET_SHARE, cell.surroundings.floor_z_m)}
        start = cell.home.tolist()
        for asked in ({"next_pick": first}, {"rises_from": first, "target": target, "next_pick": second}):
            begun_s = time.perf_counter()
            try:
                request = motion_request(cell.name, start, lines, **asked)
                trajectory = plan(problem_from_request(request, cell), NO_NEAREST).trajectory
            except PlannerError as error:
                refused += 1
                if arguments.why:
                    print(f"  {'approach' if 'target' not in asked else 'cycle'}: {str(error)[:150]}")
                break
            start = trajectory.q[-1].tolist()
            shape = _way_down(cell, trajectory, lines, asked["next_pick"])
            found.append((time.perf_counter() - begun_s, trajectory.duration_s, *shape))
    cycles = np.array(found[1::2]) if refused == 0 else np.array(found)
    share = 1.0 - refused / arguments.count
    took, lasts, sideways, below, fastest = cycles.T
    ms = f"{1e3 * np.median(took):.0f} {1e3 * np.quantile(took, 0.95):.0f}"
    way = f"{np.median(sideways):.2f} {sideways.max():.2f}  {below.max():.3f}  {fastest.max():.2f}"
    return f"{cell.name}  {share:.0%}  {ms}  {np.median(lasts):.2f}  {way}"


class BrakedLines(PickLines):
    """Lines that leave the tool so much room that it brakes by another deceleration."""

    def __init__(self, approach_m: float, speed_m_s: float, brake_m_s2: float) -> None:
        super().__init__(approach_m, speed_m_s)
        object.__setattr__(self, "brake_m_s2", brake_m_s2)

    @property
    def brake_m(self) -> float:
        """Height above the pick at which the line ends [m]."""
        return self.speed_m_s**2 / (2.0 * self.brake_m_s2)  # type: ignore[attr-defined]


def _way_down(cell: Cell, trajectory: Trajectory, lines: PickLines, pick: dict[str, Any]) -> tuple[float, float, float]:
    """Returns how far the tool strays sideways [mm] and below the pick [mm] after its line, and its speed [m/s]."""
    lasts_s = (lines.approach_m - lines.brake_m) / lines.speed_m_s
    begins = trajectory.passed[-1] + math.ceil(lasts_s * trajectory.sample_rate_hz - 1e-6)
    state = tool_state(cell, trajectory.q[begins:], trajectory.qd[begins:])
    off = state.p_WT - np.array(pick["position"])
    speed = float(np.linalg.norm(state.v_WT, axis=1).max())
    return 1e3 * float(np.hypot(off[:, 0], off[:, 1]).max()), 1e3 * max(0.0, -float(off[:, 2].min())), speed


def _reach_m(cell: Cell) -> float:
    return float(np.abs(cell.robot.a).sum())


def _pick(rng: np.random.Generator, cell: Cell, reach_m: float) -> dict[str, Any]:
    height = cell.surroundings.floor_z_m + rng.uniform(*HEIGHT_M)
    return {"position": _place(rng, cell, reach_m, PICK_SHARE, height), "rotation_vector": list(DOWN)}


def _place(
    rng: np.random.Generator, cell: Cell, reach_m: float, share: tuple[float, float], height: float
) -> list[float]:
    """Returns a place (3,) before the arm of a cell [m]."""
    angle = rng.uniform(-SIDE_RAD, SIDE_RAD)
    distance = reach_m * rng.uniform(*share)
    x, y = cell.X_WB[:2, 3] + distance * np.array([math.cos(angle), math.sin(angle)])
    return [float(x), float(y), float(height)]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", nargs="+", default=list(SHIPPED))
    parser.add_argument("--count", type=int, default=50, help="draws a cell")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--approach", type=float, default=0.1, help="approach_m [m]")
    parser.add_argument("--speed", type=float, default=0.25, help="line_speed_m_s [m/s]")
    parser.add_argument("--brake", type=float, default=BRAKE_M_S2, help="deceleration after the line [m/s^2]")
    parser.add_argument("--why", action="store_true", help="print the refusals")
    return parser.parse_args()


if __name__ == "__main__":
    main()
