"""Cells with two grippers, requests that throw both objects, and faults in their plans: for `benchmarks.proofs`.

The station is one of the audit's; its tool, what that holds, and the throws are drawn: each target is where a random
state of the arm about its home throws that object.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from planner.answer import plan_from_document
from planner.cell import Box, Cell, cell_of_keys
from planner.certificate import (
    ArmSamples,
    MotionSamples,
    landing_errors,
    momentum_sizes,
    power_sizes,
    stopping_distances,
    stopping_times,
    torque_sizes,
)
from planner.errors import CellError
from planner.flight import fly
from planner.geometry import tool_state

OFF_M = 1e-3
INSIDE = 1e-3  # [-] of a peak by which a limit is drawn inside it
A_TICK = 8  # [-] instants at which a peak is looked for
SPREAD_RAD = 0.8  # [rad] about home
SPEED_SHARE = 0.6  # [-] of the velocity limits
NEAR_M = 0.3  # [m] from the base along the floor: a target that is nearer is below the arm
THROWS = 50  # [-] random states that are tried for one target
BOX_M = 0.02  # [m] sides of a box in a flight
TIME_LIMIT_S = 30.0  # [s] of a plan
OF_SAFETY = {
    "momentum_kg_m_s": momentum_sizes,
    "power_w": power_sizes,
    "stopping_time_s": stopping_times,
    "stopping_distance_m": stopping_distances,
}


def two_throws_in(cell: Cell, rng: np.random.Generator) -> tuple[Cell, dict[str, Any]]:
    """Returns a station with two grippers on its tool, and a request that throws both objects.

    Raises:
        CellError: the tool does not fit the station, or it throws nothing.
    """
    two = _with_two_grippers(cell, rng)
    order = [("first", True, ""), ("second", "left", "left")][:: rng.choice([1, -1])]
    passages = [
        {"name": name, "state": _target(two.seen_from(gripper), rng), "releases": releases}
        for name, releases, gripper in order
    ]
    if rng.random() < 0.25:
        by = {"kind": "joint", "positions": two.home.tolist(), "velocities": rng.uniform(-0.2, 0.2, 6).tolist()}
        passages.insert(0, {"name": "before", "state": by})
    end = {"end": {"kind": "home"}} if rng.random() < 0.3 else {}
    return two, {"passages": passages, "time_limit_s": TIME_LIMIT_S, **end}


def _with_two_grippers(cell: Cell, rng: np.random.Generator) -> Cell:
    half_m, long_m = float(rng.uniform(0.05, 0.08)), float(rng.uniform(0.13, 0.2))
    document = {key: value for key, value in cell.document.items() if key not in ("object", "gripper")}
    tool = {
        "tcp_position_m": [0.0, half_m, long_m],
        "mass_kg": float(rng.uniform(0.3, 1.0)),
        "capsules": [
            {"from_m": [0.0, 0.0, 0.0], "to_m": [0.0, 0.0, long_m - 0.08], "radius_m": 0.05},
            {"from_m": [0.0, -half_m, long_m - 0.05], "to_m": [0.0, half_m, long_m - 0.05], "radius_m": 0.02},
        ],
    }
    left = {
        **{"output": "standard_digital", "index": 1, "tcp_position_m": [0.0, -half_m, long_m]},
        **_gripper(rng),
        "object": _ball(rng),
    }
    keys = {"tool": tool, "object": _ball(rng), "gripper": _gripper(rng), "grippers": {"left": left}}
    return cell_of_keys({**document, "name": cell.name, **keys})


def _gripper(rng: np.random.Generator) -> dict[str, Any]:
    return {
        "delay_s": float(rng.uniform(0.01, 0.08)),
        "jitter_s": float(rng.choice([0.0, rng.uniform(0.0, 0.003)])),
        "opening_direction": [0.0, 0.0, 1.0],
        "opening_cone_rad": float(rng.uniform(1.6, np.pi)),
        "hold_acceleration_m_s2": float(rng.uniform(50.0, 150.0)),
    }


def _ball(rng: np.random.Generator) -> dict[str, Any]:
    return {
        "mass_kg": float(np.exp(rng.uniform(np.log(0.02), np.log(0.4)))),
        "radius_m": float(rng.uniform(0.015, 0.035)),
        "drag_coefficient": float(rng.choice([0.0, 0.47])),
    }


def _target(seen: Cell, rng: np.random.Generator) -> dict[str, Any]:
    """Returns a target on the floor where a random state about home throws a gripper's object, without air."""
    around = seen.surroundings
    for _ in range(THROWS):
        q = seen.home + rng.uniform(-SPREAD_RAD, SPREAD_RAD, 6)
        X_WT, V_WT = tool_state(seen, q, rng.uniform(-SPEED_SHARE, SPEED_SHARE, 6) * seen.limits.qd_max)
        flight = fly(X_WT[:3, 3], V_WT[:3], around.floor_z_m, around.gravity_m_s2, 0.0)
        if flight is not None and np.linalg.norm((flight.landing_point - seen.X_WB[:3, 3])[:2]) > NEAR_M:
            return {"kind": "target", "position": flight.landing_point.tolist()}
    raise CellError("grippers", seen.name, "throws nothing about its home")


