"""Rods and boxes thrown to land along an axis, by an arm and a gripper that are not quite what the planner believes.

    python -m benchmarks.landing_orientation [--throws 200] [--first 0] [--seed 1]

Each throw asks for a random place, on the floor or on a table in turn, and for a random axis, to within 20 degrees and
5 cm. What is planned is flown by the simulator's own arm, gripper and world, cycle by cycle but not in real time:
positions are commanded ahead by the lag that the cell has, and the output is switched when the plan says. The
simulator turns the body by its own code until that touches. Hidden from the planner are the mass, the lag, the
gripper's delay and its jitter.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.cell import Cell, cell_of_keys, load_cell
from planner.errors import Infeasible, SolverFailed
from planner.planning import Plan, plan
from planner.request import problem_from_request
from simulator.physics import Workcell
from simulator.settings import SimulatorSettings
from simulator.truth import Truth, truth_of

Vector = NDArray[np.float64]

CELL = Path(__file__).parent.parent / "cells" / "ur5e-sim.toml"
TOLERANCE_RAD = float(np.radians(20.0))
LANDING_M = 0.05  # [m] that the landing may be off, as in Throw-Flip
JITTER_S = 0.003  # [s] of the gripper, which the cell knows
DRAG = 0.8  # [-] of rods and boxes, about
TIME_LIMIT_S = 120.0  # [s] of one plan; most take a few
TABLE_M = 0.25  # [m] from the middle of a table to its edges
FLIGHT_MAX_S = 3.0  # [s] after the motion's end in which every object has landed
QUARTER = 0.5 * np.pi
OBJECTS: dict[str, dict[str, Any]] = {
    "rod": {"shape": "cylinder", "radius_m": 0.01, "length_m": 0.12},
    "rod across": {
        "shape": "cylinder",
        "radius_m": 0.012,
        "length_m": 0.2,
        "in_tool": {"rotation_vector_rad": [0.0, QUARTER, 0.0]},
    },
    "box": {"shape": "box", "size_m": [0.03, 0.03, 0.09]},
    "brick": {"shape": "box", "size_m": [0.03, 0.05, 0.08]},
}


@dataclass(frozen=True)
class Throw:
    """One answered throw: angle from the axis and distance from the target, as planned and as thrown [rad, m]."""

    planned_rad: float
    angle_rad: float
    error_m: float


def cell_with(thing: dict[str, Any]) -> Cell:
    """Returns the shipped cell with an object and a gripper that scatters."""
    keys = load_cell(CELL).document
    gripper = {**keys["gripper"], "jitter_s": JITTER_S}
    return cell_of_keys({**keys, "object": {"mass_kg": 0.1, "drag_coefficient": DRAG, **thing}, "gripper": gripper})


def hidden_truth(cell: Cell, rng: np.random.Generator) -> Truth:
    """Returns how the cell really is in one throw."""
    truth = truth_of(cell)
    delay_s = truth.gripper.delay_s + rng.uniform(-0.004, 0.004)
    lag_s = truth.timing.lag_s + rng.uniform(-0.002, 0.002)
    return replace(
        truth,
        seed=int(rng.integers(2**31)),
        mass_kg=cell.object.mass_kg * rng.uniform(0.6, 1.6),
        timing=replace(truth.timing, lag_s=lag_s),
        gripper=replace(truth.gripper, delay_s=delay_s, jitter_s=JITTER_S),
    )


def release(rng: np.random.Generator, on_table: bool) -> dict[str, Any]:
    """Returns a release that asks for a random place around the arm, and for a random axis."""
    away = rng.uniform(0.9, 1.4)
    angle = rng.uniform(-2.4, 2.4)
    height = rng.uniform(0.05, 0.3) if on_table else 0.0
    place = [away * np.cos(angle), away * np.sin(angle), height]
    asked = {"axis": rng.normal(size=3).tolist(), "tolerance_rad": TOLERANCE_RAD}
    return {"kind": "target", "position": place, "orientation": asked}


def with_table(cell: Cell, place: list[float]) -> Cell:
    """Returns a cell with a table around a place on it."""
    x, y, z = place
    lower = [x - TABLE_M, y - TABLE_M, cell.surroundings.floor_z_m]
    return cell.with_obstacles({"lower_m": lower, "upper_m": [x + TABLE_M, y + TABLE_M, z]})


def thrown(made: Plan, truth: Truth) -> dict[str, Any] | None:
    """Returns the record of the landing of a plan's throw by the simulated arm; None where the object stays."""
    cell = made.problem.cell
    motion = made.trajectory
    dt = made.problem.dt
    station = Workcell(cell, SimulatorSettings(), truth, dt)
    station.world.expect_throw(made.problem.plane_z)
    lead_s = cell.timing.lag_s
    told_s = motion.release_time_s - cell.gripper.delay_s - lead_s
    is_told = False
    begin = round(-lead_s / dt) if told_s > -lead_s else round(told_s / dt)
    for cycle in range(begin, round((motion.duration_s + FLIGHT_MAX_S) / dt)):
        sent_s = cycle * dt
        q, qd, _ = motion.at(np.array([min(max(sent_s + lead_s, 0.0), motion.duration_s)]))
        station.arm.drive(q[0].tolist(), qd[0].tolist())
        if not is_told and sent_s >= told_s - 1e-9:
            is_told = True
            station.outputs.request({f"{cell.gripper.output}_output_mask": 1, f"{cell.gripper.output}_output": 1})
        station.cycle(sent_s + dt)
        if station.world.landings:
            return station.world.landings[0]
    return None


