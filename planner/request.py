"""Requests of `POST /plan` as JSON documents: to a checked `ThrowProblem`, and back.

The service checks names and types of a request before (`api/schemas`); this module checks its meaning for a cell, and
`ThrowProblem` the relations between its fields. Callers of the library and stored plans do not pass the service, so a
value of the wrong shape is refused here too, when it is converted. Every refusal names the field, the value and the
limit; all refusals are reported together.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from planner.arrays import Array, read_only
from planner.cell import Cell, Limits
from planner.errors import FieldError, InvalidProblem, figures
from planner.problem import (
    TIME_LIMIT_S,
    JointRelease,
    Opening,
    PointRelease,
    PoseRelease,
    Release,
    TargetRelease,
    ThrowProblem,
)
from planner.rotations import (
    angle_between,
    beyond_full_turn,
    matrix_to_quaternion,
    pose,
    quaternion_to_matrix,
    rotation_vector_to_matrix,
)

__all__ = ["NUMBER_MAX", "problem_from_request", "release_document", "request_document"]


Number = int | float | np.integer | np.floating
NUMBER_MAX = 1e6  # of a request, in any unit: no robot has such a number, and squares and sums of them are finite
AGREEMENT_RAD = 1e-3  # [rad] by which two orientations of one pose may differ: somebody rounded them
UNIT_TOLERANCE = 1e-3  # [-] deviation of a quaternion's length from 1 up to which it is normalised
WINDOW_MAX_S = 0.2  # [s] longest release window
TOLERANCE_MAX_M = 10.0  # [m] largest landing tolerance
SPEED_MIN_M_S = 1e-3  # [m/s] lowest bound on the release speed
JITTER_DEVIATIONS = 3.0  # [-] default half width of the window in standard deviations: 99.7 % of normal delays
WINDOW_MIN_S = 0.005  # [s] least default half width: the scatter of a pneumatic or electric gripper; source: contract
ROBUST_TOLERANCE_M = 0.01  # [m] least default landing tolerance of a target without an opening
OPENING_MAX_M = 10.0  # [m] largest radius and rim height of a bin; catches typing errors
LIMIT_FIELDS = {
    "velocity": ("qd_max", "rad/s"),
    "acceleration": ("qdd_max", "rad/s^2"),
    "jerk": ("jerk_max", "rad/s^3"),
}
REQUEST_FIELDS = (
    "cell",
    "start",
    "release",
    "frame",
    "backend",
    "limits",
    "singularity_distance_min",
    "release_window_s",
    "landing_tolerance_m",
    "min_hit_probability",
    "time_limit_s",
)
RELEASE_FIELDS = {  # by kind
    "pose": ("kind", "pose", "twist"),
    "point": ("kind", "position", "velocity"),
    "joint": ("kind", "positions", "velocities"),
    "target": (
        "kind",
        "position",
        "max_release_speed_m_s",
        "min_elevation_rad",
        "max_elevation_rad",
        "min_horizontal_distance_m",
        "release_position",
        "opening",
    ),
}


def problem_from_request(request: Mapping[str, Any], cell: Cell) -> ThrowProblem:
    """Returns the problem that a request states for a cell.

    Args:
        request: JSON document of `POST /plan`; `start: {"current": true}` must have been resolved to positions.
        cell: the robot station; its limits and home are the defaults.

    Raises:
        InvalidProblem: every refused field with its reason.
    """
    fields = _Fields(request)
    fields.refuse_unknown(REQUEST_FIELDS)
    start = _start(fields, cell)
    limits = _limits(fields, cell.limits)
    release = _release(fields, cell)
    _refuse_odds(fields, release)
    window, tolerance = _window(fields, release, cell)
    time_limit = fields.number("time_limit_s", TIME_LIMIT_S)
    if fields.errors or release is None:
        raise InvalidProblem(fields.errors)
    return ThrowProblem(
        cell=cell,
        start=start,
        release=release,
        limits=limits,
        release_window_s=window,
        landing_tolerance_m=tolerance,
        backend=str(fields.get("backend") or "auto"),
        time_limit_s=time_limit,
    )


def request_document(problem: ThrowProblem, release: Release) -> dict[str, Any]:
    """Returns the request that states `problem` with another release, in the shape of `POST /plan`."""
    limits = problem.limits
    return {
        "cell": problem.cell.name,
        "start": {"positions": problem.start.tolist()},
        "release": release_document(release),
        "frame": "world",
        "backend": problem.backend,
        "limits": {name: getattr(limits, attribute).tolist() for name, (attribute, _) in LIMIT_FIELDS.items()},
        "singularity_distance_min": limits.singularity_distance_min,
        "release_window_s": problem.release_window_s,
        "landing_tolerance_m": problem.landing_tolerance_m,
        "time_limit_s": problem.time_limit_s,
    }


def release_document(release: Release) -> dict[str, Any]:
    """Returns a release in the shape of `POST /plan`, in the world frame."""
    match release:
        case JointRelease(q, qd):
            return {"kind": "joint", "positions": q.tolist(), "velocities": qd.tolist()}
        case PoseRelease(X, V):
            X_WT = {"position": X[:3, 3].tolist(), "quaternion": matrix_to_quaternion(X[:3, :3]).tolist()}
            return {"kind": "pose", "pose": X_WT, "twist": {"linear": V[:3].tolist(), "angular": V[3:].tolist()}}
        case PointRelease(p, v):
            return {"kind": "point", "position": p.tolist(), "velocity": v.tolist()}
        case TargetRelease():
            return _target_document(release)


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
    if release.opening is not None:
        document["opening"] = asdict(release.opening)
    return document


class _Fields:
    """One JSON object of a request. Refused fields are collected in `errors`, which nested objects share."""

    def __init__(self, values: Any, path: str = "", errors: list[FieldError] | None = None) -> None:
        self.values = values if isinstance(values, Mapping) else {}
        self.path = path
        self.errors: list[FieldError] = [] if errors is None else errors

    def get(self, key: str) -> Any:
        """Returns a field's value, None where it is absent."""
        return self.values.get(key)

    def nested(self, key: str) -> _Fields:
        """Returns the object in a field, an empty one where it is absent."""
        return _Fields(self.get(key), f"{self.path}{key}.", self.errors)

    def refuse(self, key: str, reason: str) -> None:
        """Records that a field is refused."""
        self.errors.append(FieldError(self.path + key, reason))

    def refuse_unknown(self, known: Collection[str]) -> None:
        """Records every field that is not one of the `known` ones as refused."""
        for key in self.values:
            if key not in known:
                self.refuse(str(key), f"unknown; known are {', '.join(known)}")

    def vector(self, key: str, size: int) -> Array:
        """Returns a list of finite numbers as a read-only array (size,), zeros where it is refused."""
        value = self.get(key)
        entries = value if isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim) else ()
        are_numbers = all(isinstance(entry, Number) and not isinstance(entry, bool) for entry in entries)
        array = np.asarray(entries if are_numbers else ())
        fits = array.shape == (size,) and array.dtype.kind in "fiu"
        if not fits or not (np.abs(array.astype(float)) <= NUMBER_MAX).all():
            self.refuse(key, f"must be {f'finite and within {NUMBER_MAX:g}' if fits else f'a list of {size} numbers'}")
            return np.zeros(size)
        return read_only(array)

    def number(self, key: str, default: float, lower: float = -np.inf, upper: float = np.inf) -> float:
        """Returns a finite number within [lower, upper], `default` where it is absent."""
        if (value := self.get(key)) is None:
            return default
        if isinstance(value, bool) or not isinstance(value, Number) or not abs(value) <= NUMBER_MAX:
            self.refuse(key, f"{value!r} must be a finite number within {NUMBER_MAX:g}")
            return default
        if not lower <= float(value) <= upper:
            self.refuse(key, f"{value:g} must lie in [{lower:g}, {upper:g}]")
        return float(value)


