"""`python -m benchmarks.arm_capsules FOLDER [--write]`: how far the capsules contain the meshes; see the package."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.arm_capsules import extents
from benchmarks.arm_capsules.meshes import LINKS, arm_surface
from benchmarks.arm_capsules.shrinking import ROUNDED_M, SPACING_M, FittedCapsule, shrunk, split
from benchmarks.markdown import markdown_table
from planner.geometry import arm_capsules, capsule_endpoints
from planner.kinematics import link_poses
from planner.robots import Robot, robot

Vector = NDArray[np.float64]

CAPSULES = Path(__file__).parents[2] / "planner" / "robot_data" / "capsules.toml"
SOURCE = "lengths measured on the meshes of ur_description (Universal_Robots_ROS2_Description of Universal Robots)"
HEADER = f"""\
# The capsules around the links of every arm: name, DH frame, the ends of the segment in it, radius.
# source: {SOURCE};
#   made by `python -m benchmarks.arm_capsules FOLDER --write`, which says how: not to be edited by hand.
"""


def main(argv: Sequence[str]) -> int:
    """Checks the capsules of every arm, or makes them. Returns 1 where an arm is not within them."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.arm_capsules", description=__doc__)
    parser.add_argument("folder", type=Path, help="of ur_description, with config/ and meshes/")
    parser.add_argument("--write", action="store_true", help="make the capsules and the extents anew")
    given = parser.parse_args(argv)
    surfaces = {name: arm_surface(robot(name), given.folder) for name in extents.measured_arms()}
    if given.write:
        write(surfaces)
        arm_capsules.cache_clear()
    found = {name: outside(robot(name), surface) for name, surface in surfaces.items()}
    body = [[name, *(f"{1e3 * by_link[link]:.1f}" for link in LINKS)] for name, by_link in found.items()]
    print("Largest distance of a link's mesh outside of the arm's capsules [mm]; negative: all of it is inside.")
    print("\n".join(markdown_table(["arm", *LINKS], body)))
    return int(max(max(by_link.values()) for by_link in found.values()) > 0.0)


def write(surfaces: Mapping[str, Mapping[str, Vector]]) -> None:
    """Writes the capsules and the extents of all arms."""
    tables = [HEADER]
    measured = {}
    for name, surface in surfaces.items():
        capsules = shrunk(robot(name), surface)
        measured[name] = extents.extents(robot(name), capsules, surface)
        tables.append(f"[{name}]")
        tables += [_row(_around(*pair)) for pair in zip(capsules, measured[name], strict=True)]
        tables.append("")
    CAPSULES.write_text("\n".join(tables), encoding="utf-8")
    extents.write(measured, SOURCE)


def _around(capsule: FittedCapsule, part: extents.Extent) -> FittedCapsule:
    """Returns a capsule that contains the corners of its part's polytope too."""
    p0, p1 = capsule.ends()
    needed = float(_distance(part.corners(), p0, p1).max())
    return replace(capsule, radius=max(capsule.radius, np.ceil(needed / ROUNDED_M) * ROUNDED_M))


def _row(capsule: FittedCapsule) -> str:
    start, end = ([round(float(x), 4) for x in point] for point in capsule.ends())
    place = f"frame = {capsule.first.frame}, from_m = {start}, to_m = {end}"
    return f"{capsule.first.name} = {{ {place}, radius_m = {capsule.radius:.4f} }}"


def outside(arm: Robot, surface: Mapping[str, Vector]) -> dict[str, float]:
    """Returns the largest distance of the triangles of each link outside of the arm's capsules [m].

    A link may be within capsules of its own frame, and within that of the housing in the frame before, at its joint's
    position 0, for it is round about the joint's axis.
    """
    X = link_poses(arm, np.zeros(6))
    capsules = arm_capsules(arm)
    ends = capsule_endpoints(arm, capsules, np.zeros(6))
    found = {}
    for frame, link in enumerate(LINKS):
        x = split(surface[link], SPACING_M).reshape(-1, 3) @ X[frame, :3, :3].T + X[frame, :3, 3]
        near = [i for i, capsule in enumerate(capsules) if capsule.frame in (frame - 1, frame)]
        gaps = [_distance(x, ends[i, 0], ends[i, 1]) - capsules[i].radius_m for i in near]
        # A triangle is inside where one capsule, being convex, has all of its corners.
        of_triangles = np.reshape(gaps, (len(near), -1, 3)).max(axis=2)
        found[link] = float(of_triangles.min(axis=0).max())
    return found


def _distance(x: Vector, p0: Vector, p1: Vector) -> Vector:
    """Returns the distances (n,) [m] of points (n, 3) from a segment."""
    along = p1 - p0
    share = np.clip((x - p0) @ along / max(float(along @ along), 1e-18), 0.0, 1.0)
    return np.linalg.norm(x - p0 - share[:, None] * along, axis=1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
