"""The closest thing that can be done: a share of the asked speed, or a place nearer by, found by bisection.

Nothing is returned that was not certified. Where the place itself is out of reach it is moved towards the arm; where
the speed is too much it is reduced; at last the whole release is drawn towards the start, where something always goes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from planner.errors import Violation
from planner.kinematics import forward
from planner.problem import JointRelease, PointRelease, PoseRelease, Release, TargetRelease, ThrowProblem
from planner.rotations import matrix_to_rotation_vector, pose, rotation_vector_to_matrix
from planner.search.anchors import anchors, moved
from planner.seeds.sampling import farthest_reach

Vector = NDArray[np.float64]
Certifiable = Callable[[ThrowProblem, bool], bool]  # told whether a thorough look is worth it
Way = Callable[[float], Release]  # from all given up at 0 to as asked, or as near to it as can be, at 1

BISECTIONS = 6  # the share is found to 1/64
LEAST_SHARE = 0.02  # [-] of what was asked; the first thing tried
SLOWER = (0.3, 0.05)  # [-] of the asked speed, tried in other places where the full speed goes in none
OF_THE_PLACE = (
    "reach",
    "joint_position",
    "floor",
    "keep_in",
    "keep_out",
    "self_collision",
)  # not cured by slowing down
UNDER_M = 0.2  # from under the tool at the start, towards the target: an easy throw
COMFORTABLE_REACH = 0.6  # [-] of the arm's: places there have many postures


def nearest_release(
    problem: ThrowProblem, violations: list[Violation], certifiable: Certifiable, deadline_s: float
) -> Release | None:
    """Returns the release closest to the asked one that `certifiable` accepts, None where none was found in time.

    Args:
        problem: which cannot be solved.
        violations: why.
        certifiable: whether a problem has a certified answer.
        deadline_s: on `time.perf_counter`'s clock [s].
    """
    for towards, thorough in _ways(problem, violations):
        release = _farthest(problem, towards, certifiable, thorough, deadline_s)
        if release is not None or time.perf_counter() > deadline_s:
            return release
    return None


def _ways(problem: ThrowProblem, violations: list[Violation]) -> Iterator[tuple[Way, bool]]:
    """Yields the ways to give in, the gentler first, and whether each is worth a thorough look."""
    release = problem.release
    if isinstance(release, TargetRelease):
        yield from ((way, True) for way in _nearer_targets(problem, release))
        return
    if not problem.ends_at_rest and not any(v.constraint in OF_THE_PLACE for v in violations):
        yield partial(_slower, release), True
    if isinstance(release, PoseRelease | PointRelease):
        yield from ((way, False) for way in _elsewhere(problem, release))
    if isinstance(release, PoseRelease):  # without the orientation: a point with the same velocity
        point = PointRelease(release.X_WT[:3, 3], release.V_WT[:3])
        yield from ((way, False) for way in _elsewhere(problem, point))
    yield partial(_homeward, problem, release), True


def _slower(release: Release, share: float) -> Release:
    share = max(share, LEAST_SHARE)
    match release:
        case JointRelease(q, qd):
            return JointRelease(q, share * qd)
        case PoseRelease(X, V):
            return PoseRelease(X, share * V)
        case PointRelease(p, v):
            return PointRelease(p, share * v)
    return release


def _elsewhere(problem: ThrowProblem, release: PoseRelease | PointRelease) -> Iterator[Way]:
    """Yields ways from other places towards the one asked for, with the velocity asked for while that goes."""
    asked = release.p_WT if isinstance(release, PointRelease) else release.X_WT[:3, 3]
    farthest = _within(problem.cell.X_WB[:3, 3], asked, farthest_reach(problem))
    for speed in (1.0, *SLOWER):
        slowed = _slower(release, speed)
        assert isinstance(slowed, PoseRelease | PointRelease)
        for anchor in anchors(problem, slowed):
            place = anchor.p_WT if isinstance(anchor, PointRelease) else anchor.X_WT[:3, 3]
            yield partial(_towards, slowed, place, farthest)


def _towards(release: PoseRelease | PointRelease, near: Vector, far: Vector, share: float) -> Release:
    return moved(release, _between(near, far, share))


def _homeward(problem: ThrowProblem, release: Release, share: float) -> Release:
    """Returns the release drawn towards standing at the start."""
    share, cell = max(share, LEAST_SHARE), problem.cell
    X_W0 = cell.X_WB @ forward(cell.robot, problem.start, cell.tool.X_FT)
    match release:
        case JointRelease(q, qd):
            return JointRelease(_between(problem.start, q, share), share * qd)
        case PointRelease(p, v):
            return PointRelease(_between(X_W0[:3, 3], p, share), share * v)
        case PoseRelease(X, V):
            turn = share * matrix_to_rotation_vector(X[:3, :3] @ X_W0[:3, :3].T)
            R_WT = rotation_vector_to_matrix(turn) @ X_W0[:3, :3]
            return PoseRelease(pose(_between(X_W0[:3, 3], X[:3, 3], share), R_WT), share * V)
    return release


def _farthest(
    problem: ThrowProblem, towards: Way, certifiable: Certifiable, thorough: bool, deadline_s: float
) -> Release | None:
    """Bisects the largest share that can be certified; a way on which not even a little can be is left at once."""
    found = towards(0.0)
    if not certifiable(replace(problem, release=found), thorough):
        return None
    good, bad = 0.0, 1.0
    for _ in range(BISECTIONS):
        if time.perf_counter() > deadline_s:
            break
        share = (good + bad) / 2.0
        release = towards(share)
        if certifiable(replace(problem, release=release), False):
            good, found = share, release
        else:
            bad = share
    return found


def _nearer_targets(problem: ThrowProblem, release: TargetRelease) -> Iterator[Way]:
    """Yields ways from places that are easily hit: in the target's direction, in the tool's, under the tool."""
    cell, farthest = problem.cell, _farthest_throw(problem, release)
    tool = (cell.X_WB @ forward(cell.robot, problem.start, cell.tool.X_FT))[:3, 3]
    under = np.array([*_within(tool[:2], release.p_W[:2], UNDER_M), release.p_W[2]])
    releases = [release] if release.release_position is None else [release, replace(release, release_position=None)]
    for asked in releases:
        for direction in (release.p_W, tool):
            yield partial(_target_between, asked, _comfortable(problem, direction, release.p_W[2]), farthest)
        yield partial(_target_between, asked, under, farthest)


def _target_between(release: TargetRelease, near: Vector, far: Vector, share: float) -> Release:
    return replace(release, p_W=_between(near, far, share))


def _comfortable(problem: ThrowProblem, direction: Vector, height: float) -> Vector:
    """Returns a place in a direction, at a height, over which the arm reaches with ease."""
    cell = problem.cell
    base, reach = cell.X_WB[:3, 3], COMFORTABLE_REACH * farthest_reach(problem)
    away = direction[:2] - base[:2]
    length = float(np.linalg.norm(away))
    along = away / length if length > 1e-6 else np.array([1.0, 0.0])
    return np.array([*(base[:2] + along * reach), min(height, base[2] + cell.robot.d[0] + reach)])


def _farthest_throw(problem: ThrowProblem, release: TargetRelease) -> Vector:
    """Returns the target, or the place before it beyond which no speed within the limits throws from any place.

    Source: range of a throw from height h at speed v, v/g sqrt(v^2 + 2 g h).
    """
    base, reach, g = problem.cell.X_WB[:3, 3], farthest_reach(problem), problem.gravity
    v = min(problem.limits.tcp_speed_max, release.max_speed_m_s)
    height = max(base[2] + reach - release.p_W[2], 0.0)
    near = np.array([*base[:2], release.p_W[2]])
    return _within(near, release.p_W, reach + v / g * np.sqrt(v * v + 2.0 * g * height))


def _within(centre: Vector, p: Vector, radius: float) -> Vector:
    """Returns `p`, or the place before it that is `radius` from the centre."""
    away = float(np.linalg.norm(p - centre))
    return p if away <= radius else centre + (p - centre) * radius / away


def _between(near: Vector, far: Vector, share: float) -> Vector:
    return near + share * (far - near)
