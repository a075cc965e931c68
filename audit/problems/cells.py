"""Random cells, as the keys of their files: every arm, mounting, tool, object, gripper, limits and surroundings."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from audit.judge import posture_room
from audit.problems.cell_file import CellFiles
from audit.problems.surroundings import Furniture
from planner.cell import Cell
from planner.errors import CellError
from planner.robots import INCOMPLETE_NAMES, ROBOT_NAMES, missing_numbers, robot

Vector = NDArray[np.float64]

ARMS = (*ROBOT_NAMES, *INCOMPLETE_NAMES)
MOUNTINGS = {"floor": 0.0, "leaning": 0.4, "wall": np.pi / 2, "ceiling": np.pi}  # [rad] tilt of the base
HOME_RAD = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])
HOME_SPREAD_RAD = 0.4
SHAPES_MAX = 4  # of the surroundings
SHAPE_TRIES = 6  # of places for one shape
LIKE = "ur18"  # the published arm whose numbers stand for those that an arm lacks
CELLS_KEPT = 4  # in a process; each has several problems in a row


@lru_cache(maxsize=CELLS_KEPT)
def random_cell(seed: int, number: int) -> tuple[CellFiles, Cell]:
    """Returns the files of the cell of this number, and the cell as read."""
    rng = np.random.default_rng([seed, number, 0])
    arm = ARMS[number % len(ARMS)]
    while True:
        keys = _station(arm, rng)
        files = CellFiles(f"c{number}-{arm}", keys)
        if (cell := _read(files)) is not None:
            return _furnished(files, cell, rng)


def _read(files: CellFiles) -> Cell | None:
    """Returns the cell; None where the arm has no room at home, or tool and object are too heavy together."""
    try:
        cell = files.read()
    except CellError:
        return None
    return cell if posture_room(cell, cell.home) > 0.0 else None


def _station(arm: str, rng: np.random.Generator) -> dict[str, Any]:
    """Returns an arm on a base, with everything but shapes around."""
    small = rng.random() < 0.3
    keys: dict[str, Any] = {"robot": arm, "home_rad": (HOME_RAD + HOME_SPREAD_RAD * rng.uniform(-1, 1, 6)).tolist()}
    if missing_numbers(arm):
        keys["arm_data"] = _arm_data(arm, rng)
    mounting = str(rng.choice(list(MOUNTINGS)))
    tool, thing = _tool_and_object(rng)
    return {
        **keys,
        "base_in_world": _base(MOUNTINGS[mounting], rng),
        "tool": tool,
        "object": thing,
        "gripper": _gripper(rng),
        "limits": _limits(arm, keys.get("arm_data"), small, rng),
        "safety": _safety(rng),
        "surroundings": {
            "floor_z_m": 0.0,
            "clearance_m": float(rng.choice([0.0, 0.005, 0.02, 0.05])),
            "gravity_m_s2": float(rng.choice([9.81, 9.78, 1.62], p=[0.8, 0.15, 0.05])),
        },
        "timing": {"lag_s": float(rng.choice([0.0, 0.02]))},
        "link": {"kind": "sim"},
    }


def _arm_data(arm: str, rng: np.random.Generator) -> dict[str, Any]:
    """Returns what an arm lacks: numbers of another one, its lengths and speeds drawn about them."""
    like = robot(LIKE)
    numbers = {
        "dh_a_m": (like.a * rng.uniform(0.9, 1.2)).tolist(),
        "dh_d_m": (like.d * rng.uniform(0.9, 1.1)).tolist(),
        "joint_velocity_deg_s": [float(rng.uniform(120.0, 200.0))] * 6,
        "joint_torque_n_m": (like.tau_max * rng.uniform(1.0, 1.5)).tolist(),
        "link_mass_kg": [link.mass for link in like.links],
        "link_com_m": [link.com.tolist() for link in like.links],
        "link_inertia_kg_m2": [link.inertia[np.triu_indices(3)].tolist() for link in like.links],
    }
    return {key: numbers[key] for key in missing_numbers(arm)} | {"source": f"drawn about those of a {LIKE}"}


def _base(tilt: float, rng: np.random.Generator) -> dict[str, Any]:
    turn = rng.uniform(-np.pi, np.pi, 2)
    R = pin.utils.rotate("z", turn[0]) @ pin.utils.rotate("x", tilt + rng.uniform(-0.1, 0.1))
    height = rng.uniform(0.0, 0.8) + (1.2 if tilt > 1.0 else 0.0)
    place = [*rng.uniform(-1.0, 1.0, 2).tolist(), float(height)]
    return {"position_m": place, "rotation_vector_rad": pin.log3(R @ pin.utils.rotate("z", turn[1])).tolist()}


def _tool_and_object(rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, Any]]:
    tcp = rng.uniform([-0.08, -0.08, 0.06], [0.08, 0.08, 0.25])
    tool: dict[str, Any] = {
        "tcp_position_m": tcp.tolist(),
        "tcp_rotation_vector_rad": rng.uniform(-0.8, 0.8, 3).tolist(),
        "mass_kg": float(rng.uniform(0.1, 1.2)),
    }
    kind = str(rng.choice(["assumed", "capsule", "box", "cylinder", "sphere", "round"]))
    if kind == "capsule":
        tool["capsules"] = [{"from_m": [0.0, 0.0, 0.0], "to_m": (0.8 * tcp).tolist(), "radius_m": 0.03}]
    elif kind != "assumed":
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), tcp / np.linalg.norm(tcp)).matrix()
        place = {"position_m": (0.4 * tcp).tolist(), "rotation_vector_rad": pin.log3(turn).tolist()}
        long = 0.8 * float(np.linalg.norm(tcp))
        wide = float(rng.uniform(0.02, 0.05))
        sizes = {
            "box": {"size_m": [2.0 * wide, wide, long]},
            "cylinder": {"radius_m": wide, "length_m": long},
            "sphere": {"radius_m": wide},
            "round": {"shape": "capsule", "radius_m": wide, "length_m": 0.6 * long},
        }
        tool["shapes"] = [{"shape": kind, "pose": place, **sizes[kind]}]
    return tool, _object(rng)


def _object(rng: np.random.Generator) -> dict[str, Any]:
    kind = str(rng.choice(["sphere", "box", "cylinder", "capsule"], p=[0.6, 0.15, 0.15, 0.1]))
    thing: dict[str, Any] = {
        "shape": kind,
        "mass_kg": float(np.exp(rng.uniform(np.log(0.005), np.log(1.0)))),
        "drag_coefficient": float(rng.choice([0.0, 0.47, 1.2])),
    }
    if kind == "sphere":
        thing["radius_m"] = float(rng.choice([0.0, rng.uniform(0.01, 0.06)], p=[0.15, 0.85]))
    elif kind == "box":
        thing["size_m"] = rng.uniform(0.02, 0.1, 3).tolist()
    else:
        thing |= {"radius_m": float(rng.uniform(0.01, 0.03)), "length_m": float(rng.uniform(0.03, 0.15))}
    if kind != "sphere":
        thing["in_tool"] = {"rotation_vector_rad": rng.uniform(-1.5, 1.5, 3).tolist()}
    return thing


def _gripper(rng: np.random.Generator) -> dict[str, Any]:
    table: dict[str, Any] = {"jitter_s": float(rng.choice([0.0, rng.uniform(0.0, 0.006)]))}
    if rng.random() < 0.7:
        table |= {"opening_direction": [0.0, 0.0, 1.0], "opening_cone_rad": float(rng.uniform(0.8, np.pi))}
    if rng.random() < 0.7:
        withstood = float(np.exp(rng.uniform(np.log(20.0), np.log(150.0))))
        table["hold_acceleration_m_s2"] = withstood if rng.random() < 0.5 else [withstood] * 3
    return table


def _limits(arm: str, data: dict[str, Any] | None, small: bool, rng: np.random.Generator) -> dict[str, Any]:
    """Returns limits within the arm's own; where they are `small`, some of them a tenth of ordinary ones."""

    def share() -> float:
        return float(rng.uniform(0.1, 0.5)) if small and rng.random() < 0.5 else float(rng.uniform(0.5, 1.0))

    given = (data or {}).get("joint_velocity_deg_s")
    fastest = robot(arm).qd_max if given is None else np.radians(given)
    return {
        "joint_velocity_rad_s": [share() * float(most) for most in fastest],
        "joint_acceleration_rad_s2": [15.0 * share() for _ in range(6)] if rng.random() < 0.5 else 15.0 * share(),
        "joint_jerk_rad_s3": 500.0 * share() * float(rng.choice([1.0, 4.0])),
        "joint_torque_fraction": float(rng.uniform(0.6, 1.0)),
        "tcp_speed_m_s": 4.0 * share(),
        "singularity_distance_min": float(rng.choice([0.0, 0.001, 0.05, 0.1])),
    }


