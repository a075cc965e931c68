"""Requests as typed objects: what a motion must pass, and what it is to respect.

A release is one of `Joint`, `Pose`, `Point` and `Target`; their fields are those of `POST /plan`, with the same units.
A list of `Passage` is passed one after another::

    fling.plan(fling.Target([1.2, 0.3, 0.0]), "ur5e-sim", release_window_s=0.01)
    fling.plan([fling.Passage("camera", fling.Point([0.5, 0.2, 0.6], [0.8, 0.3, 0.6]))], end={"kind": "home"})
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypedDict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Numbers = Sequence[float] | NDArray[Any]

Backend = Literal["auto", "casadi", "ruckig", "toppra", "cubic", "trapezoid", "ramp"]


class Limits(TypedDict, total=False):
    """Tighter limits than the cell's: one number for all joints, or six."""

    velocity: float | Numbers  # [rad/s]
    acceleration: float | Numbers  # [rad/s^2]
    jerk: float | Numbers  # [rad/s^3]


class Options(TypedDict, total=False):
    """What a request may state beside its release; `POST /plan` says what an absent field means."""

    start: Numbers | Mapping[str, Any]  # joint positions (6,) [rad]; default: the cell's home
    end: Mapping[str, Any]  # of passages: where they come to rest; default: anywhere
    frame: Literal["world", "base"]  # of positions and velocities in the request
    backend: Backend
    limits: Limits
    singularity_distance_min: float  # [-]
    release_window_s: float  # [s]
    landing_tolerance_m: float  # [m]
    min_hit_probability: float  # [-] for the service: the library plans without odds
    starts_not_before_s: float  # [s] to a target that moves, on the controller's clock
    time_limit_s: float  # [s]


@dataclass(frozen=True)
class Joint:
    """Pass a joint state.

    Attributes:
        positions: joint positions (6,), base to wrist 3 [rad].
        velocities: joint velocities (6,) [rad/s].
    """

    kind: ClassVar[str] = "joint"
    positions: Numbers
    velocities: Numbers

    def as_document(self) -> dict[str, Any]:
        """Returns the release as JSON."""
        return plain_values({"kind": self.kind, "positions": self.positions, "velocities": self.velocities})


@dataclass(frozen=True)
class Pose:
    """Pass a tool pose with a twist. Give a rotation vector or a quaternion.

    Attributes:
        position: of the tool centre point (3,) [m].
        linear: its velocity (3,) [m/s].
        angular: the tool's angular velocity (3,) [rad/s].
        rotation_vector: orientation (3,) [rad].
        quaternion: orientation [x, y, z, w] (4,).
    """

    kind: ClassVar[str] = "pose"
    position: Numbers
    linear: Numbers
    angular: Numbers = (0.0, 0.0, 0.0)
    rotation_vector: Numbers | None = None
    quaternion: Numbers | None = None

    def as_document(self) -> dict[str, Any]:
        """Returns the release as JSON."""
        orientation = {"rotation_vector": self.rotation_vector, "quaternion": self.quaternion}
        pose = {"position": self.position, **_given(orientation)}
        return plain_values(
            {"kind": self.kind, "pose": pose, "twist": {"linear": self.linear, "angular": self.angular}}
        )


@dataclass(frozen=True)
class Point:
    """Pass a point with a velocity of the tool centre point; the orientation is free.

    Attributes:
        position: (3,) [m].
        velocity: (3,) [m/s].
    """

    kind: ClassVar[str] = "point"
    position: Numbers
    velocity: Numbers

    def as_document(self) -> dict[str, Any]:
        """Returns the release as JSON."""
        return plain_values({"kind": self.kind, "position": self.position, "velocity": self.velocity})


@dataclass(frozen=True)
class Bin:
    """A round bin that is open upwards, about a target as the centre of its bottom.

    Attributes:
        radius_m: inner radius [m].
        rim_height_m: height of the rim above the target [m].
    """

    radius_m: float
    rim_height_m: float


@dataclass(frozen=True)
class Target:
    """Hit a place by free flight; the planner chooses where and how fast to let go.

    Attributes:
        position: of the place (3,) [m]; or `{"target": id}`, of a target that the service tracks.
        opening: the bin around it; its fields in a mapping do, too.
        max_release_speed_m_s: highest speed of the object at the release [m/s].
        min_elevation_rad: least elevation of its velocity above the horizon [rad].
        max_elevation_rad: largest elevation [rad].
        min_horizontal_distance_m: least horizontal distance from the release to the target [m].
        release_position: where to let go (3,) [m].
        orientation: how an object that is no ball lands: `axis` (3,) and `tolerance_rad`.
        velocity: of a place that moves, with its bin (3,) [m/s]; level.
        observed_at_s: when it was at `position`, on the controller's clock [s].
        uncertainty: how well both are known: `position_std_m`, `velocity_std_m_s`, `correlation`, `drift_m_s`.
        tracked_target: id of the tracked target whose numbers these are.
    """

    kind: ClassVar[str] = "target"
    position: Numbers | Mapping[str, str]
    opening: Bin | Mapping[str, float] | None = None
    max_release_speed_m_s: float | None = None
    min_elevation_rad: float | None = None
    max_elevation_rad: float | None = None
    min_horizontal_distance_m: float | None = None
    release_position: Numbers | None = None
    orientation: Mapping[str, Any] | None = None
    velocity: Numbers | None = None
    observed_at_s: float | None = None
    uncertainty: Mapping[str, float] | None = None
    tracked_target: str | None = None

    def as_document(self) -> dict[str, Any]:
        """Returns the release as JSON."""
        return plain_values({"kind": self.kind, **_given(vars(self))})


