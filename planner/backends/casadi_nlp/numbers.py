"""A cell's and a request's numbers in the order of `layout`."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from planner.backends.casadi_nlp.layout import (
    ABSENT_BOX,
    ABSENT_RADIUS,
    ARM,
    BOXES,
    CAPSULE_FRAMES,
    FAR,
    FIRST_TOOL,
    KEEP_OUT,
    OBJECT,
    PAIRS,
    RELEASE,
    TOOL_CAPSULES,
)
from planner.backends.casadi_nlp.margins import Margins
from planner.cell import Cell, Limits
from planner.geometry import SELF_CLEARANCE_M, arm_capsules, self_collision_pairs
from planner.kinematics import SINGULARITIES, signed_singularity_distances
from planner.problem import TargetRelease, ThrowProblem
from planner.robots import Robot

Vector = NDArray[np.float64]

CELLS_KEPT = 32  # cells whose numbers are remembered
UNBOUNDED = 1.0e3  # [m, m/s] stands for a bound that is not there


NO_MARGINS = Margins(torque=1.0, tcp_speed=1.0, floor_m=0.0, self_m=0.0, keep_in_m=0.0, box_m=0.0, singularity=1.0)


def arm_numbers(cell: Cell, limits: Limits, margins: Margins = NO_MARGINS) -> Vector:
    """Returns the `ARM` vector, with the margins added to every clearance asked for."""
    vector = _cell_numbers(cell).copy()
    piece = ARM.split(vector)
    piece["torque"][:] = limits.tau_max
    piece["speed"][:] = limits.tcp_speed_max
    piece["floor"][:] = cell.surroundings.floor_z_m + cell.surroundings.clearance_m + margins.floor_m
    piece["self_clearance"][:] = SELF_CLEARANCE_M + margins.self_m
    piece["keep_in"][:3] += margins.keep_in_m
    piece["keep_in"][3:] -= margins.keep_in_m
    return vector


@lru_cache(maxsize=CELLS_KEPT)
def _cell_numbers(cell: Cell) -> Vector:
    """Returns the `ARM` vector with those pieces that are the cell's alone; the others are 0."""
    robot, R_WB, boxes = cell.robot, cell.X_WB[:3, :3], cell.surroundings.keep_in
    lower = np.max([box.lower for box in boxes], axis=0) if boxes else np.full(3, -UNBOUNDED)
    upper = np.min([box.upper for box in boxes], axis=0) if boxes else np.full(3, UNBOUNDED)
    return ARM.pack(
        {
            "dh": np.array([robot.d[0], robot.a[1], robot.a[2], robot.d[3], robot.d[4], robot.d[5]]),
            "tcp": cell.tool.X_FT[:3, 3],
            "links": link_numbers(cell),
            "gravity": R_WB.T @ [0.0, 0.0, cell.surroundings.gravity_m_s2],
            "base": np.concatenate([R_WB.T.ravel(), cell.X_WB[:3, 3]]),
            "capsules": capsule_numbers(cell),
            "pairs": pair_numbers(cell),
            "keep_in": np.concatenate([lower, upper]),
            **dict.fromkeys(("torque", "speed", "floor", "self_clearance"), 0.0),
        }
    )


def link_numbers(cell: Cell) -> Vector:
    """Returns mass, first moment, inertia about the frame's origin of each link (60,), load in the last."""
    rows = [_about_origin(link.mass, link.com, link.inertia) for link in cell.robot.links]
    p_FT = cell.tool.X_FT[:3, 3]
    rows[-1] = rows[-1] + _about_origin(cell.tool.mass_kg, p_FT / 2.0, np.zeros((3, 3)))
    rows[-1] = rows[-1] + _about_origin(cell.object.mass_kg, p_FT, np.zeros((3, 3)))
    return np.concatenate(rows)


def _about_origin(mass: float, com: Vector, inertia: Vector) -> Vector:
    about = inertia + mass * (com @ com * np.eye(3) - np.outer(com, com))
    return np.concatenate([[mass], mass * com, about[np.triu_indices(3)]])


