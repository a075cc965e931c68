"""Numbers that the page's kinematics and flight are tested against; `python -m tests.web.model_numbers` writes them.

The published arms and as many with a measured chain, at random postures; flights with and without drag; a random motion
between its samples. `web/tests/model.test.ts` compares.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from planner import flight
from planner.calibration import fixed_transforms
from planner.kinematics import jacobian, link_poses
from planner.robots import ROBOT_NAMES, Robot, robot
from planner.rotations import pose, rotation_vector_to_matrix
from planner.trajectory import Trajectory
from tests.planner.calibration.arms import deviated_table, measured_arm

FILE = Path(__file__).parents[2] / "web" / "tests" / "model-numbers.json"
POSTURES = 2  # of each arm: every joint's rotation is in every one
FLIGHTS = 6
AIRS = ((9.81, 0.0), (9.81, 0.05), (3.7, 0.8))  # gravity [m/s^2], drag [1/m]


def model_numbers() -> dict[str, Any]:
    """Returns the numbers as one JSON document."""
    rng = np.random.default_rng(0)
    arms = [robot(name) for name in ROBOT_NAMES]
    measured = [measured_arm(name, deviated_table(name, rng)) for name in ROBOT_NAMES]
    return {
        "arms": [_arm(arm, rng) for arm in (*arms, *measured)],
        "flights": [_flight(rng, *air) for air in AIRS for _ in range(FLIGHTS)],
        "motion": _motion(rng),
    }


def _arm(arm: Robot, rng: np.random.Generator) -> dict[str, Any]:
    X_WB, X_FT = (pose(rng.uniform(-1, 1, 3), rotation_vector_to_matrix(rng.uniform(-1, 1, 3))) for _ in range(2))
    q = rng.uniform(-2 * np.pi, 2 * np.pi, (POSTURES, 6))
    qd = rng.uniform(-3, 3, (POSTURES, 6))
    X = link_poses(arm, q, X_WB)
    velocities = np.einsum("nij,nj->ni", jacobian(arm, q, X_FT), qd)[:, :3] @ X_WB[:3, :3].T
    chain = {"transforms": fixed_transforms(arm)} if arm.fixed is not None else {"a": arm.a, "d": arm.d}
    return {
        "name": arm.name,
        "calibrated": arm.fixed is not None,
        **{name: values.tolist() for name, values in chain.items()},
        "alpha": arm.alpha.tolist(),
        "base": X_WB.tolist(),
        "tool": X_FT.tolist(),
        "positions": q.tolist(),
        "velocities": qd.tolist(),
        "links": X[:, 1:, :3].tolist(),
        "tool_pose": (X[:, 6] @ X_FT)[:, :3].tolist(),
        "tool_velocity": velocities.tolist(),
    }


def _flight(rng: np.random.Generator, gravity: float, drag: float) -> dict[str, Any]:
    p = rng.uniform([-1, -1, 0], [1, 1, 2])
    v = rng.uniform(-4, 4, 3)
    plane_z = float(rng.uniform(-1, 1.2))  # above some of the flights
    found = flight.fly(p, v, plane_z, gravity, drag)
    times = np.array([0.0, 0.013, 0.2, 0.55])
    landing = None
    if found is not None:
        landing = {
            "point": found.landing_point.tolist(),
            "velocity": found.landing_velocity.tolist(),
            "time_of_flight_s": found.time_of_flight_s,
            "apex_height_m": found.apex_height_m,
        }
    return {
        "position": p.tolist(),
        "velocity": v.tolist(),
        "plane_z": plane_z,
        "gravity": gravity,
        "drag": drag,
        "landing": landing,
        "times": times.tolist(),
        "path": flight.path(p, v, times, gravity, drag).tolist(),
    }


def _motion(rng: np.random.Generator) -> dict[str, Any]:
    q, qd, qdd = rng.uniform(-1, 1, (3, 5, 6))
    motion = Trajectory(125.0, q, qd, qdd, release_index=2)
    times = np.array([-0.1, 0.0, 0.003, 0.008, 0.0213, 0.032, 1.0])
    found = dict(
        zip(("positions", "velocities", "accelerations"), map(np.ndarray.tolist, motion.at(times)), strict=True)
    )
    samples = {"positions": q.tolist(), "velocities": qd.tolist(), "accelerations": qdd.tolist()}
    return {"sample_rate_hz": 125.0, "samples": samples, "times": times.tolist(), "found": found}


def same(first: Any, second: Any, tolerance: float = 1e-12) -> bool:
    """Returns whether two JSON documents are equal but for the rounding of their numbers."""
    if isinstance(first, dict) and isinstance(second, dict):
        return first.keys() == second.keys() and all(same(first[key], second[key], tolerance) for key in first)
    if isinstance(first, list) and isinstance(second, list):
        return len(first) == len(second) and all(same(a, b, tolerance) for a, b in zip(first, second, strict=True))
    if isinstance(first, float) and isinstance(second, float):
        return math.isclose(first, second, rel_tol=tolerance, abs_tol=tolerance)
    return first == second


if __name__ == "__main__":
    FILE.parent.mkdir(parents=True, exist_ok=True)
    FILE.write_text(json.dumps(model_numbers()) + "\n")