def _start(request: _Fields, cell: Cell) -> Array:
    start = request.get("start")
    if start is None:
        return cell.home
    if not isinstance(start, Mapping) or "positions" not in start:
        request.refuse("start", 'must be {"positions": [6]} or {"current": true}')
        return cell.home
    fields = request.nested("start")
    fields.refuse_unknown(("positions",))
    return fields.vector("positions", 6)


def _window(request: _Fields, release: Release | None, cell: Cell) -> tuple[float, float]:
    """Returns release window [s] and landing tolerance [m]; a target without them gets the gripper's and its own.

    A request for odds starts from no window: whoever knows the odds decides how long it must be.
    """
    default_s = default_m = 0.0
    if isinstance(release, TargetRelease):
        if not request.get("min_hit_probability"):
            default_s = min(max(JITTER_DEVIATIONS * cell.gripper.jitter_s, WINDOW_MIN_S), WINDOW_MAX_S)
        default_m = _default_tolerance(release, cell)
    window = request.number("release_window_s", default_s, 0.0, WINDOW_MAX_S)
    return window, request.number("landing_tolerance_m", default_m, 0.0, TOLERANCE_MAX_M)


def _refuse_odds(request: _Fields, release: Release | None) -> None:
    """Records a hit probability that is none, or that is asked of a release without a target."""
    key = "min_hit_probability"
    asked = request.number(key, 0.0, 0.0, 1.0)
    if asked > 0.0 and release is not None and not isinstance(release, TargetRelease):
        request.refuse(key, f"{asked:g} is for a release of kind target: the others have nothing to hit")


