"""What a plan's request can say at all: whatever else is refused, so that it switches no check off."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

WRONG_SHAPE = (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError)
AT_REST = 1e-9  # [rad/s, m/s] a demanded state slower than this is a move that ends at rest; nobody throws as slowly
GREATEST = 1e300  # a number of a request; JSON knows integers that no float can be
# Numbers of a request, and of its release, that are not below 0, and those above it.
NOT_NEGATIVE = ("release_window_s", "landing_tolerance_m", "singularity_distance_min", "min_horizontal_distance_m")
WINDOW_MAX_S = 0.2  # [s] longest release window of a request. source: the API's schema, POST /plans
POSITIVE = ("max_release_speed_m_s", "time_limit_s")
ELEVATIONS = ("min_elevation_rad", "max_elevation_rad")  # of a target's release
VECTORS = {  # lengths of what each kind of release states
    "joint": {"positions": 6, "velocities": 6},
    "point": {"position": 3, "velocity": 3},
    "pose": {},
    "target": {"position": 3},
}


# [rad] short of half a turn, from where rounding decides which way round a line turns: half of what requests keep to.
# The axis is known to 1e-12 there.
OPEN_RAD = 5e-4


class NotAPlan(ValueError):
    """A document is no plan of this cell; the message says why."""


class ReleasedState(NamedTuple):
    """A state at which an object leaves: the gripper's name, the passage's number, None without passages, the state."""

    gripper: str
    number: int | None
    state: Mapping[str, Any]


def released_states(asked: Mapping[str, Any]) -> list[ReleasedState]:
    """Returns the states at which objects leave, in their order; of a passage `releases` is true, or a name."""
    if not asked["passages"]:
        return [ReleasedState("", None, asked.get("release") or {})] if asked.get("release") else []
    return [
        ReleasedState("" if each["releases"] is True else each["releases"], number, each["state"])
        for number, each in enumerate(asked["passages"])
        if each.get("releases") and "state" in each
    ]


def is_at_rest(release: Mapping[str, Any]) -> bool:
    """Returns whether a release demands a state at rest, so that nothing is thrown."""
    speeds = {
        "joint": lambda: release["velocities"],
        "pose": lambda: [*release["twist"]["linear"], *release["twist"]["angular"]],
        "point": lambda: release["velocity"],
        "target": lambda: [math.inf],
    }
    return max(abs(float(speed)) for speed in speeds[release["kind"]]()) < AT_REST


def check_request(asked: Mapping[str, Any], grippers: Sequence[str]) -> None:
    """Refuses what a checked request cannot say: a number that is none would switch a check off.

    Args:
        asked: the request.
        grippers: names of those that the cell has.

    Raises:
        NotAPlan: with the field.
    """
    unusual = [path for path, value in _leaves(asked, "request") if is_number(value) and not abs(value) <= GREATEST]
    if unusual:
        raise NotAPlan(f"{unusual[0]}: no finite number")
    if ("release" in asked) == bool(asked["passages"]):
        raise NotAPlan("request: states neither a release nor passages, or both")
    if asked.get("frame", "world") not in ("world", "base"):
        raise NotAPlan(f"request.frame: {asked['frame']!r}")
    for name in (name for name in ("start", "limits") if name in asked):
        if not isinstance(asked[name], Mapping):
            raise NotAPlan(f"request.{name}: {asked[name]!r} is no mapping")
    _check_numbers(asked, "request")
    _check_limits(asked.get("limits") or {})
    _check_passages(asked["passages"], grippers)
    for each in released_states(asked):
        _check_numbers(each.state, "release")
        _check_release(each.state)
    _check_end(asked)


def check_vector(value: Any, length: int, where: str) -> None:
    """Refuses what is no vector of finite numbers.

    Raises:
        NotAPlan: with its name.
    """
    if not isinstance(value, list | tuple) or len(value) != length or not all(_is_finite(each) for each in value):
        raise NotAPlan(f"{where}: {value!r}")


def _is_finite(value: Any) -> bool:
    return is_number(value) and abs(value) <= GREATEST


def _check_numbers(table: Mapping[str, Any], where: str) -> None:
    """Refuses numbers that are none, or have a sign that they cannot have."""
    for name in (name for name in (*NOT_NEGATIVE, *POSITIVE) if table.get(name) is not None):
        value = table[name]
        if not is_number(value) or value < 0.0 or (name in POSITIVE and value == 0.0):
            raise NotAPlan(f"{where}.{name}: {value!r}")
    if (table.get("release_window_s") or 0.0) > WINDOW_MAX_S:
        raise NotAPlan(f"{where}.release_window_s: {table['release_window_s']!r} is above {WINDOW_MAX_S}")


def _check_limits(limits: Mapping[str, Any]) -> None:
    for name, value in limits.items():
        if not all(is_number(each) and each > 0.0 for each in (value if isinstance(value, list) else [value])):
            raise NotAPlan(f"request.limits.{name}: {value!r}")


def _check_release(release: Mapping[str, Any]) -> None:
    for name, length in VECTORS[release["kind"]].items():
        if len(release[name]) != length or not all(map(is_number, release[name])):
            raise NotAPlan(f"release.{name}: {release[name]!r}")
    if release["kind"] == "pose":
        _check_pose(release["pose"], "release.pose")
        vectors = [release["twist"]["linear"], release["twist"]["angular"]]
        if not all(len(vector) == 3 and all(map(is_number, vector)) for vector in vectors):
            raise NotAPlan("release: its twist is none")
    if release["kind"] == "target":
        _check_target(release)
    opening = release.get("opening")
    if opening is not None and not (
        is_number(opening["radius_m"]) and opening["radius_m"] > 0.0 and opening["rim_height_m"] >= 0.0
    ):
        raise NotAPlan(f"release.opening: {opening!r}")


def _check_target(target: Mapping[str, Any]) -> None:
    for name in (name for name in ("velocity", "release_position") if target.get(name) is not None):
        check_vector(target[name], 3, f"release.{name}")
    for name in (name for name in ELEVATIONS if target.get(name) is not None):
        if not _is_finite(target[name]):
            raise NotAPlan(f"release.{name}: {target[name]!r}")
    if target.get("orientation") is not None:
        _check_orientation(target["orientation"])


def _check_orientation(asked: Any) -> None:
    check_vector(asked["axis"], 3, "release.orientation.axis")
    tolerance = asked["tolerance_rad"]
    if not any(asked["axis"]):
        raise NotAPlan(f"release.orientation.axis: {asked['axis']!r}")
    if not is_number(tolerance) or tolerance < 0.0:
        raise NotAPlan(f"release.orientation.tolerance_rad: {tolerance!r}")


def _check_passages(passages: Sequence[Mapping[str, Any]], grippers: Sequence[str]) -> None:
    for number, each in enumerate(passages):
        where = f"passages[{number}]"
        if not isinstance(each["name"], str) or ("state" in each) == ("line" in each):
            raise NotAPlan(f"{where}: states neither a state nor a line, or both, or has no name")
        _check_state_or_line(each, where)
        _check_times(each, where)
    if len({each["name"] for each in passages}) < len(passages):
        raise NotAPlan("passages: two have one name")
    let_go = [each["releases"] for each in passages if each.get("releases") not in (None, False)]
    for gripper in let_go:
        if gripper is not True and (gripper == "" or gripper not in grippers):
            raise NotAPlan(f"passages: {gripper!r} is no gripper of the cell")
    if len(set(let_go)) < len(let_go):
        raise NotAPlan("passages: two let the object of one gripper go")


def _check_state_or_line(each: Mapping[str, Any], where: str) -> None:
    if "state" in each:
        _check_release(each["state"])
    else:
        _check_line(each["line"], f"{where}.line")
    # A line lets nothing go, and a target is what something is let go for.
    kind = "line" if "line" in each else each["state"]["kind"]
    if (kind == "line" and each.get("releases")) or (kind == "target" and not each.get("releases")):
        raise NotAPlan(f"{where}.releases: of a {kind}")
    if each.get("releases") and is_at_rest(each["state"]):
        raise NotAPlan(f"{where}.state: is at rest, and lets an object go")


def _check_times(passage: Mapping[str, Any], where: str) -> None:
    times = [(passage.get("at_s"), 0.0), (passage.get("not_before_s"), 0.0)]
    for output in passage.get("outputs") or []:
        if type(output["index"]) is not int or type(output["level"]) is not bool:
            raise NotAPlan(f"{where}.outputs: {output!r}")
        times += [(output.get("offset_s"), -math.inf), (output.get("offset_m"), 0.0)]
    if not all(value is None or (is_number(value) and value >= least) for value, least in times):
        raise NotAPlan(f"{where}: one of its times or offsets is none")


def _check_line(line: Mapping[str, Any], where: str) -> None:
    for end in ("from", "to"):
        _check_pose(line[end], f"{where}.{end}")
    if (
        not is_number(line["speed_m_s"])
        or line["speed_m_s"] <= 0.0
        or line["from"]["position"] == line["to"]["position"]
    ):
        raise NotAPlan(f"{where}: has no speed, or no length")
    one, other = (quaternion(line[end]) for end in ("from", "to"))
    if abs(sum(a * b for a, b in zip(one, other, strict=True))) < math.sin(0.5 * OPEN_RAD):
        raise NotAPlan(f"{where}.to: is turned by half a turn: which way round is open")


def _check_pose(pose: Mapping[str, Any], where: str) -> None:
    turn = pose["rotation_vector"] if pose.get("quaternion") is None else pose["quaternion"]
    length = 3 if pose.get("quaternion") is None else 4
    if len(pose["position"]) != 3 or len(turn) != length or not all(map(is_number, [*pose["position"], *turn])):
        raise NotAPlan(f"{where}: {pose!r}")
    if length == 4 and not any(turn):
        raise NotAPlan(f"{where}.quaternion: {turn!r}")


def quaternion(pose: Mapping[str, Any]) -> list[float]:
    """Returns the unit quaternion [x, y, z, w] of a pose, by its own or by its rotation vector."""
    if pose.get("quaternion") is not None:
        size = math.hypot(*pose["quaternion"])
        return [each / size for each in pose["quaternion"]]
    vector = pose["rotation_vector"]
    angle = math.hypot(*vector)
    share = math.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    return [*(share * each for each in vector), math.cos(0.5 * angle)]


def _check_end(asked: Mapping[str, Any]) -> None:
    end = asked.get("end")
    if end is None:
        return
    if not asked.get("passages") or end["kind"] not in ("rest", "home", "joint", "pose"):
        raise NotAPlan(f"request.end: {end!r}")
    if end["kind"] == "joint" and (len(end["positions"]) != 6 or not all(map(is_number, end["positions"]))):
        raise NotAPlan(f"request.end.positions: {end['positions']!r}")
    if end["kind"] == "pose":
        _check_pose(end["pose"], "request.end.pose")


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yields the numbers and words of a document, with their paths."""
    if isinstance(value, Mapping):
        for name, each in value.items():
            yield from _leaves(each, f"{path}.{name}")
    elif isinstance(value, list):
        for i, each in enumerate(value):
            yield from _leaves(each, f"{path}[{i}]")
    else:
        yield path, value


def is_number(value: Any) -> bool:
    """Returns whether a JSON value is a number, and no truth value."""
    return isinstance(value, int | float) and not isinstance(value, bool)
