"""Approaches among the shelves, tables and cages of MotionBenchMaker, by the UR5 with a Robotiq 2F-85.

    python -m benchmarks.motion_bench_maker problems.tar.bz2 --every 10

The archive is that of VAMP's repository, `resources/ur5/problems.tar.bz2`: 700 scenes and requests in MoveIt's YAML.
Source: Chamzas et al., MotionBenchMaker: a tool to generate and benchmark motion planning datasets, RA-L 2022.
"""

from __future__ import annotations

import argparse
import tarfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmarks.problem_sets import cell
from planner.approach import find_approach
from planner.cell import Cell, Solid, ToolCapsule, shape_of
from planner.geometry import body_model
from planner.rotations import pose, quaternion_to_matrix, rotation_vector_to_matrix

Vector = NDArray[np.float64]

# The arm stands on a pedestal, turned by a quarter; ROS's base_link is turned by half a turn against the controller's.
X_WB = pose(np.array([0.0, 0.0, 0.9144]), rotation_vector_to_matrix(np.array([0.0, 0.0, 1.57 - np.pi])))
FLOOR_Z_M = -5.0  # there is none
# The gripper as VAMP has it, spheres in a row made one capsule. source: ur5_spherized.urdf of VAMP
FINGER = (
    (0.0307, 0.0978, 0.0327, 0.1243, 0.02),
    (0.0623, 0.096, 0.0623, 0.136, 0.015),
    (0.0471, 0.15, 0.0471, 0.175, 0.015),
)
PALM = ToolCapsule(np.array([0.0, 0.0, 0.015]), np.array([0.0, 0.0, 0.095]), 0.04)
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


@dataclass(frozen=True, eq=False)
class RestToRest:
    """A problem: the cell, and start and goal (6,) [rad]."""

    name: str
    cell: Cell
    start: Vector
    goal: Vector

    @property
    def is_valid(self) -> bool:
        """Whether both ends are clear, with an empty gripper."""
        ends = np.array([self.start, self.goal])
        return bool((body_model(self.cell).clearances(ends, with_object=False).least >= 0.0).all())


def problems(archive: Path, clearance_m: float) -> Iterator[RestToRest]:
    """Yields the problems of an archive, by name; their cells ask for a clearance [m]."""
    here = _empty_cell(clearance_m)
    read: dict[str, Any] = {}
    with tarfile.open(archive) as files:
        for member in sorted(files.getmembers(), key=lambda member: member.name):
            file = files.extractfile(member)
            if file is not None:
                read[member.name] = yaml.load(file, yaml.CSafeLoader)
    for name, request in read.items():
        if "/request" not in name:
            continue
        shapes = _shapes(read[name.replace("/request", "/scene")])
        around = replace(here.surroundings, keep_out=tuple(shapes))
        start = request["start_state"]["joint_state"]
        goals = request["goal_constraints"][0]["joint_constraints"]
        yield RestToRest(
            name.removeprefix("problems/").removesuffix(".yaml").replace("_ur5/request", "/"),
            replace(here, surroundings=around),
            _posture(dict(zip(start["name"], start["position"], strict=True))),
            _posture({goal["joint_name"]: goal["position"] for goal in goals}),
        )


def _empty_cell(clearance_m: float) -> Cell:
    here = cell("ur5-sim")
    fingers = [
        ToolCapsule(np.array([side * x0, 0.0, z0]), np.array([side * x1, 0.0, z1]), radius)
        for side in (1.0, -1.0)
        for x0, z0, x1, z1, radius in FINGER
    ]
    tool = replace(here.tool, capsules=(PALM, *fingers))
    around = replace(here.surroundings, clearance_m=clearance_m, floor_z_m=FLOOR_Z_M)
    return replace(here, X_WB=X_WB, tool=tool, surroundings=around)


def _shapes(scene: dict[str, Any]) -> Iterator[Solid]:
    for thing in scene["world"]["collision_objects"]:
        for primitive, place in zip(thing["primitives"], thing["primitive_poses"], strict=True):
            X = _pose(thing.get("pose")) @ _pose(place)
            sizes = np.array(primitive["dimensions"], float)
            if primitive["type"] == "cylinder":
                sizes = sizes[::-1]
            yield shape_of(primitive["type"], X, sizes)


def _pose(place: dict[str, list[float]] | None) -> Vector:
    if place is None:
        return np.eye(4)
    return pose(np.array(place["position"]), quaternion_to_matrix(np.array(place["orientation"])))


def _posture(positions: dict[str, float]) -> Vector:
    return np.array([positions[f"{joint}_joint"] for joint in JOINTS])


def main() -> None:
    """Prints one line a problem, and the share solved, times and durations."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archive", type=Path)
    parser.add_argument("--every", type=int, default=1, help="take every n-th problem")
    parser.add_argument("--clearance", type=float, default=0.0, help="[m]")
    options = parser.parse_args()
    ms = []
    durations_s = []
    valid = [task for task in problems(options.archive, options.clearance) if task.is_valid][:: options.every]
    for task in valid:
        begun_s = time.process_time()
        way, _ = find_approach(task.cell, task.start, task.goal, with_object=False)
        ms.append(1e3 * (time.process_time() - begun_s))
        if way is not None:
            durations_s.append(way.duration_s)
        print(f"{task.name:30} {ms[-1]:8.1f} ms  {'-' if way is None else f'{way.duration_s:.2f} s'}", flush=True)
    print(f"solved {len(durations_s)} of {len(valid)}")
    print("processor time p50, p95 [ms]:", np.percentile(ms, [50, 95]).round(1))
    print("duration p50, mean [s]:", round(float(np.median(durations_s)), 2), round(float(np.mean(durations_s)), 2))


if __name__ == "__main__":
    main()
