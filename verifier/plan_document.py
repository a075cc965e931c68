"""The plan's document: its samples, and what its request demands, read anew."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from planner.cell import Cell
from verifier.aims import JITTERS, Aim, read_aim
from verifier.elementary import Array
from verifier.grippers import OWN, gripper_names, seen_by
from verifier.passage_demands import ToldPassage, told_passages
from verifier.request_checks import WRONG_SHAPE, NotAPlan, ReleasedState, check_request, is_at_rest, released_states

OF_FLIGHT = ("flight_clearance", "landing", "landing_window", "landing_axis")  # checks of where the object goes
OF_OBJECT = (  # checks that depend on when the object may leave
    *("joint_torque", "momentum", "power", "stopping_time", "stopping_distance", "grip_acceleration"),
    *("floor", "keep_out", "self_collision", "opening_direction"),
)
OF_SEVERAL = ("releases_apart", "flights_apart")  # checks of several objects, when and where they go
COMMAND_TIME = "command_time"  # of a passage's outputs, which no check of the certificate is named for


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """Samples of a plan's motion.

    Attributes:
        rate_hz: samples a second.
        q, qd, qdd: positions, velocities, accelerations (N, 6) [rad, rad/s, rad/s^2].
        release: sample of the release; None without one.
    """

    rate_hz: float
    q: Array
    qd: Array
    qdd: Array
    release: int | None


@dataclass(frozen=True, eq=False)
class Demands:
    """What a request demands, in the world; of what is let go, what it demands of one gripper.

    Attributes:
        start: joint state (3, 6): positions, velocities, accelerations; None: the request does not say.
        qd_max, qdd_max, jerk_max: limits of the joints (6,).
        singularity_distance_min: [-].
        throws: whether the object leaves the tool.
        kind: of the release; empty without one.
        release: what the request says of it.
        R_WR, p_WR: pose of the request's frame.
        aim: of a target.
        spread_s: how early or late the object may leave [s].
        passages: what is passed, in its order; none where a release alone is asked for.
        end: how a motion of passages ends, as the request has it; empty: anywhere.
        not_covered: what the request has that nobody verifies here, by check.
        gripper: name of the gripper; empty: the cell's own.
        passage: name of the passage at which it lets go; empty without one.
        released_at: sample of that; None without one.
    """

    start: Array | None
    qd_max: Array
    qdd_max: Array
    jerk_max: Array
    singularity_distance_min: float
    throws: bool
    kind: str
    release: Mapping[str, Any]
    R_WR: Array
    p_WR: Array
    aim: Aim | None
    spread_s: float
    passages: tuple[ToldPassage, ...] = ()
    end: Mapping[str, Any] = field(default_factory=dict)
    not_covered: Mapping[str, str] = field(default_factory=dict)
    gripper: str = OWN
    passage: str = ""
    released_at: int | None = None

    def place(self, p: Any) -> Array:
        """Returns a point (3,) of the request's frame in the world [m]."""
        return self.R_WR @ np.asarray(p, np.float64) + self.p_WR

    def direction(self, v: Any) -> Array:
        """Returns a vector (3,) of the request's frame in the world."""
        return self.R_WR @ np.asarray(v, np.float64)


def read_motion(document: Mapping[str, Any]) -> SampledMotion:
    """Returns the samples of a plan's document.

    Raises:
        NotAPlan: a part of it is missing or has another shape.
    """
    try:
        rows = document["trajectory"]
        q, qd, qdd = (np.array(rows[key], np.float64) for key in ("positions", "velocities", "accelerations"))
        rate_hz = float(document["sample_rate_hz"])
        release = document["release"]
        index = None if release is None else release["index"]
    except WRONG_SHAPE as error:
        raise NotAPlan(f"trajectory: {error!r}") from error
    if q.ndim != 2 or q.shape[1] != 6 or len(q) < 2 or not q.shape == qd.shape == qdd.shape:
        raise NotAPlan(f"trajectory: positions {q.shape}, velocities {qd.shape}, accelerations {qdd.shape}")
    if not all(np.isfinite(x).all() for x in (q, qd, qdd)) or not 0.0 < rate_hz < math.inf:
        raise NotAPlan("trajectory: a number is not finite, or the sample rate not above 0")
    if index is not None and (type(index) is not int or not 0 <= index < len(q)):
        raise NotAPlan(f"release.index: {index} is not a sample of {len(q)}")
    return SampledMotion(rate_hz, q, qd, qdd, index)


