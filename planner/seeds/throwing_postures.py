"""Postures drawn for targets, around the start: clear of singularities, with the tool within the surroundings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from planner.arrays import Array, Mask, read_only
from planner.cell import Cell
from planner.geometry import tool_pose
from planner.kinematics import singularity_distances
from planner.problem import ThrowProblem
from planner.seeds.quasi_random import joint_offsets

POSTURES = 512  # postures tried for a target
MORE_POSTURES = 16384  # postures tried where those leave too few that are slow enough, or clear of walls
EXPONENTS = {POSTURES: 1.5, MORE_POSTURES: 1.0}  # the soonest throws are close to the start; more are looked for evenly
POSTURES_KEPT = 8  # draws cached: two for each start of late


def throwing_postures(problem: ThrowProblem, count: int) -> tuple[Array, Array]:
    """Returns those of `count` postures q (n, 6) that are clear of singularities, and their tool positions (n, 3) [m].

    The tool is within the surroundings.
    """
    return _throwing_postures(_PostureKey.of(problem, count))


def throwing(cell: Cell, q: Array, p: Array, singularity_distance_min: float) -> Mask:
    """Returns the mask of the postures (n, 6), tool at p (n, 3), within the surroundings and clear of singularities."""
    return _inside(cell, p) & (singularity_distances(cell.robot, q).minimum >= singularity_distance_min)


@dataclass(frozen=True)
class _PostureKey:
    """What the postures drawn for targets depend on."""

    cell: Cell
    start: bytes
    q_limits: bytes
    singularity_distance_min: float
    count: int

    @staticmethod
    def of(problem: ThrowProblem, count: int) -> _PostureKey:
        """Returns the key of `count` postures for a problem."""
        limits = problem.reachable
        bounds = np.stack([limits.q_lower, limits.q_upper]).tobytes()
        return _PostureKey(problem.cell, problem.start.tobytes(), bounds, limits.singularity_distance_min, count)


@lru_cache(maxsize=POSTURES_KEPT)
def _throwing_postures(key: _PostureKey) -> tuple[Array, Array]:
    """Returns postures q (n, 6) clear of singularities, and their tool positions (n, 3) within the surroundings."""
    lower, upper = np.frombuffer(key.q_limits).reshape(2, 6)
    q = np.clip(
        np.clip(np.frombuffer(key.start), lower, upper) + joint_offsets(key.count, EXPONENTS[key.count]), lower, upper
    )
    p = tool_pose(key.cell, q)[:, :3, 3]
    allowed = throwing(key.cell, q, p, key.singularity_distance_min)
    return read_only(q[allowed]), read_only(p[allowed])


def _inside(cell: Cell, p: Array) -> Mask:
    """Returns the mask of the positions (n, 3) above the floor, in all keep-in and out of all keep-out shapes."""
    around = cell.surroundings
    ok = p[:, 2] > around.floor_z_m + around.clearance_m + cell.object.radius_m
    for room, clearance_m in zip(around.keep_in, around.keep_in_clearances, strict=True):
        ok &= room.depth(p) >= clearance_m
    for shape in around.keep_out:
        ok &= shape.depth(p) < 0.0
    return ok
