"""The door: a request of `POST /plan`, already of the right shape, becomes a checked `ThrowProblem`.

Every refusal names the field, the value and the limit, and all of them are reported together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.cell import Cell, Limits
from planner.errors import FieldError, InvalidProblem
from planner.problem import JointRelease, PointRelease, PoseRelease, Release, TargetRelease, ThrowProblem
from planner.rotations import pose, quaternion_to_matrix, rotation_vector_to_matrix

Vector = NDArray[np.float64]

UNIT_TOLERANCE = 1e-3  # [-] a quaternion this close to unit length is normalised; anything else is refused
WINDOW_MAX_S = 0.2  # a release window longer than this is no window
JITTER_DEVIATIONS = 3.0  # [-] of the gripper's delay that the default window spans: 99.7 % of normal releases
ROBUST_TOLERANCE_M = 0.01  # [m] default for a gripper that scatters: the contract's own example
LIMIT_FIELDS = {
    "velocity": ("qd_max", "rad/s"),
    "acceleration": ("qdd_max", "rad/s^2"),
    "jerk": ("jerk_max", "rad/s^3"),
}


def problem_from_request(request: Mapping[str, Any], cell: Cell) -> ThrowProblem:
    """Returns the problem a request states for `cell`; `start: {"current": true}` must have been resolved before.

    Raises:
        InvalidProblem: every refused field with its reason.
    """
    errors: list[FieldError] = []
    start = _start(request.get("start"), cell, errors)
    limits = _limits(request, cell, errors)
    release = _release(request.get("release"), cell, request.get("frame", "world"), errors)
    window, tolerance = _window(request, release, cell, errors)
    if errors:
        raise InvalidProblem(errors)
    return ThrowProblem(
        cell=cell,
        start=start,
        release=release,
        limits=limits,
        release_window_s=window,
        landing_tolerance_m=tolerance,
        backend=str(request.get("backend") or "auto"),
        time_limit_s=_number(request, "time_limit_s", errors, -np.inf, np.inf, 5.0),
    )


def _window(request: Mapping[str, Any], release: Any, cell: Cell, errors: list[FieldError]) -> tuple[float, float]:
    """Returns release window [s] and landing tolerance [m]; of a target, those of the cell's gripper by default."""
    scatters = isinstance(release, TargetRelease) and cell.gripper.jitter_s > 0.0
    default = min(JITTER_DEVIATIONS * cell.gripper.jitter_s, WINDOW_MAX_S) if scatters else 0.0
    window = _number(request, "release_window_s", errors, 0.0, WINDOW_MAX_S, default)
    tolerance = _number(request, "landing_tolerance_m", errors, 0.0, 10.0, ROBUST_TOLERANCE_M if scatters else 0.0)
    return window, tolerance


def _start(start: Any, cell: Cell, errors: list[FieldError]) -> Vector:
    if start is None:
        return cell.home
    if not isinstance(start, Mapping) or "positions" not in start:
        errors.append(FieldError("start", 'must be {"positions": [6]} or {"current": true}'))
        return cell.home
    return _vector(start, "positions", 6, "start.", errors)


def _limits(request: Mapping[str, Any], cell: Cell, errors: list[FieldError]) -> Limits:
    own, changed = cell.limits, {}
    for key, value in (request.get("limits") or {}).items():
        if value is None:
            continue
        if key not in LIMIT_FIELDS:
            errors.append(FieldError(f"limits.{key}", f"unknown; known are {', '.join(LIMIT_FIELDS)}"))
            continue
        name, unit = LIMIT_FIELDS[key]
        changed[name] = _tightened(f"limits.{key}", value, getattr(own, name), unit, errors)
    distance = request.get("singularity_distance_min")
    if distance is not None:
        changed["singularity_distance_min"] = _singularity(distance, own, errors)
    return replace(own, **changed)


def _tightened(field: str, value: Any, own: Vector, unit: str, errors: list[FieldError]) -> Vector:
    entries = np.asarray(value if isinstance(value, list | tuple) else [value] * len(own))
    if entries.shape != own.shape or entries.dtype.kind not in "fiu" or not np.isfinite(entries).all():
        errors.append(FieldError(field, f"must be one finite number or {len(own)} of them"))
        return own
    for i, (entry, limit) in enumerate(zip(entries, own, strict=True)):
        if entry <= 0.0:
            errors.append(FieldError(f"{field}[{i}]", f"{entry:g} must be above 0"))
        elif entry > limit:
            errors.append(FieldError(f"{field}[{i}]", f"{entry:g} {unit} loosens the cell's limit of {limit:g} {unit}"))
    frozen = entries.astype(float)
    frozen.setflags(write=False)
    return frozen