def _safety(rng: np.random.Generator) -> dict[str, float]:
    """Returns some of the arm's own safety limits, from loose ones down to a third of these."""
    ordinary = {
        "tool_speed_m_s": 5.0,
        "elbow_speed_m_s": 3.0,
        "momentum_kg_m_s": 80.0,
        "power_w": 1200.0,
        "stopping_time_s": 0.6,
        "stopping_distance_m": 0.8,
    }
    return {name: value * float(rng.uniform(0.35, 1.0)) for name, value in ordinary.items() if rng.random() < 0.5}


def _furnished(files: CellFiles, cell: Cell, rng: np.random.Generator) -> tuple[CellFiles, Cell]:
    """Returns the cell with shapes around and perhaps in a room, all of which leave the arm its room at home."""
    furniture = Furniture(cell, rng)
    wanted = int(rng.integers(0, SHAPES_MAX + 1))
    room = furniture.room() if rng.random() < 0.3 else None
    for entry in [room] if room is not None else []:
        found = CellFiles(files.name, furniture.with_room(files.keys, entry), files.beside)
        if (more := _read(found)) is not None:
            files, cell = found, more
    for number in range(wanted):
        for _ in range(SHAPE_TRIES):
            entry, beside = furniture.shape(number)
            found = CellFiles(files.name, furniture.with_shape(files.keys, entry), {**files.beside, **beside})
            if (more := _read(found)) is not None:
                files, cell = found, more
                break
    return files, cell
