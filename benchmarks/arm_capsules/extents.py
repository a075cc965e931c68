"""How far the parts of an arm extend in a few hundred directions: what a capsule must contain, without the meshes.

A part is what one capsule is there for: the triangles of the mesh that lie deepest in it. In every direction n its
extent is the largest n . x of its points, rounded up to 0.1 mm, so the polytope {x: n . x <= extent for every n}
contains the part. A capsule is convex: it contains the polytope, and thus the part, if it contains its corners.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import HalfspaceIntersection

from benchmarks.arm_capsules.meshes import LINKS
from benchmarks.arm_capsules.shrinking import SPACING_M, FittedCapsule, parts, split
from planner.kinematics import link_poses
from planner.robots import ROBOT_NAMES, Robot, robot

Vector = NDArray[np.float64]

FILE = Path(__file__).with_name("extents.json")
UNIT_M = 0.0001  # of the numbers in the file
MERIDIANS = 32  # directions around a part's axis: a circle's polygon reaches 0.5 % beyond it
PARALLELS = 11  # circles of them between the axis's two directions, 15 degrees apart


@dataclass(frozen=True, eq=False)
class Extent:
    """A part of an arm.

    Attributes:
        name: of its capsule.
        frame: DH frame in which it is given; its joint's next position turns it about that frame's z at most.
        axis: coordinate that its directions are arranged about.
        lengths: extents (k,) along the `directions` about that axis [m].
    """

    name: str
    frame: int
    axis: int
    lengths: Vector

    def corners(self) -> Vector:
        """Returns the corners (n, 3) of the polytope in the frame [m]."""
        n = directions(self.axis)
        # The centre of the largest ball within is as far inside as can be.
        rows = np.hstack([n, np.ones((len(n), 1))])
        inside = linprog([0.0, 0.0, 0.0, -1.0], rows, self.lengths, bounds=[(None, None)] * 3 + [(0.0, None)]).x[:3]
        return HalfspaceIntersection(np.hstack([n, -self.lengths[:, None]]), inside).intersections


@cache
def directions(axis: int) -> Vector:
    """Returns the unit vectors (k, 3) in which parts about an axis are measured."""
    polar = np.linspace(0.0, np.pi, PARALLELS + 2)[1:-1]
    around = 2.0 * np.pi * np.arange(MERIDIANS) / MERIDIANS
    theta, phi = (each.ravel() for each in np.meshgrid(polar, around, indexing="ij"))
    ring = np.stack([np.cos(theta), np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)], axis=1)
    both = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    return np.roll(np.concatenate([both, ring]), axis, axis=1)


def extents(robot: Robot, capsules: Sequence[FittedCapsule], surface: Mapping[str, Vector]) -> list[Extent]:
    """Returns the parts of an arm with a surface of triangles (n, 3, 3), one a capsule; those of joints at 0."""
    X = link_poses(robot, np.zeros(6))
    fine = {link: split(triangles, SPACING_M) for link, triangles in surface.items()}
    found = []
    for capsule, part in zip(capsules, parts(robot, list(capsules), fine), strict=True):
        frame = capsule.first.frame
        axis = int(np.argmax(capsule.first.direction))
        lengths = np.full(len(directions(axis)), -np.inf)
        for link, triangles in part.items():
            X_CL = np.linalg.inv(X[frame]) @ X[LINKS.index(link)]
            x = triangles.reshape(-1, 3) @ X_CL[:3, :3].T + X_CL[:3, 3]
            lengths = np.maximum(lengths, (directions(axis) @ x.T).max(axis=1, initial=-np.inf))
        found.append(Extent(capsule.first.name, frame, axis, np.ceil(lengths / UNIT_M) * UNIT_M))
    return found


def write(found: Mapping[str, Sequence[Extent]], source: str) -> None:
    """Writes the parts of every arm to `FILE`."""
    arms = {arm: {part.name: _document(part) for part in own} for arm, own in found.items()}
    lines = ",\n".join(
        f' "{arm}": {{\n' + ",\n".join(f'  "{name}": {json.dumps(part)}' for name, part in own.items()) + "\n }"
        for arm, own in arms.items()
    )
    FILE.write_text(f'{{\n "source": {json.dumps(source)},\n "unit_m": {UNIT_M},\n{lines}\n}}\n', encoding="utf-8")


def _document(part: Extent) -> dict[str, Any]:
    lengths = np.rint(part.lengths / UNIT_M).astype(int).tolist()
    return {"frame": part.frame, "axis": part.axis, "lengths": lengths}


def measured_arms() -> list[str]:
    """Returns the names of the arms that have capsules of their own, measured on their meshes.

    The others have those of an arm with the same meshes, or an estimate: see `shape` of `Robot`.
    """
    return [name for name in ROBOT_NAMES if robot(name).shape.of == name]


@cache
def measured(arm: str) -> tuple[Extent, ...]:
    """Returns the parts of an arm as they are in `FILE`."""
    document = json.loads(FILE.read_text(encoding="utf-8"))
    return tuple(
        Extent(name, part["frame"], part["axis"], document["unit_m"] * np.array(part["lengths"]))
        for name, part in document[arm].items()
    )