def _default_tolerance(release: TargetRelease, cell: Cell) -> float:
    """Returns the landing tolerance [m]: the room in the bin's mouth, otherwise the object's radius."""
    if release.opening is not None:
        return max(release.opening.radius_m - cell.object.radius_m, 0.0)
    return max(cell.object.radius_m, ROBUST_TOLERANCE_M)


def _limits(request: _Fields, own: Limits) -> Limits:
    """Returns the cell's `own` limits, tightened by the request."""
    limits = request.nested("limits")
    changed = {}
    limits.refuse_unknown(LIMIT_FIELDS)
    for key, (attribute, unit) in LIMIT_FIELDS.items():
        if limits.get(key) is not None:
            changed[attribute] = _tightened(limits, key, getattr(own, attribute), unit)
    if request.get("singularity_distance_min") is not None:
        changed["singularity_distance_min"] = _singularity_distance(request, own.singularity_distance_min)
    return replace(own, **changed)


def _tightened(limits: _Fields, key: str, own: Array, unit: str) -> Array:
    """Returns a limit (6,), given as one number or one per joint, that may only tighten the cell's `own`."""
    by_joint = isinstance(limits.get(key), list | tuple | np.ndarray)
    entries = np.asarray(limits.get(key) if by_joint else [limits.get(key)] * len(own))
    if entries.shape != own.shape or entries.dtype.kind not in "fiu" or not np.isfinite(entries).all():
        limits.refuse(key, f"must be one finite number or {len(own)} of them")
        return own
    wrong = [i for i in range(len(own)) if not 0.0 < entries[i] <= own[i]]
    for i in wrong if by_joint else sorted(wrong, key=lambda joint: own[joint])[:1]:  # the tightest
        value, limit = figures(float(entries[i]), float(own[i]))
        loosens = f"{unit} loosens the cell's limit of {limit} {unit}"
        limits.refuse(f"{key}[{i}]", f"{value} {'must be above 0' if entries[i] <= 0.0 else loosens}")
    return read_only(entries)


def _singularity_distance(request: _Fields, own: float) -> float:
    key = "singularity_distance_min"
    value = request.get("singularity_distance_min")
    if isinstance(value, bool) or not isinstance(value, Number) or not -NUMBER_MAX <= value <= 1.0:
        request.refuse(key, f"{value} must be a number up to 1")
        return own
    if value < own:
        request.refuse(key, f"{value:g} loosens the cell's limit of {own:g}")
    return float(value)


def _release(request: _Fields, cell: Cell) -> Release | None:
    """Returns the release in the world frame, None where its kind is unknown."""
    frame = "world" if "frame" not in request.values else request.get("frame")
    if frame not in ("world", "base"):
        request.refuse("frame", f'{frame!r} is not "world" or "base"')
    X_WR = cell.X_WB if frame == "base" else np.eye(4)  # R: the frame of the request
    release = request.nested("release")
    kind = release.get("kind")
    if isinstance(kind, str) and kind in RELEASE_FIELDS:
        release.refuse_unknown(RELEASE_FIELDS[kind])
    match kind:
        case "pose":
            return _pose_release(release, X_WR)
        case "point":
            p_RT = release.vector("position", 3)
            v_RT = release.vector("velocity", 3)
            return PointRelease(_move(X_WR, p_RT), _turn(X_WR, v_RT))
        case "joint":
            return JointRelease(release.vector("positions", 6), release.vector("velocities", 6))
        case "target":
            return _target_release(release, X_WR)
        case _:
            release.refuse("kind", f"{kind!r} is not one of {', '.join(RELEASE_FIELDS)}")
            return None