def read_demands(document: Mapping[str, Any], cell: Cell, is_learnt: bool = False) -> list[Demands]:
    """Returns what the request of a plan's document demands, of each gripper that has a say in it.

    These are those that let go, in their order; then the cell's own, if other passages alone are its.

    Args:
        document: the plan's.
        cell: its cell.
        is_learnt: whether that has the numbers of the plan's profile.

    Raises:
        NotAPlan: a part of it is missing or has another shape.
    """
    try:
        return _demands(document, cell, is_learnt)
    except NotAPlan:
        raise
    except WRONG_SHAPE as error:
        raise NotAPlan(f"request: {error!r}") from error


def _demands(document: Mapping[str, Any], cell: Cell, is_learnt: bool) -> list[Demands]:
    asked = _stated(document["request"])
    asked["passages"] = [_stated(each) for each in asked.get("passages") or []]
    check_request(asked, gripper_names(cell))
    let_go = released_states(asked)
    common = _of_motion(document, asked, cell)
    not_covered = _not_covered(asked, let_go)
    if document.get("profile") is not None and not is_learnt:
        what = f"profile {document['profile']}, whose numbers are not given"
        not_covered |= dict.fromkeys((*OF_FLIGHT, *OF_OBJECT), what)
        if len(let_go) > 1:
            not_covered |= dict.fromkeys(OF_SEVERAL, what)
        if any(each.get("outputs") for each in asked["passages"]):
            not_covered[COMMAND_TIME] = what
    common = replace(common, not_covered=not_covered)
    found = _released(document, asked, cell, common, let_go)
    is_own = all(each.gripper != OWN for each in let_go)
    return [*found, common] if is_own and len(let_go) < max(len(common.passages), 1) else found


def _of_motion(document: Mapping[str, Any], asked: Mapping[str, Any], cell: Cell) -> Demands:
    """Returns what is demanded of the motion, whatever it lets go."""
    limits = asked.get("limits") or {}
    own = cell.limits
    least = asked.get("singularity_distance_min")
    X_WR = cell.X_WB if asked.get("frame", "world") == "base" else np.eye(4)
    return Demands(
        start=_start(asked.get("start") or {}, cell),
        qd_max=_tighter(own.qd_max, limits.get("velocity")),
        qdd_max=_tighter(own.qdd_max, limits.get("acceleration")),
        jerk_max=_tighter(own.jerk_max, limits.get("jerk")),
        singularity_distance_min=max(own.singularity_distance_min, float(least or 0.0)),
        throws=False,
        kind="",
        release={},
        R_WR=X_WR[:3, :3],
        p_WR=X_WR[:3, 3],
        aim=None,
        spread_s=0.0,
        passages=_passages(document, asked),
        end=asked.get("end") or {},
    )


def _released(
    document: Mapping[str, Any],
    asked: Mapping[str, Any],
    cell: Cell,
    common: Demands,
    let_go: Sequence[ReleasedState],
) -> list[Demands]:
    """Returns what is demanded of each release. Window and tolerance are the longest and the tightest of all.

    The tick grid is laid through the command of the first: those of others are off by up to half a tick.
    """
    X_WR = np.eye(4)
    X_WR[:3, :3], X_WR[:3, 3] = common.R_WR, common.p_WR
    aims: list[Aim | None] = []
    for each in let_go:
        told = document if not aims else {**document, "aim": None}  # of several objects the first is aimed
        is_target = each.state.get("kind") == "target"
        aims.append(read_aim(told, asked, each.state, seen_by(cell, each.gripper), X_WR) if is_target else None)
    windows = [_window(asked, aim) for aim in aims]
    window_s = max((one_s for one_s, _ in windows), default=0.0)
    tolerance_m = min((one_m for _, one_m in windows if one_m > 0.0), default=0.0)
    found = []
    for each, aim in zip(let_go, aims, strict=True):
        off_s = 0.5 / cell.robot.sample_rate_hz if found else 0.0
        own_s = window_s + off_s if window_s > 0.0 else 0.0
        jitter_s = JITTERS * seen_by(cell, each.gripper).gripper.jitter_s + off_s
        spread_s = max(own_s if tolerance_m > 0.0 else 0.0, jitter_s)
        found.append(_of_release(common, each, aim, (own_s, tolerance_m), spread_s))
    return found


