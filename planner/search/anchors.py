"""Releases near an impossible one that no bound forbids by itself: where a search for what can be done may begin.

A release in a place out of reach, or in which the arm may not stand, is moved: to the places nearest to it in which
some posture has the velocity asked for, is clear of everything, and far from singularities.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray

from planner.geometry import body_model
from planner.kinematics import forward, inverse_branches, inverse_velocity, jacobian, singularity_distances
from planner.problem import PointRelease, PoseRelease, ThrowProblem
from planner.rotations import invert_pose
from planner.seeds.sampling import farthest_reach, tool_jacobian
from planner.seeds.velocity_allocation import spread_velocity

Vector = NDArray[np.float64]

POSTURES = 1536  # drawn for a point
AROUND_RAD = np.array([np.pi, 1.8, 1.8, 2.2, 2.2, np.pi])  # from the start, either way
AZIMUTHS, RADII, HEIGHTS = 24, 10, 6  # of the places tried for a pose
NEAREST = 200  # of the places with the velocity asked for, looked at for clearance
ROOM_M = 0.03  # beyond every clearance, for the motion there and on
APART_M = 0.04  # between two places offered
OFFERED = 6


def anchors(problem: ThrowProblem, release: PoseRelease | PointRelease) -> Iterator[PoseRelease | PointRelease]:
    """Yields releases with the velocity asked for in other places, nearest first."""
    asked = release.p_WT if isinstance(release, PointRelease) else release.X_WT[:3, 3]
    q, p = _point_postures(problem, release) if isinstance(release, PointRelease) else _pose_postures(problem, release)
    order = np.argsort(np.linalg.norm(p - asked, axis=1), kind="stable")[:NEAREST]
    q, p = q[order], p[order]
    clear = body_model(problem.cell).clearances(q).least >= ROOM_M
    taken: list[Vector] = []
    for place in p[clear]:
        if len(taken) < OFFERED and all(np.linalg.norm(place - other) > APART_M for other in taken):
            taken.append(place)
            yield moved(release, place)


def moved(release: PoseRelease | PointRelease, place: Vector) -> PoseRelease | PointRelease:
    """Returns the same release in another place (3,)."""
    if isinstance(release, PointRelease):
        return PointRelease(place, release.v_WT)
    X_WT = release.X_WT.copy()
    X_WT[:3, 3] = place
    return PoseRelease(X_WT, release.V_WT)


def _point_postures(problem: ThrowProblem, release: PointRelease) -> tuple[Vector, Vector]:
    """Returns postures (n, 6) all round that can have the velocity, and the tool's places (n, 3)."""
    cell, limits = problem.cell, problem.reachable
    q = np.clip(problem.start + _offsets() * AROUND_RAD, limits.q_lower, limits.q_upper)
    q = q[_regular(problem, q)]
    qd = spread_velocity(tool_jacobian(problem, q), cell.X_WB[:3, :3].T @ release.v_WT, limits.qd_max)
    q = q[_slow_enough(problem, qd)]
    return q, (cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT))[:, :3, 3]


def _pose_postures(problem: ThrowProblem, release: PoseRelease) -> tuple[Vector, Vector]:
    """Returns postures (n, 6) in the orientation asked for that can have the twist, and the tool's places (n, 3)."""
    cell, limits = problem.cell, problem.reachable
    places = _places(problem, release.X_WT[:3, 3])
    X_WT = np.tile(release.X_WT, (len(places), 1, 1))
    X_WT[:, :3, 3] = places
    q, _ = inverse_branches(cell.robot, invert_pose(cell.X_WB) @ X_WT, cell.tool.X_FT)
    p, q = np.repeat(places, q.shape[1], axis=0), q.reshape(-1, 6)
    good = np.isfinite(q[:, 0])
    q, p = q[good], p[good]
    good = np.all((q >= limits.q_lower) & (q <= limits.q_upper), axis=1) & _regular(problem, q)
    q, p = q[good], p[good]
    R_BW = cell.X_WB[:3, :3].T
    V_BT = np.concatenate([R_BW @ release.V_WT[:3], R_BW @ release.V_WT[3:]])
    good = _slow_enough(problem, inverse_velocity(jacobian(cell.robot, q, cell.tool.X_FT), V_BT))
    return q[good], p[good]


def _places(problem: ThrowProblem, asked: Vector) -> Vector:
    """Returns places (n, 3) all round the arm, a row of them towards the one asked for."""
    cell, reach = problem.cell, farthest_reach(problem)
    base = cell.X_WB[:3, 3]
    away = asked - base
    angle = np.arctan2(away[1], away[0]) + np.linspace(-np.pi, np.pi, AZIMUTHS, endpoint=False)
    radius, height = np.linspace(0.2, 0.95, RADII) * reach, np.linspace(-0.3, 0.8, HEIGHTS) * reach
    angle, radius, height = (x.ravel() for x in np.meshgrid(angle, radius, height))
    return base + np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)


def _regular(problem: ThrowProblem, q: Vector) -> NDArray[np.bool_]:
    return singularity_distances(problem.cell.robot, q).minimum >= problem.limits.singularity_distance_min


def _slow_enough(problem: ThrowProblem, qd: Vector) -> NDArray[np.bool_]:
    return np.all(np.abs(qd) <= problem.limits.qd_max, axis=1)


@cache
def _offsets() -> Vector:
    """Returns points (POSTURES, 6) in [-1, 1], always the same."""
    offsets = np.random.default_rng(0).uniform(-1.0, 1.0, (POSTURES, 6))
    offsets.setflags(write=False)
    return offsets