def _pose_release(release: _Fields, X_WR: Array) -> PoseRelease:
    given = release.nested("pose")
    twist = release.nested("twist")
    given.refuse_unknown(("position", "quaternion", "rotation_vector"))
    twist.refuse_unknown(("linear", "angular"))
    p_RT = given.vector("position", 3)
    v_RT = twist.vector("linear", 3)
    w_RT = twist.vector("angular", 3)
    X_RT = pose(p_RT, _rotation(release, given))
    return PoseRelease(X_WR @ X_RT, np.concatenate([_turn(X_WR, v_RT), _turn(X_WR, w_RT)]))


def _rotation(release: _Fields, given: _Fields) -> Array:
    """Returns the rotation matrix of a pose, identity where its orientation is refused."""
    readers = {"quaternion": _of_quaternion, "rotation_vector": _of_rotation_vector}
    found = [read(given) for key, read in readers.items() if given.get(key) is not None]
    if not found:
        release.refuse("pose", "needs quaternion or rotation_vector")
        return np.eye(3)
    apart = angle_between(found[0], found[-1])  # answers give both
    if not given.errors and apart > AGREEMENT_RAD:
        release.refuse("pose", f"quaternion and rotation_vector are {apart:.3g} rad apart")
    return found[0]


def _of_rotation_vector(given: _Fields) -> Array:
    """Returns the rotation matrix of a pose's rotation vector, identity where it is refused."""
    vector = given.vector("rotation_vector", 3)
    if reason := beyond_full_turn(vector):
        given.refuse("rotation_vector", reason)
        return np.eye(3)
    return rotation_vector_to_matrix(vector)


def _of_quaternion(given: _Fields) -> Array:
    """Returns the rotation matrix of a pose's quaternion, identity where it is refused."""
    quaternion = given.vector("quaternion", 4)
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        given.refuse("quaternion", f"has length {length:g}, must be 1")
        return np.eye(3)
    return quaternion_to_matrix(quaternion / length)


def _target_release(release: _Fields, X_WR: Array) -> TargetRelease:
    half = np.pi / 2
    free = release.get("release_position") is None
    return TargetRelease(
        p_W=_move(X_WR, release.vector("position", 3)),
        max_speed_m_s=release.number("max_release_speed_m_s", np.inf, SPEED_MIN_M_S),
        min_elevation_rad=release.number("min_elevation_rad", -half, -half, half),
        max_elevation_rad=release.number("max_elevation_rad", half, -half, half),
        min_horizontal_distance_m=release.number("min_horizontal_distance_m", 0.0, 0.0),
        release_position=None if free else _move(X_WR, release.vector("release_position", 3)),
        opening=_opening(release),
    )


def _opening(release: _Fields) -> Opening | None:
    """Returns the mouth of the bin around a target, None where there is none."""
    if release.get("opening") is None:
        return None
    if not isinstance(release.get("opening"), Mapping):
        release.refuse("opening", 'must be {"radius_m", "rim_height_m"}')
        return None
    opening = release.nested("opening")
    opening.refuse_unknown(("radius_m", "rim_height_m"))
    for key in ("radius_m", "rim_height_m"):
        if opening.get(key) is None:
            opening.refuse(key, "is missing")
    return Opening(
        opening.number("radius_m", np.inf, 0.0, OPENING_MAX_M), opening.number("rim_height_m", 0.0, 0.0, OPENING_MAX_M)
    )


def _move(X_WR: Array, p: Array) -> Array:
    """Returns a point of the request's frame in the world frame."""
    return X_WR[:3, :3] @ p + X_WR[:3, 3]


def _turn(X_WR: Array, v: Array) -> Array:
    """Returns a vector of the request's frame in the world frame."""
    return X_WR[:3, :3] @ v
