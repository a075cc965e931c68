"""Requests of `POST /plan` as JSON documents: to a checked `ThrowProblem`, and back.

`PLAN_REQUEST` states every rule about the fields of a request, for library, command line and service alike; the
service's OpenAPI is derived from it. What depends on the cell is checked here too, and the relations between the
quantities of a problem by `ThrowProblem`. Every refusal names the field, the value and the limit; all are reported
together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from planner.arrays import Array, read_only
from planner.cell import Cell, Limits
from planner.errors import FieldError, InvalidProblem, figures
from planner.fields import Choice, Field, Kinds, Number, PerJoint, Record, Text, Vector, Yes
from planner.passages import (
    END,
    NOT_YET,
    PASSAGES,
    TIME_MAX_S,
    end_document,
    end_from_json,
    gripper_named,
    main_state,
    passage_document,
    passages_from_json,
)
from planner.problem import (
    BACKENDS,
    JITTER_DEVIATIONS,
    TIME_LIMIT_MAX_S,
    TIME_LIMIT_S,
    ThrowProblem,
)
from planner.releases import KINDS, UPTIME_MAX_S, Release, Target, release_document

__all__ = [
    "PLAN_REQUEST",
    "RETARGET_REQUEST",
    "problem_from_request",
    "read_request",
    "release_document",
    "request_document",
    "states_of",
    "tracked_targets",
    "with_states",
]

WINDOW_MAX_S = 0.2  # [s] longest release window
TOLERANCE_MAX_M = 10.0  # [m] largest landing tolerance
WINDOW_MIN_S = 0.005  # [s] least default half width: the scatter of a pneumatic or electric gripper; source: contract
ROBUST_TOLERANCE_M = 0.01  # [m] least default landing tolerance of a target without an opening
CELL_NAME_MAX = 64  # characters of a cell's name
ID_MAX = 64  # characters of an execution's id
STILL = (0.0,) * 6  # [rad/s, rad/s^2] of a start at rest
LIMIT_FIELDS = {
    "velocity": ("qd_max", "rad/s"),
    "acceleration": ("qdd_max", "rad/s^2"),
    "jerk": ("jerk_max", "rad/s^3"),
}


def _check_start(given: dict[str, Any], path: str, errors: list[FieldError]) -> None:
    ways = [name for name in ("positions", "current", "execution") if name in given]
    if len(ways) != 1 and ways != ["positions", "execution"]:  # both: what the service found for the execution
        errors.append(FieldError(path, "give either positions, current or execution"))
    for name in ("velocities", "accelerations"):
        if name in given and "positions" not in given:
            errors.append(FieldError(f"{path}.{name}", "belongs to positions"))
    if ("at_s" in given) != ("execution" in given):
        errors.append(FieldError(f"{path}.at_s", "and execution belong together"))


def _check_motion(given: dict[str, Any], path: str, errors: list[FieldError]) -> None:
    """Refuses a motion that is not stated in one way, and odds that it cannot have."""
    prefix = f"{path}." if path else ""
    if "passages" not in given:
        if "release" not in given:
            errors.append(FieldError(f"{prefix}release", "is missing; or give passages"))
            return
        if "end" in given:
            errors.append(FieldError(f"{prefix}end", "is for a motion of passages"))
    elif "release" in given:
        errors.append(FieldError(f"{prefix}release", "give either release or passages"))
        return
    _check_odds(given, prefix, errors)


def _check_odds(given: dict[str, Any], prefix: str, errors: list[FieldError]) -> None:
    """Refuses odds of a motion that aims at nothing, or of one whose odds nobody knows."""
    asked = given.get("min_hit_probability", 0.0)
    if asked > 0.0 and any(gripper_named(each) for each in given.get("passages", ())):
        reason = f"{asked:g}: nobody knows the odds of a motion in which one of `[grippers]` lets go"
        errors.append(FieldError(f"{prefix}min_hit_probability", reason))
    states = [given["release"]] if "release" in given else [each.get("state") for each in given["passages"]]
    if asked > 0.0 and not any(KINDS[state["kind"]].aims for state in states if state):
        aiming = " or ".join(name for name, kind in KINDS.items() if kind.aims)
        reason = f"{asked:g} is for a release of kind {aiming}: the others have nothing to hit"
        errors.append(FieldError(f"{prefix}min_hit_probability", reason))


START = Record(
    "StartRequest",
    "Start of the motion. Give positions, current, or execution with at_s.",
    {
        "positions": Field(Vector(6), "Joint positions, base to wrist 3 [rad]."),
        "velocities": Field(Vector(6), "Joint velocities at the start [rad/s]; absent: zero."),
        "accelerations": Field(Vector(6), "Joint accelerations at the start [rad/s^2]; absent: zero."),
        "current": Field(Yes(), "true: the current joint positions, as the cell's executor reports them, at rest."),
        "execution": Field(
            Text(ID_MAX), "Id of a running execution, or `latest`: the motion begins on it, so that it can replace it."
        ),
        "at_s": Field(
            Number(0.0, TIME_MAX_S), "Time in that execution's motion at which this one begins, rounded to a tick [s]."
        ),
    },
    _check_start,
)
LIMITS = Record(
    "RequestLimits",
    "Tighter limits than the cell's; one number for all joints or one per joint.",
    {
        "velocity": Field(PerJoint(), "Joint velocity [rad/s]."),
        "acceleration": Field(PerJoint(), "Joint acceleration [rad/s^2]."),
        "jerk": Field(PerJoint(), "Joint jerk [rad/s^3]."),
    },
)
PLAN_REQUEST = Record(
    "PlanRequest",
    "A throw, or any move that must pass a state at speed.",
    {
        "cell": Field(Text(CELL_NAME_MAX, least=1), "Name of the cell; absent: the service's default cell."),
        "start": Field(START, "Start of the launch; absent: the cell's home."),
        "release": Field(
            Kinds({name: kind.record for name, kind in KINDS.items()}),
            "The state to pass or the point to hit: one of four kinds. It is short for one passage that releases; give "
            "either.",
        ),
        "passages": Field(
            PASSAGES,
            "States and lines to pass one after another, as fast as the limits allow, and the outputs about them.",
        ),
        "end": Field(END, "Where a motion of passages comes to rest; absent: anywhere."),
        "frame": Field(
            Choice(("world", "base")), "Frame of positions and velocities in this request.", default="world"
        ),
        "backend": Field(
            Choice(BACKENDS), "Back end; auto: the best certified plan of several back ends.", default="auto"
        ),
        "limits": Field(LIMITS, "Limits of this plan; they may only tighten the cell's."),
        "singularity_distance_min": Field(
            Number(0.0, 1.0), "Minimum distance to each singularity [-]; may only tighten the cell's."
        ),
        "release_window_s": Field(
            Number(0.0, WINDOW_MAX_S),
            "A release early or late by up to this [s] still lands within `landing_tolerance_m`; without one there is "
            "no window. Absent: for a target three times the gripper's jitter, at least 0.005, otherwise 0; 0 asks for "
            "the soonest release. With `min_hit_probability` it is the shortest window that is tried; absent: 0.",
        ),
        "landing_tolerance_m": Field(
            Number(0.0, TOLERANCE_MAX_M),
            "Maximum landing error in the release window [m]; 0: only the nominal release. Absent: for a target the "
            "room in its opening, or the object's radius, at least 0.01; for the other kinds 0.",
        ),
        "min_hit_probability": Field(
            Number(0.0, 1.0),
            "Least `hit_probability` of the plan [-], for a target. With the back end `auto` a later release is "
            "planned where the soonest does not reach it: windows in steps of what is known of the release's timing, "
            "then slower throws; `infeasible` where none of them does.",
        ),
        "starts_not_before_s": Field(
            Number(0.0, UPTIME_MAX_S),
            "Earliest start of a plan to a target that moves, on the controller's clock [s]. Absent: the service's: "
            "2 s after it was asked.",
        ),
        "time_limit_s": Field(
            Number(above=0.0, most=TIME_LIMIT_MAX_S),
            "Time limit of the planner, from when it takes the request [s]; absent: 120. Where it passes before the "
            "search ends, the best motion so far can be the plan: its `solver.status` then says so.",
        ),
    },
    _check_motion,
)

_GIVEN = {
    "starts_not_before_s": "is for a start at rest",
    "cell": "is named by the path",
    "start": "is the state of the running motion",
}
RETARGET_REQUEST = Record(
    "RetargetRequest",
    "What a running motion is to do instead: a request for a plan whose cell and start are given.",
    {name: field for name, field in PLAN_REQUEST.fields.items() if name not in _GIVEN},
    _check_motion,
    _GIVEN,
)


def read_request(document: Any, path: str = "", record: Record = PLAN_REQUEST) -> dict[str, Any]:
    """Returns a request in plain Python types: null fields left out, defaults filled in.

    Args:
        document: JSON of `POST /plan`.
        path: of the request in a larger document.
        record: what it may hold.

    Raises:
        InvalidProblem: every refused field with its reason.
    """
    errors: list[FieldError] = []
    asked = record.read(document, path, errors)
    if errors:
        raise InvalidProblem(errors)
    return asked


def problem_from_request(request: Mapping[str, Any], cell: Cell) -> ThrowProblem:
    """Returns the problem that a request states for a cell.

    Args:
        request: JSON document of `POST /plan`; `start: {"current": true}` must have been resolved to positions.
        cell: the robot station; its limits and home are the defaults.

    Raises:
        InvalidProblem: every refused field with its reason.
    """
    errors: list[FieldError] = []
    asked = PLAN_REQUEST.read(request, "", errors)
    limits = _limits(asked, cell.limits, errors)
    start = asked.get("start", {})
    errors += _grippers_in_motion(asked, start)
    if "current" in start:
        errors.append(FieldError("start.current", "needs a service with an executor; give positions"))
    if "execution" in start and "positions" not in start:
        errors.append(FieldError("start.execution", "needs a service with an executor; give positions"))
    for path in tracked_targets(asked):
        errors.append(FieldError(f"{path}.position", "a tracked target is known to `POST /plan` of a service alone"))
    if errors:
        raise InvalidProblem(errors)
    X_WR = cell.X_WB if asked["frame"] == "base" else np.eye(4)  # R: the frame of the request
    passages = passages_from_json(asked.get("passages", ()), X_WR)
    if passages:
        release = main_state(passages)
    else:
        release = KINDS[asked["release"]["kind"]].from_json(asked["release"], X_WR)
    if "starts_not_before_s" in asked and (release.target is None or not release.target.moves):
        raise InvalidProblem([FieldError("starts_not_before_s", "is for a target that moves")])
    lets_go = [(each.state, cell.seen_from(each.gripper)) for each in passages if each.releases]
    window_s, tolerance_m = _windows(asked, lets_go or [(release, cell)])
    return ThrowProblem(
        cell=cell,
        start=read_only(start["positions"]) if start else cell.home,
        start_qd=read_only(start.get("velocities", STILL)),
        start_qdd=read_only(start.get("accelerations", STILL)),
        release=release,
        limits=limits,
        release_window_s=window_s,
        landing_tolerance_m=tolerance_m,
        backend=asked["backend"],
        time_limit_s=asked.get("time_limit_s", TIME_LIMIT_S),
        starts_not_before_s=asked.get("starts_not_before_s"),
        passages=passages,
        end=end_from_json(asked["end"], cell.home, X_WR) if "end" in asked else None,
    )


def states_of(request: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Returns the states that a request asks for, by their fields: of its release, or of its passages but lines."""
    found = {} if request.get("release") is None else {"release": request["release"]}
    for i, each in enumerate(request.get("passages") or ()):
        if each.get("state") is not None:
            found[f"passages[{i}].state"] = each["state"]
    return found


