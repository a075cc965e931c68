"""The closest thing that can be done: a share of the asked speed, or a place nearer by, found by bisection.

Nothing is returned that was not certified. Where the place itself is out of reach it is moved towards the arm; where
the speed is too much it is reduced.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import Violation
from planner.problem import JointRelease, PointRelease, PoseRelease, Release, TargetRelease, ThrowProblem
from planner.rotations import matrix_to_quaternion
from planner.sampling import farthest_reach

Vector = NDArray[np.float64]

BISECTIONS = 6  # the share is found to 1/64
LEAST_SHARE = 0.02  # [-] of what was asked; the first thing tried
OF_THE_PLACE = (
    "reach",
    "joint_position",
    "floor",
    "keep_in",
    "keep_out",
    "self_collision",
)  # not cured by slowing down
COMFORTABLE_REACH = 0.6  # [-] of the arm's: places there have many postures


def nearest_release(
    problem: ThrowProblem,
    violations: list[Violation],
    certifiable: Callable[[ThrowProblem], bool],
    deadline_s: float,
) -> Release | None:
    """Returns the release closest to the asked one that `certifiable` accepts, None where none was found in time.

    Args:
        problem: which cannot be solved.
        violations: why.
        certifiable: whether a problem has a certified answer.
        deadline_s: on `time.perf_counter`'s clock [s].
    """
    for towards in _ways(problem, violations):
        release = _farthest(problem, towards, certifiable, deadline_s)
        if release is not None:
            return release
    return None


def release_document(release: Release) -> dict[str, Any]:
    """Returns the release in the shape of `POST /plan`, in the world frame."""
    match release:
        case JointRelease(q, qd):
            return {"kind": "joint", "positions": q.tolist(), "velocities": qd.tolist()}
        case PoseRelease(X, V):
            pose = {"position": X[:3, 3].tolist(), "quaternion": matrix_to_quaternion(X[:3, :3]).tolist()}
            return {"kind": "pose", "pose": pose, "twist": {"linear": V[:3].tolist(), "angular": V[3:].tolist()}}
        case PointRelease(p, v):
            return {"kind": "point", "position": p.tolist(), "velocity": v.tolist()}
        case TargetRelease():
            return _target_document(release)


def request_document(problem: ThrowProblem, release: Release) -> Mapping[str, Any]:
    """Returns a request ready to be posted: the problem with another release."""
    limits = problem.limits
    return {
        "cell": problem.cell.name,
        "start": {"positions": problem.start.tolist()},
        "release": release_document(release),
        "frame": "world",
        "backend": problem.backend,
        "limits": {
            "velocity": limits.qd_max.tolist(),
            "acceleration": limits.qdd_max.tolist(),
            "jerk": limits.jerk_max.tolist(),
        },
        "singularity_distance_min": limits.singularity_distance_min,
        "release_window_s": problem.release_window_s,
        "landing_tolerance_m": problem.landing_tolerance_m,
        "time_limit_s": problem.time_limit_s,
    }


def _ways(problem: ThrowProblem, violations: list[Violation]) -> list[Callable[[float], Release]]:
    """Returns the ways to give in, each from 0 (all given up) to 1 (as asked), the gentler first."""
    release = problem.release
    if isinstance(release, TargetRelease):
        return [lambda share: replace(release, p_W=_between(_comfortable(problem, release.p_W), release.p_W, share))]
    slower = _slower(release)
    if not any(v.constraint in OF_THE_PLACE for v in violations) or isinstance(release, JointRelease):
        return [slower]
    ways = [_closer(problem, release), lambda share: _closer(problem, _slower(release)(share))(share)]
    if isinstance(release, PoseRelease):  # at last without the orientation: a point with the same velocity
        point = PointRelease(release.X_WT[:3, 3], release.V_WT[:3])
        ways.append(lambda share: _closer(problem, _slower(point)(share))(share))
    return ways


def _slower(release: Release) -> Callable[[float], Release]:
    def scaled(share: float) -> Release:
        match release:
            case JointRelease(q, qd):
                return JointRelease(q, share * qd)
            case PoseRelease(X, V):
                return PoseRelease(X, share * V)
            case PointRelease(p, v):
                return PointRelease(p, share * v)
        return release

    return scaled


def _closer(problem: ThrowProblem, release: Release) -> Callable[[float], Release]:
    def moved(share: float) -> Release:
        if isinstance(release, PoseRelease):
            X = release.X_WT.copy()
            X[:3, 3] = _between(_comfortable(problem, X[:3, 3]), X[:3, 3], share)
            return PoseRelease(X, release.V_WT)
        assert isinstance(release, PointRelease)
        return PointRelease(_between(_comfortable(problem, release.p_WT), release.p_WT, share), release.v_WT)

    return moved


def _farthest(
    problem: ThrowProblem,
    towards: Callable[[float], Release],
    certifiable: Callable[[ThrowProblem], bool],
    deadline_s: float,
) -> Release | None:
    """Bisects the largest share that can be certified; a way on which not even a little can be is left at once."""
    if not certifiable(replace(problem, release=towards(LEAST_SHARE))):
        return None
    good, bad, found = LEAST_SHARE, 1.0, towards(LEAST_SHARE)
    for _ in range(BISECTIONS):
        if time.perf_counter() > deadline_s:
            break
        share = (good + bad) / 2.0
        release = towards(share)
        if certifiable(replace(problem, release=release)):
            good, found = share, release
        else:
            bad = share
    return found


def _comfortable(problem: ThrowProblem, p_W: Vector) -> Vector:
    """Returns a place in the direction of `p_W` that the arm reaches with ease, at the height asked for if possible."""
    cell = problem.cell
    base, reach = cell.X_WB[:3, 3], COMFORTABLE_REACH * farthest_reach(problem)
    away = p_W[:2] - base[:2]
    length = float(np.linalg.norm(away))
    direction = away / length if length > 1e-6 else np.array([1.0, 0.0])
    shoulder = base[2] + cell.robot.d[0]
    height = (
        p_W[2]
        if isinstance(problem.release, TargetRelease)
        else float(np.clip(p_W[2], shoulder, shoulder + 0.5 * reach))
    )
    return np.array([*(base[:2] + direction * reach), min(height, shoulder + reach)])


def _between(near: Vector, far: Vector, share: float) -> Vector:
    return near + share * (far - near)


def _target_document(release: TargetRelease) -> dict[str, Any]:
    document: dict[str, Any] = {
        "kind": "target",
        "position": release.p_W.tolist(),
        "min_elevation_rad": release.min_elevation_rad,
        "max_elevation_rad": release.max_elevation_rad,
        "min_horizontal_distance_m": release.min_horizontal_distance_m,
    }
    if np.isfinite(release.max_speed_m_s):
        document["max_release_speed_m_s"] = release.max_speed_m_s
    if release.release_position is not None:
        document["release_position"] = release.release_position.tolist()
    return document
