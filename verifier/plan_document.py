"""The plan's document: its samples, and what its request demands, read anew."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from planner.cell import Cell, ThrownBody
from verifier.elementary import Array
from verifier.passage_demands import ToldPassage, told_passages
from verifier.request_checks import WRONG_SHAPE, NotAPlan, check_request

AT_REST = 1e-9  # [rad/s, m/s] a demanded state slower than this is a move that ends at rest; nobody throws as slowly
JITTERS = 3.0  # [-] standard deviations of the opening that a throw stands. source: contract, section 8
LEAST_WINDOW_S = 0.005  # [s] half of the window of a target without one. source: contract, section 8
LEAST_TOLERANCE_M = 0.01  # [m] of a target without an opening and a tolerance. source: contract, section 8


OF_FLIGHT = ("flight_clearance", "landing", "landing_window")  # checks of where the object goes
OF_TOOL = ("passage", "release_position", "release_velocity")  # checks of the tool centre point's own states
OF_OBJECT = (  # checks that depend on when the object may leave
    *("joint_torque", "momentum", "power", "stopping_time", "stopping_distance", "grip_acceleration"),
    *("floor", "keep_out", "self_collision", "opening_direction"),
)


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
class Aim:
    """What a thrown object is to hit.

    Attributes:
        p_W: the place (3,) [m].
        window_s, tolerance_m: by which a release may be early or late, and the landing then off [s, m].
        bin: inner radius, and height of the rim above the place [m]; None without a bin.
    """

    p_W: Array
    window_s: float
    tolerance_m: float
    bin: tuple[float, float] | None


@dataclass(frozen=True, eq=False)
class Demands:
    """What a request demands, in the world.

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


def read_demands(document: Mapping[str, Any], cell: Cell) -> Demands:
    """Returns what the request of a plan's document demands.

    Raises:
        NotAPlan: a part of it is missing or has another shape.
    """
    try:
        return _demands(document, cell)
    except NotAPlan:
        raise
    except WRONG_SHAPE as error:
        raise NotAPlan(f"request: {error!r}") from error


def _demands(document: Mapping[str, Any], cell: Cell) -> Demands:
    asked = _stated(document["request"])
    asked["passages"] = [_stated(each) for each in asked.get("passages") or []]
    check_request(asked, _released(asked))
    limits = asked.get("limits") or {}
    release = _released(asked)
    own = cell.limits
    least = asked.get("singularity_distance_min")
    is_base = asked.get("frame", "world") == "base"
    throws = bool(release) and not is_at_rest(release)
    aim = None
    not_covered = _not_covered(document, asked, release, cell)
    X_WR = cell.X_WB if is_base else np.eye(4)
    if release.get("kind") == "target":
        aim = _aim(asked, release, cell, X_WR)
    window_s = aim.window_s if aim is not None else float(asked.get("release_window_s") or 0.0)
    tolerance_m = aim.tolerance_m if aim is not None else float(asked.get("landing_tolerance_m") or 0.0)
    if throws and aim is None and window_s > 0.0 and tolerance_m > 0.0:
        not_covered["landing_window"] = "a window of a release that is not a target's"
    return Demands(
        start=_start(asked.get("start") or {}, cell),
        qd_max=_tighter(own.qd_max, limits.get("velocity")),
        qdd_max=_tighter(own.qdd_max, limits.get("acceleration")),
        jerk_max=_tighter(own.jerk_max, limits.get("jerk")),
        singularity_distance_min=max(own.singularity_distance_min, float(least or 0.0)),
        throws=throws,
        kind=release.get("kind", ""),
        release=release,
        R_WR=X_WR[:3, :3],
        p_WR=X_WR[:3, 3],
        aim=aim,
        spread_s=max(window_s if tolerance_m > 0.0 else 0.0, JITTERS * cell.gripper.jitter_s) if throws else 0.0,
        passages=_passages(document, asked),
        end=asked.get("end") or {},
        not_covered=not_covered,
    )


def _not_covered(
    document: Mapping[str, Any], asked: Mapping[str, Any], release: Mapping[str, Any], cell: Cell
) -> dict[str, str]:
    """Returns what nobody verifies here, by check; of these no plan is proven."""
    found: dict[str, str] = {}
    if document.get("profile") is not None:
        found |= dict.fromkeys((*OF_FLIGHT, *OF_OBJECT), "a learnt profile")
    if asked.get("min_hit_probability") and asked.get("release_window_s") is None:
        found["landing_window"] = "a window that the odds decide"
    may_move = any(release.get("velocity") or []) or release.get("uncertainty") is not None
    if may_move and release.get("kind") == "target":
        found |= dict.fromkeys((*OF_FLIGHT, "keep_out"), "a target that moves")
    if cell.grippers:
        found |= dict.fromkeys((*OF_FLIGHT, *OF_OBJECT, *OF_TOOL), "a tool with several grippers")
    if isinstance(cell.object, ThrownBody) and release and not is_at_rest(release):
        found |= dict.fromkeys(OF_FLIGHT, "the flight of a body that is no ball")
    return found


def _stated(table: Mapping[str, Any]) -> dict[str, Any]:
    """Returns what a table states: without what is null."""
    return {name: value for name, value in table.items() if value is not None}


def _passages(document: Mapping[str, Any], asked: Mapping[str, Any]) -> tuple[ToldPassage, ...]:
    """Returns the passages of a plan; none where a release alone is asked for."""
    return told_passages(asked["passages"], document.get("passages") or [], len(document["trajectory"]["positions"]))


def _released(asked: Mapping[str, Any]) -> Mapping[str, Any]:
    """Returns the release that a request asks for, among its passages too; empty without one."""
    passages = asked.get("passages") or []
    if not passages:
        return asked.get("release") or {}
    return next((each["state"] for each in passages if each.get("releases") and "state" in each), {})


def is_at_rest(release: Mapping[str, Any]) -> bool:
    """Returns whether a release demands a state at rest, so that nothing is thrown."""
    speeds = {
        "joint": lambda: release["velocities"],
        "pose": lambda: [*release["twist"]["linear"], *release["twist"]["angular"]],
        "point": lambda: release["velocity"],
        "target": lambda: [math.inf],
    }
    return max(abs(float(speed)) for speed in speeds[release["kind"]]()) < AT_REST


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


def _aim(asked: Mapping[str, Any], release: Mapping[str, Any], cell: Cell, X_WR: Array) -> Aim:
    """Returns the aim of a target, with the window and the tolerance that the contract gives one without them."""
    opening = release.get("opening")
    radius = cell.object.radius_m
    room_m = max(float(opening["radius_m"]) - radius, 0.0) if opening else max(radius, LEAST_TOLERANCE_M)
    window_s = max(JITTERS * cell.gripper.jitter_s, LEAST_WINDOW_S)
    if asked.get("min_hit_probability"):
        window_s = 0.0  # nobody tells here which one the odds take
    asked_s, asked_m = asked.get("release_window_s"), asked.get("landing_tolerance_m")
    return Aim(
        p_W=X_WR[:3, :3] @ np.asarray(release["position"], np.float64) + X_WR[:3, 3],
        window_s=window_s if asked_s is None else float(asked_s),
        tolerance_m=room_m if asked_m is None else float(asked_m),
        bin=(float(opening["radius_m"]), float(opening["rim_height_m"])) if opening else None,
    )