Release = Joint | Pose | Point | Target


@dataclass(frozen=True)
class Line:
    """Pass a straight line of the tool at constant speed. Give a rotation vector or a quaternion.

    Attributes:
        start: of the tool centre point (3,) [m].
        end: (3,) [m].
        speed_m_s: of the tool centre point [m/s].
        rotation_vector: orientation (3,) [rad].
        quaternion: orientation [x, y, z, w] (4,).
        end_rotation_vector: orientation at the end, to which the tool turns evenly (3,) [rad]; None: the same.
        end_quaternion: likewise (4,).
    """

    start: Numbers
    end: Numbers
    speed_m_s: float
    rotation_vector: Numbers | None = None
    quaternion: Numbers | None = None
    end_rotation_vector: Numbers | None = None
    end_quaternion: Numbers | None = None

    def as_document(self) -> dict[str, Any]:
        """Returns the line as JSON."""
        first = _given({"rotation_vector": self.rotation_vector, "quaternion": self.quaternion})
        last = _given({"rotation_vector": self.end_rotation_vector, "quaternion": self.end_quaternion})
        poses = {"from": {"position": self.start, **first}, "to": {"position": self.end, **(last or first)}}
        return plain_values({**poses, "speed_m_s": self.speed_m_s})


@dataclass(frozen=True)
class Output:
    """A digital output that switches about a passage.

    Attributes:
        output: "standard_digital", "configurable_digital" or "tool_digital".
        index: number of the output.
        level: that it changes to.
        offset_s: from the passage to the edge [s]; negative before it.
        offset_m: place on a line, from its start [m]: `offset_s` counts from when the tool is there.
    """

    output: str
    index: int
    level: bool = True
    offset_s: float = 0.0
    offset_m: float | None = None


@dataclass(frozen=True)
class Passage:
    """A state or a line to pass, and what switches about it.

    Attributes:
        name: of its own in the motion.
        state: to be passed, or the line.
        outputs: what switches about it.
        releases: whether the object leaves the tool there; a name: that of one of the cell's `[grippers]`.
        at_s: time from the motion's start [s].
        not_before_s: earliest time from the motion's start [s].
    """

    name: str
    state: Release | Line
    outputs: Sequence[Output] = ()
    releases: bool | str = False
    at_s: float | None = None
    not_before_s: float | None = None

    def as_document(self) -> dict[str, Any]:
        """Returns the passage as JSON."""
        given = _given({"at_s": self.at_s, "not_before_s": self.not_before_s, "releases": self.releases or None})
        outputs = [_given(vars(output)) for output in self.outputs]
        what = "line" if isinstance(self.state, Line) else "state"
        return plain_values({"name": self.name, what: self.state.as_document(), "outputs": outputs, **given})


Request = Mapping[str, Any] | Release | Sequence[Passage]


def request_of(asked: Request, options: Mapping[str, Any]) -> Any:
    """Returns a request in the shape of `POST /plan`, in plain values: a release or a request, and options to it.

    What is neither a release, nor passages, nor a request stays, for the planner's own refusal to name it.
    """
    if isinstance(asked, Release):
        return request_of({"release": asked}, options)
    if isinstance(asked, list | tuple):
        return request_of({"passages": asked}, options)
    if not isinstance(asked, Mapping):
        return asked
    request = {**asked, **options}
    release = request.get("release")
    if isinstance(release, Release):
        request["release"] = release.as_document()
    passages = request.get("passages")
    if isinstance(passages, list | tuple):
        request["passages"] = [each.as_document() if isinstance(each, Passage) else each for each in passages]
    start = request.get("start")
    if "start" in options and start is not None and not isinstance(start, Mapping):
        request["start"] = {"positions": start}
    return plain_values(request)


def _given(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the fields that are given."""
    return {name: value for name, value in fields.items() if value is not None}


def plain_values(value: Any) -> Any:
    """Returns a value as JSON has it."""
    from planner.arrays import plain  # loads numpy, which a client that plans nothing does without

    return plain(value)