def measured(cell: Cell, truth: Truth, rng: np.random.Generator, on_table: bool) -> Throw | None:
    """Returns the throw of a random request; None where it is refused."""
    asked = release(rng, on_table)
    cell = with_table(cell, asked["position"]) if on_table else cell
    request = {"release": asked, "landing_tolerance_m": LANDING_M, "time_limit_s": TIME_LIMIT_S}
    try:
        made = plan(problem_from_request(request, cell))
    except (Infeasible, SolverFailed):
        return None
    target = made.problem.target
    landed = thrown(made, truth)
    assert target is not None and target.orientation is not None
    planned = next(check.value for check in made.certificate.checks if check.name == "landing_axis")
    if landed is None:
        return Throw(planned, np.pi, np.inf)
    angle = float(target.orientation.angles(np.array(landed["axis"])))
    return Throw(planned, angle, float(np.linalg.norm(np.array(landed["position_m"]) - target.p_W)))


def main() -> None:
    """Measures throws of each object in turn, and prints a line for each, for each object and for all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--throws", type=int, default=200, help="of all objects together")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    cells = {name: cell_with(thing) for name, thing in OBJECTS.items()}
    found: dict[str, list[Throw | None]] = {name: [] for name in OBJECTS}
    for number in range(asked.first, asked.first + asked.throws):
        rng = np.random.default_rng([asked.seed, number])
        name = list(OBJECTS)[number % len(OBJECTS)]
        throw = measured(cells[name], hidden_truth(cells[name], rng), rng, on_table=number // len(OBJECTS) % 2 == 1)
        found[name].append(throw)
        print(number, name, "refused" if throw is None else throw, flush=True)
    for name, throws in found.items():
        print(line(name, throws))
    print(line("all", [each for throws in found.values() for each in throws]))


def line(name: str, throws: list[Throw | None]) -> str:
    """Returns what is told of throws."""
    answered = [each for each in throws if each is not None]
    if not answered:
        return f"{name}: 0 of {len(throws)} answered"
    angles = np.degrees([each.angle_rad for each in answered])
    errors = np.array([each.error_m for each in answered])
    held = int((angles <= np.degrees(TOLERANCE_RAD)).sum())
    return (
        f"{name}: {len(answered)} of {len(throws)} answered, axis within 20 deg for {held}; "
        f"angle p50 {np.median(angles):.1f}, p90 {np.quantile(angles, 0.9):.1f} deg; "
        f"landing p50 {1e3 * np.median(errors):.0f}, p90 {1e3 * np.quantile(errors, 0.9):.0f} mm"
    )


if __name__ == "__main__":
    main()