def faults_of_grippers(document: Mapping[str, Any], cell: Cell) -> Iterator[tuple[str, dict[str, Any], Cell]]:
    """Yields what is wrong, and document and cell with that one fault; the hash stays the plan's."""
    problem, trajectory = plan_from_document(document, cell)
    parts = [part for part in problem.parts if part.problem.throws]
    for part in parts:
        name = problem.passages[part.release].name
        for axis in (0, 1):
            yield f"{name}: target off along {'xy'[axis]}", _target_off(document, part.release, axis), cell
        (off_m,) = landing_errors(part.problem, part.of(trajectory), np.array([trajectory.dt]))
        if off_m > OFF_M:  # a throw may land where it would a tick later
            yield f"{name}: a tick late", _late(document, part.release), cell
    motions = [MotionSamples(part.problem, part.of(trajectory)) for part in parts]
    for name, worse in _tighter_cells(document, cell, motions):
        yield name, dict(document), worse


def _copied(document: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a copy that may be changed, all but its samples."""
    copied = copy.deepcopy({key: value for key, value in document.items() if key != "trajectory"})
    return {**copied, "trajectory": document["trajectory"]}


def _target_off(document: Mapping[str, Any], number: int, axis: int) -> dict[str, Any]:
    found = _copied(document)
    found["request"]["passages"][number]["state"]["position"][axis] += OFF_M
    return found


def _late(document: Mapping[str, Any], number: int) -> dict[str, Any]:
    found = _copied(document)
    told = found["passages"][number]
    if found["release"]["index"] == told["index"]:
        found["release"]["index"] += 1
    told["index"] += 1
    told["end_index"] += 1
    return found


def _tighter_cells(
    document: Mapping[str, Any], cell: Cell, motions: Sequence[MotionSamples]
) -> Iterator[tuple[str, Cell]]:
    """Yields cells with a limit a thousandth inside what a plan needs, or with a box in a flight."""
    for joint, peak in enumerate(_peaks(motions, lambda motion, arm: torque_sizes(motion, arm))):
        tau_max = np.array(cell.limits.tau_max)
        tau_max[joint] = peak * (1.0 - INSIDE)
        yield f"joint_torque[{joint}]", replace(cell, limits=replace(cell.limits, tau_max=tau_max), content="")
    for key, sizes in OF_SAFETY.items():
        (peak,) = _peaks(motions, lambda motion, arm, sizes=sizes: sizes(motion, arm)[None])
        tight = replace(cell.safety, **{key: peak * (1.0 - INSIDE)})
        yield key, replace(cell, safety=tight, content="")
    for passage in document["passages"]:
        if passage["releases"]:
            path = np.array(passage["flight"]["object_path"])
            there = path[len(path) // 2]
            box = Box(there - 0.5 * BOX_M, there + 0.5 * BOX_M, "box")
            around = cell.surroundings
            walled = replace(around, keep_out=(*around.keep_out, box))
            yield f"{passage['name']}: a box in the flight", replace(cell, surroundings=walled, content="")


def _peaks(motions: Sequence[MotionSamples], sizes: Callable[[MotionSamples, ArmSamples], Any]) -> Any:
    """Returns the largest of sizes (k, n), on a dense grid of the times at which a part's load is what is held.

    That is from the release before its own to the one after it.
    """
    trajectory = motions[0].trajectory
    released = [motion.trajectory.release_time_s for motion in motions]
    begins, ends = (0.0, *released[:-1]), (*released[1:], trajectory.duration_s)
    found = []
    for motion, begin_s, end_s in zip(motions, begins, ends, strict=True):
        t = np.linspace(begin_s, end_s, A_TICK * round((end_s - begin_s) * trajectory.sample_rate_hz) + 1)
        found.append(np.max(sizes(motion, motion.at(t)), axis=1))
    return np.max(found, axis=0)