def _of_release(
    common: Demands, let_go: ReleasedState, aim: Aim | None, window: tuple[float, float], spread_s: float
) -> Demands:
    """Returns what is demanded of one release.

    Args:
        common: of its motion.
        let_go: what the request has of it.
        aim: of its target.
        window: in which it may be [s], and the tolerance of its landing then [m].
        spread_s: how early or late the gripper may open [s].
    """
    window_s, tolerance_m = window
    throws = not is_at_rest(let_go.state)
    not_covered = dict(common.not_covered)
    if throws and aim is None and window_s > 0.0 and tolerance_m > 0.0:
        not_covered["landing_window"] = "a window of a release that is not a target's"
    told = None if let_go.number is None else common.passages[let_go.number]
    return replace(
        common,
        throws=throws,
        kind=let_go.state.get("kind", ""),
        release=let_go.state,
        aim=None if aim is None else replace(aim, window_s=window_s, tolerance_m=tolerance_m),
        spread_s=spread_s if throws else 0.0,
        not_covered=not_covered,
        gripper=let_go.gripper,
        passage="" if told is None else told.name,
        released_at=None if told is None else told.index,
    )


def _window(asked: Mapping[str, Any], aim: Aim | None) -> tuple[float, float]:
    """Returns release window [s] and landing tolerance [m] that are asked for, or that a target has without."""
    if aim is not None:
        return aim.window_s, aim.tolerance_m
    return float(asked.get("release_window_s") or 0.0), float(asked.get("landing_tolerance_m") or 0.0)


def _not_covered(asked: Mapping[str, Any], let_go: Sequence[ReleasedState]) -> dict[str, str]:
    """Returns what nobody verifies here, by check; of these no plan is proven."""
    found: dict[str, str] = {}
    if asked.get("min_hit_probability") and asked.get("release_window_s") is None:
        found["landing_window"] = "a window that the odds decide"
    if all(each.gripper == OWN for each in let_go):
        return found
    if any(each.state.get("opening") is not None for each in let_go):
        found |= dict.fromkeys((*OF_FLIGHT, "keep_out"), "a bin beside objects of several grippers")
    if any(any(each.state.get("velocity") or []) for each in let_go[1:] if each.state["kind"] == "target"):
        found |= dict.fromkeys(OF_FLIGHT, "a target that moves, of an object that leaves after another one")
    return found


def _stated(table: Mapping[str, Any]) -> dict[str, Any]:
    """Returns what a table states: without what is null."""
    return {name: value for name, value in table.items() if value is not None}


def _passages(document: Mapping[str, Any], asked: Mapping[str, Any]) -> tuple[ToldPassage, ...]:
    """Returns the passages of a plan; none where a release alone is asked for."""
    return told_passages(asked["passages"], document.get("passages") or [], len(document["trajectory"]["positions"]))


def _start(given: Mapping[str, Any], cell: Cell) -> Array | None:
    still = [0.0] * 6
    if not given:
        return np.array([cell.home, still, still])
    if "positions" not in given:
        return None
    rows = [given["positions"], given.get("velocities") or still, given.get("accelerations") or still]
    return np.array(rows, np.float64).reshape(3, 6)


def _tighter(own: Array, given: Any) -> Array:
    return own if given is None else np.minimum(own, np.broadcast_to(np.asarray(given, np.float64), (6,)))