def target_moves(request: Mapping[str, Any]) -> bool:
    """Returns whether a request asks for a throw at a target that moves, or may, as it is tracked."""
    if tracked_targets(request):
        return True
    asked = [state for state in states_of(request).values() if "observed_at_s" in state]
    return any("uncertainty" in state or any(state["velocity"]) for state in asked)


def with_states(request: Mapping[str, Any], states: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Returns a request with some of its states replaced, which are given by their fields, as of `states_of`."""
    found = dict(request)
    if "release" in states:
        found["release"] = dict(states["release"])
    if request.get("passages"):
        known = {i: states.get(f"passages[{i}].state") for i in range(len(request["passages"]))}
        found["passages"] = [
            each if known[i] is None else {**each, "state": known[i]} for i, each in enumerate(request["passages"])
        ]
    return found


def tracked_targets(request: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Returns the states of a request that name a tracked target in place of a position, by their fields."""
    return {path: state for path, state in states_of(request).items() if isinstance(state.get("position"), Mapping)}


def _grippers_in_motion(asked: Mapping[str, Any], start: Mapping[str, Any]) -> list[FieldError]:
    """Returns the refusal of grippers that are named beside a start in motion."""
    if not any((*start.get("velocities", ()), *start.get("accelerations", ()))):
        return []
    named = [number for number, each in enumerate(asked.get("passages", ())) if gripper_named(each)]
    reason = f"names a gripper, which {NOT_YET} for a start in motion"
    return [FieldError(f"passages[{number}].releases", reason) for number in named]


def request_document(problem: ThrowProblem, release: Release) -> dict[str, Any]:
    """Returns the request that states `problem` with another release, in the shape of `POST /plan`."""
    limits = problem.limits
    motion: dict[str, Any] = {"release": release_document(release)}
    if problem.passages:
        passages = problem.with_release(release).passages
        motion = {"passages": [passage_document(each) for each in passages], "end": end_document(problem.end)}
    return {
        "cell": problem.cell.name,
        "start": _start_document(problem),
        **motion,
        "frame": "world",
        "backend": problem.backend,
        "limits": {name: getattr(limits, attribute).tolist() for name, (attribute, _) in LIMIT_FIELDS.items()},
        "singularity_distance_min": limits.singularity_distance_min,
        "release_window_s": problem.release_window_s,
        "landing_tolerance_m": problem.landing_tolerance_m,
        "time_limit_s": problem.time_limit_s,
        **({"starts_not_before_s": problem.starts_not_before_s} if problem.moving is not None else {}),
    }


def _start_document(problem: ThrowProblem) -> dict[str, Any]:
    start = {"positions": problem.start.tolist()}
    if problem.starts_at_rest:
        return start
    return {**start, "velocities": problem.start_qd.tolist(), "accelerations": problem.start_qdd.tolist()}


def _windows(asked: Mapping[str, Any], lets_go: Sequence[tuple[Release, Cell]]) -> tuple[float, float]:
    """Returns release window [s] and landing tolerance [m] of all releases: the longest, and the tightest of any.

    Args:
        asked: the request.
        lets_go: releases, each with the cell as its gripper sees it.

    Raises:
        InvalidProblem: as of `_window`.
    """
    windows = [_window(asked, *each) for each in lets_go]
    return max(each for each, _ in windows), min((each for _, each in windows if each > 0.0), default=0.0)


def _window(asked: Mapping[str, Any], release: Release, cell: Cell) -> tuple[float, float]:
    """Returns release window [s] and landing tolerance [m]; a target without them gets the gripper's and its own.

    A request for odds starts from no window: whoever knows the odds decides how long it must be.

    Raises:
        InvalidProblem: no window is asked for, and the gripper's is too long to be planned.
    """
    default_s = 0.0
    default_m = 0.0
    if release.target is not None:
        default_m = _default_tolerance(release.target, cell)
        if not asked.get("min_hit_probability"):
            default_s = max(JITTER_DEVIATIONS * cell.gripper.jitter_s, WINDOW_MIN_S)
    if default_s > WINDOW_MAX_S and "release_window_s" not in asked:
        spread = f"three times the gripper's jitter of {cell.gripper.jitter_s:g} s"
        reason = f"{spread} is {default_s:g} s, and no window is longer than {WINDOW_MAX_S:g} s: state one"
        raise InvalidProblem([FieldError("release_window_s", reason)])
    return asked.get("release_window_s", default_s), asked.get("landing_tolerance_m", default_m)


def _default_tolerance(target: Target, cell: Cell) -> float:
    """Returns the landing tolerance [m]: the room in the bin's mouth, otherwise the object's radius."""
    if target.opening is not None:
        return max(target.opening.radius_m - cell.object.radius_m, 0.0)
    return max(cell.object.radius_m, ROBUST_TOLERANCE_M)


def _limits(asked: Mapping[str, Any], own: Limits, errors: list[FieldError]) -> Limits:
    """Returns the cell's `own` limits, tightened by the request."""
    changed: dict[str, Any] = {}
    for key, given in asked.get("limits", {}).items():
        attribute, unit = LIMIT_FIELDS[key]
        changed[attribute] = _tightened(f"limits.{key}", given, getattr(own, attribute), unit, errors)
    if (least := asked.get("singularity_distance_min")) is not None:
        changed["singularity_distance_min"] = least
        if least < own.singularity_distance_min:
            reason = f"{least:g} loosens the cell's limit of {own.singularity_distance_min:g}"
            errors.append(FieldError("singularity_distance_min", reason))
    return replace(own, **changed)


def _tightened(path: str, given: float | list[float], own: Array, unit: str, errors: list[FieldError]) -> Array:
    """Returns a limit (6,), given as one number or one per joint, that may only tighten the cell's `own`."""
    limit = read_only(np.broadcast_to(given, own.shape))
    wrong = [i for i in range(len(own)) if not 0.0 < limit[i] <= own[i]]
    if not isinstance(given, list):
        wrong = sorted(wrong, key=lambda joint: own[joint])[:1]  # the tightest
    for i in wrong:
        value, bound = figures(float(limit[i]), float(own[i]))
        reason = f"{unit} loosens the cell's limit of {bound} {unit}" if limit[i] > 0.0 else "must be above 0"
        errors.append(FieldError(f"{path}[{i}]", f"{value} {reason}"))
    return limit
