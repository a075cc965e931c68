"""Feasibility of a joint state by itself, without a motion: limits of distance, speed and singularity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.cell import Cell
from planner.geometry import (
    SELF_CLEARANCE_M,
    body_capsules,
    capsule_endpoints,
    segment_segment_distance,
    self_collision_pairs,
)
from planner.kinematics import forward, jacobian, singularity_distances

Vector = NDArray[np.float64]


AROUND_S = np.linspace(-0.05, 0.05, 5)  # [s] the certificate checks the singularity distance within ±50 ms


def allowed(cell: Cell, q: Vector, qd: Vector) -> bool:
    """Returns whether a joint state is feasible with respect to floor, arm, singularities and tool speed.

    Args:
        cell: The cell.
        q: Joint positions (6,) [rad].
        qd: Joint velocities (6,) [rad/s]; positions on their straight line within ±50 ms are checked too.
    """
    near = q + AROUND_S[:, None] * qd
    if singularity_distances(cell.robot, near).minimum.min() < cell.limits.singularity_distance_min:
        return False
    if np.linalg.norm(tool_velocity(cell, q, qd)) > cell.limits.tcp_speed_max:
        return False
    return height(cell, near) >= cell.surroundings.clearance_m and self_distance(cell, near) >= SELF_CLEARANCE_M


def tool_velocity(cell: Cell, q: Vector, qd: Vector) -> Vector:
    """Returns the velocity (3,) of the tool centre point in the world [m/s]."""
    return cell.X_WB[:3, :3] @ (jacobian(cell.robot, q, cell.tool.X_FT)[:3] @ qd)


def tool_position(cell: Cell, q: Vector) -> Vector:
    """Returns the tool centre point (..., 3) in the world [m]."""
    return (cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT))[..., :3, 3]


def height(cell: Cell, q: Vector) -> float:
    """Returns the smallest height of arm, tool and object above the floor [m], over q (..., 6)."""
    capsules = [c for c in body_capsules(cell.robot, cell.tool.capsules) if c.frame > 0]
    ends = capsule_endpoints(cell.robot, capsules, q, cell.X_WB)
    lowest = (ends[..., 2].min(axis=-1) - [c.radius_m for c in capsules]).min()
    held_object = tool_position(cell, q)[..., 2].min() - cell.object.radius_m
    return float(min(lowest, held_object)) - cell.surroundings.floor_z_m


def self_distance(cell: Cell, q: Vector) -> float:
    """Returns the smallest distance between capsules that can collide [m], over q (..., 6)."""
    capsules = body_capsules(cell.robot, cell.tool.capsules)
    pairs = np.array(self_collision_pairs(cell.robot, cell.tool.capsules))
    ends = capsule_endpoints(cell.robot, capsules, q)
    one = ends[..., pairs[:, 0], :, :]
    other = ends[..., pairs[:, 1], :, :]
    radius = np.array([c.radius_m for c in capsules])
    gap = segment_segment_distance(one[..., 0, :], one[..., 1, :], other[..., 0, :], other[..., 1, :])
    return float((gap - radius[pairs].sum(axis=1)).min())


def pose_and_twist(cell: Cell, q: Vector, qd: Vector) -> tuple[Vector, Vector]:
    """Returns the tool's pose (4, 4) and twist (6,) in the world."""
    X_WT = cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT)
    V_BT = jacobian(cell.robot, q, cell.tool.X_FT) @ qd
    R_WB = cell.X_WB[:3, :3]
    return X_WT, np.concatenate([R_WB @ V_BT[:3], R_WB @ V_BT[3:]])