def _singularity(value: Any, own: Limits, errors: list[FieldError]) -> float:
    field, least = "singularity_distance_min", own.singularity_distance_min
    if not isinstance(value, int | float) or not np.isfinite(value) or value > 1.0:
        errors.append(FieldError(field, f"{value} must be a number up to 1"))
    elif value < least:
        errors.append(FieldError(field, f"{value:g} loosens the cell's limit of {least:g}"))
    return float(value)


def _release(release: Any, cell: Cell, frame: Any, errors: list[FieldError]) -> Release | Any:
    if frame not in ("world", "base"):
        errors.append(FieldError("frame", f'{frame!r} is not "world" or "base"'))
    X = cell.X_WB if frame == "base" else np.eye(4)
    kind = release.get("kind") if isinstance(release, Mapping) else None
    readers = {"pose": _pose_release, "point": _point_release, "joint": _joint_release, "target": _target_release}
    if kind not in readers:
        errors.append(FieldError("release.kind", f"{kind!r} is not one of {', '.join(readers)}"))
        return None
    return readers[kind](release, X, errors)


def _joint_release(release: Mapping[str, Any], X: Vector, errors: list[FieldError]) -> JointRelease:
    q = _vector(release, "positions", 6, "release.", errors)
    return JointRelease(q, _vector(release, "velocities", 6, "release.", errors))


def _pose_release(release: Mapping[str, Any], X: Vector, errors: list[FieldError]) -> PoseRelease:
    given, twist = release.get("pose") or {}, release.get("twist") or {}
    p = _vector(given, "position", 3, "release.pose.", errors)
    linear = _vector(twist, "linear", 3, "release.twist.", errors)
    angular = _vector(twist, "angular", 3, "release.twist.", errors)
    X_XT = pose(p, _rotation(given, errors))
    return PoseRelease(X @ X_XT, np.concatenate([X[:3, :3] @ linear, X[:3, :3] @ angular]))


def _rotation(given: Mapping[str, Any], errors: list[FieldError]) -> Vector:
    field = "release.pose"
    if (given.get("quaternion") is None) == (given.get("rotation_vector") is None):
        errors.append(FieldError(field, "needs either quaternion or rotation_vector"))
        return np.eye(3)
    if given.get("rotation_vector") is not None:
        return rotation_vector_to_matrix(_vector(given, "rotation_vector", 3, f"{field}.", errors))
    quaternion = _vector(given, "quaternion", 4, f"{field}.", errors)
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        errors.append(FieldError(f"{field}.quaternion", f"has length {length:g}, must be 1"))
        return np.eye(3)
    return quaternion_to_matrix(quaternion / length)


def _point_release(release: Mapping[str, Any], X: Vector, errors: list[FieldError]) -> PointRelease:
    p = _vector(release, "position", 3, "release.", errors)
    v = _vector(release, "velocity", 3, "release.", errors)
    return PointRelease(X[:3, :3] @ p + X[:3, 3], X[:3, :3] @ v)


def _target_release(release: Mapping[str, Any], X: Vector, errors: list[FieldError]) -> TargetRelease:
    p = _vector(release, "position", 3, "release.", errors)
    half = np.pi / 2
    place = release.get("release_position")
    return TargetRelease(
        p_W=X[:3, :3] @ p + X[:3, 3],
        max_speed_m_s=_number(release, "max_release_speed_m_s", errors, 1e-3, np.inf, np.inf, "release."),
        min_elevation_rad=_number(release, "min_elevation_rad", errors, -half, half, -half, "release."),
        max_elevation_rad=_number(release, "max_elevation_rad", errors, -half, half, half, "release."),
        min_horizontal_distance_m=_number(release, "min_horizontal_distance_m", errors, 0.0, np.inf, 0.0, "release."),
        release_position=None
        if place is None
        else X[:3, :3] @ _vector(release, "release_position", 3, "release.", errors) + X[:3, 3],
    )


def _vector(table: Mapping[str, Any], key: str, size: int, where: str, errors: list[FieldError]) -> Vector:
    value = table.get(key)
    array = np.asarray(value) if isinstance(value, list | tuple | np.ndarray) else np.zeros(0)
    if array.shape != (size,) or array.dtype.kind not in "fiu":
        errors.append(FieldError(where + key, f"must be a list of {size} numbers"))
        return np.zeros(size)
    if not np.isfinite(array).all():
        errors.append(FieldError(where + key, "must be finite"))
        return np.zeros(size)
    frozen = array.astype(float)
    frozen.setflags(write=False)
    return frozen


def _number(
    table: Mapping[str, Any],
    key: str,
    errors: list[FieldError],
    lower: float,
    upper: float,
    default: float,
    where: str = "",
) -> float:
    value = table.get(key)
    if value is None:
        return default
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        errors.append(FieldError(where + key, f"{value!r} must be a finite number"))
        return default
    if not lower <= value <= upper:
        errors.append(FieldError(where + key, f"{value:g} must lie in [{lower:g}, {upper:g}]"))
    return float(value)
