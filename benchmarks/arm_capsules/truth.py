"""Distances to the arm itself, not to its capsules: to the polytopes around the parts of its meshes, by coal."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import coal
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.arm_capsules.extents import measured
from planner.cell import Cell
from planner.flight import fly, path
from planner.geometry import tool_state
from planner.kinematics import link_poses
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

STEP_S = 0.002  # between the instants of a flight that are looked at
BESIDE_OBJECT = ("wrist_2", "wrist_3")  # parts that the object is gripped beside
NEIGHBOURS_OF_TOOL = ("wrist_1", "wrist_2", "wrist_3")
_REQUEST = coal.DistanceRequest()


@cache
def solids(arm: str) -> dict[str, tuple[int, coal.Convex]]:
    """Returns the polytope of every part of an arm, in which DH frame it is given."""
    found = {}
    for part in measured(arm):
        points = coal.StdVec_Vec3s()
        points.extend(list(part.corners()))
        found[part.name] = part.frame, coal.Convex.convexHull(points, True, "Qt")
    return found


def sphere_gaps(cell: Cell, q: Vector, centre: Vector, radius: float) -> dict[str, float]:
    """Returns the distances [m] of a sphere in the world from the parts of the arm at `q` (6,); negative inside."""
    ball = coal.Sphere(radius)
    place = coal.Transform3s(np.eye(3), centre)
    return {name: _distance(solid, X, ball, place) for name, solid, X in _placed(cell, q)}


def tool_gaps(cell: Cell, q: Vector) -> dict[str, float]:
    """Returns the distances [m] of the tool's capsules from the parts of the arm that it can meet, at `q` (6,)."""
    X_WF = cell.X_WB @ link_poses(cell.robot, q)[6]
    found = {}
    for name, solid, X in _placed(cell, q):
        if name not in NEIGHBOURS_OF_TOOL:
            gaps = [_capsule_distance(solid, X, X_WF, c.from_m, c.to_m, c.radius_m) for c in cell.tool.capsules]
            found[name] = min(gaps, default=np.inf)
    return found


def flight_gaps(problem: ThrowProblem, motion: Trajectory, delay_s: float) -> dict[str, float]:
    """Returns the least distances [m] of the object from the parts of the braking arm while it flies.

    Args:
        problem: a throw.
        motion: whose flight it is.
        delay_s: of the release behind the plan.
    """
    cell = problem.cell
    released = motion.release_time_s + delay_s
    q, qd, *_ = motion.at(np.array([released]))
    tool = tool_state(cell, q[0], qd[0])
    v = problem.release_speed_factor * tool.v_WT
    flight = fly(tool.p_WT, v, problem.plane_z + problem.landing_radius_m, problem.gravity, problem.drag)
    until = flight.time_of_flight_s if flight is not None else 0.0
    s = np.arange(0.0, until, STEP_S)
    x = path(tool.p_WT, v, s, problem.gravity, problem.drag)
    postures = motion.at(np.minimum(released + s, motion.duration_s))[0]
    least = dict.fromkeys(solids(cell.robot.name), np.inf)
    for centre, posture in zip(x, postures, strict=True):
        for name, gap in sphere_gaps(cell, posture, centre, cell.object.radius_m).items():
            least[name] = min(least[name], gap)
    return {name: gap for name, gap in least.items() if name not in BESIDE_OBJECT}


def _placed(cell: Cell, q: Vector) -> Iterator[tuple[str, coal.Convex, coal.Transform3s]]:
    X_WL = cell.X_WB @ link_poses(cell.robot, q)
    for name, (frame, solid) in solids(cell.robot.name).items():
        yield name, solid, coal.Transform3s(X_WL[frame, :3, :3], X_WL[frame, :3, 3])


def _capsule_distance(
    solid: coal.Convex, X: coal.Transform3s, X_WF: Vector, start: Vector, end: Vector, radius: float
) -> float:
    """Returns the distance of a capsule with ends in the flange frame from a solid [m]."""
    along = end - start
    length = float(np.linalg.norm(along))
    middle = X_WF[:3, :3] @ (0.5 * (start + end)) + X_WF[:3, 3]
    turned = np.eye(3) if length == 0.0 else _frame_along(X_WF[:3, :3] @ along / length)
    return _distance(solid, X, coal.Capsule(radius, length), coal.Transform3s(turned, middle))


def _frame_along(z: Vector) -> Vector:
    """Returns a rotation (3, 3) whose third axis is a unit vector."""
    return np.asarray(Rotation.align_vectors(z[None], np.eye(3)[2:])[0].as_matrix())


def _distance(
    one: coal.CollisionGeometry, X: coal.Transform3s, other: coal.CollisionGeometry, Y: coal.Transform3s
) -> float:
    return float(coal.distance(one, X, other, Y, _REQUEST, coal.DistanceResult()))