def capsule_numbers(cell: Cell) -> Vector:
    """Returns ends and radius of every slot of `CAPSULE_FRAMES` (77,)."""
    table = np.zeros((len(CAPSULE_FRAMES), 7))
    table[:, 6] = ABSENT_RADIUS
    for slot, c in enumerate(arm_capsules(cell.robot)[1:]):
        table[slot] = [*c.p0, *c.p1, c.radius_m]
    for slot, (p0, p1, radius) in enumerate(tool_capsules(cell), start=FIRST_TOOL):
        table[slot] = [*p0, *p1, radius]
    p = cell.tool.X_FT[:3, 3]
    table[OBJECT] = [*p, *p, cell.object.radius_m]
    return table.ravel()


def tool_capsules(cell: Cell) -> list[tuple[Vector, Vector, float]]:
    """Returns at most `TOOL_CAPSULES` capsules around the tool: its own, or the last one around all that are over."""
    own = [(c.from_m, c.to_m, c.radius_m) for c in cell.tool.capsules]
    if len(own) <= TOOL_CAPSULES:
        return own
    return [*own[: TOOL_CAPSULES - 1], _around(own[TOOL_CAPSULES - 1 :])]


def _around(capsules: list[tuple[Vector, Vector, float]]) -> tuple[Vector, Vector, float]:
    """Returns a capsule that holds the others, along the direction in which they lie."""
    points = np.array([end for p0, p1, _ in capsules for end in (p0, p1)])
    radii = np.repeat([radius for *_, radius in capsules], 2)
    centre = points.mean(axis=0)
    axis = np.linalg.svd(points - centre)[2][0]
    along = (points - centre) @ axis
    off = np.linalg.norm(points - centre - along[:, None] * axis, axis=1)
    return centre + along.min() * axis, centre + along.max() * axis, float((off + radii).max())


def pair_numbers(cell: Cell) -> Vector:
    """Returns 0 for the slots of `PAIRS` that can meet on this arm with this tool, FAR for the others."""
    can = {(i - 1, j - 1) for i, j in self_collision_pairs(cell.robot, cell.tool.capsules)}
    wrapped = len(cell.tool.capsules) > TOOL_CAPSULES
    last = FIRST_TOOL + TOOL_CAPSULES - 1
    if wrapped:
        can |= {(i, last) for i, j in can if j > last}
    return np.array([0.0 if pair in can else FAR for pair in PAIRS])


@lru_cache(maxsize=CELLS_KEPT)
def box_numbers(cell: Cell, margin_m: float = 0.0) -> Vector:
    """Returns the `BOXES` vector, not to be changed; boxes beyond `KEEP_OUT` are left to the certificate."""
    table = np.full((KEEP_OUT, 6), ABSENT_BOX)
    for row, box in zip(table, cell.surroundings.keep_out, strict=False):
        row[:] = [*box.lower, *box.upper]
    packed = BOXES.pack({"boxes": table.ravel(), "box_clearance": cell.surroundings.clearance_m + margin_m})
    packed.flags.writeable = False
    return packed


def singular_sides(robot: Robot, q: Vector) -> Vector:
    """Returns signed distances from elbow, wrist and shoulder singularities (3,), in block "singular"'s order."""
    distances = dict(zip(SINGULARITIES, signed_singularity_distances(robot, q), strict=True))
    return np.array([distances[name] for name in ("elbow", "wrist", "shoulder")])


def release_numbers(problem: ThrowProblem, target: Vector) -> Vector:
    """Returns the `RELEASE` vector for an aim (3,) [m]."""
    elevations = (-math.pi / 2, math.pi / 2)
    if isinstance(problem.release, TargetRelease):
        elevations = (problem.release.min_elevation_rad, problem.release.max_elevation_rad)
    slopes = [math.tan(e) if abs(e) < 1.57 else 0.0 for e in elevations]
    return RELEASE.pack({"target": target, "gravity_z": problem.gravity, "tan_elevation": slopes})
