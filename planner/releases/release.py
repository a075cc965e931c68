"""What is required of a release, in terms that every room of the planner understands.

A kind of release comes down to one or two of four demands: a joint state, a tool pose and twist, a tool point and its
velocity, a target that the flight hits. Whoever looks for release states, solves or judges asks for the demands and
does not look at the kind.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from planner.arrays import Array
from planner.cell import Cell
from planner.errors import FieldError
from planner.fields import Record
from planner.geometry import ToolState
from planner.tracking import MotionUncertainty

REST_SPEED = 1e-9  # [rad/s, m/s] a release slower than this is a move that ends at rest


class JointState(NamedTuple):
    """Joint positions `q` (6,) [rad] and velocities `qd` (6,) [rad/s]."""

    q: Array
    qd: Array


class PointState(NamedTuple):
    """Position `p_WT` (3,) [m] and velocity `v_WT` (3,) [m/s] of the tool centre point."""

    p_WT: Array
    v_WT: Array


@dataclass(frozen=True)
class Opening:
    """Mouth of a round bin that is open upwards, above the target as the centre of its bottom.

    Attributes:
        radius_m: inner radius of the bin [m].
        rim_height_m: height of the rim above the target [m].
    """

    radius_m: float
    rim_height_m: float


@dataclass(frozen=True, eq=False)
class LandingAxis:
    """Which way the object's z axis lies as it first touches what it lands on; its two ends count alike.

    Attributes:
        axis_W: unit vector (3,) along it.
        tolerance_rad: largest angle from it [rad].
    """

    axis_W: Array
    tolerance_rad: float

    def angles(self, axes: Array) -> Array:
        """Returns the angles (...) [rad] of axes, unit vectors (..., 3), from it."""
        across = np.linalg.norm(np.cross(axes, self.axis_W), axis=-1)
        return np.arctan2(across, np.abs(axes @ self.axis_W))


@dataclass(frozen=True, eq=False)
class Target:
    """A point to hit by free flight, on the way down; the release state is free within these bounds.

    Attributes:
        p_W: the target (3,) [m].
        max_speed_m_s: highest release speed [m/s].
        min_elevation_rad, max_elevation_rad: elevation of the release velocity above the horizontal [rad].
        min_horizontal_distance_m: least horizontal distance from release to target [m].
        release_position: point of release (3,) [m], None where it is free.
        opening: of the bin that stands around the target, None where there is none.
        orientation: that the object is to land in; None: any.
        v_W: velocity of the target, and of the bin with it (3,) [m/s]; level.
        at_s: when a target that moves is at `p_W`, on the controller's clock [s].
        uncertainty: how well place and velocity of such a target are known then; None: exactly.
        tracked_target: id of the tracked target that they are of; None: of none. Only told.
    """

    p_W: Array
    max_speed_m_s: float = math.inf
    min_elevation_rad: float = -math.pi / 2
    max_elevation_rad: float = math.pi / 2
    min_horizontal_distance_m: float = 0.0
    release_position: Array | None = None
    opening: Opening | None = None
    orientation: LandingAxis | None = None
    v_W: Array = field(default_factory=lambda: np.zeros(3))
    at_s: float = 0.0
    uncertainty: MotionUncertainty | None = None
    tracked_target: str | None = None

    @property
    def moves(self) -> bool:
        """Whether it moves, or may, as its velocity is not known for certain."""
        return bool(self.v_W.any()) or self.uncertainty is not None


class ReleaseSample(NamedTuple):
    """A motion at its release: what a release's bounds are told of.

    Attributes:
        q, qd: joint positions [rad] and velocities [rad/s] (6,).
        tool: pose and twist of the tool.
    """

    q: Array
    qd: Array
    tool: ToolState


class Bound(NamedTuple):
    """A value at the release, and the limit that a request sets it.

    Attributes:
        value: the value.
        limit: its limit.
        unit: of both.
        detail: what the value is of; empty where that is plain.
        is_least: whether the limit is the least value instead of the largest.
        is_exact: whether the limit holds to the bit; otherwise to the certificate's tolerance.
    """

    value: float
    limit: float
    unit: str
    detail: str = ""
    is_least: bool = False
    is_exact: bool = False


@dataclass(frozen=True, eq=False)
class Release:
    """A release of one kind: its demands, its bounds at the release and its JSON.

    A kind overrides what it demands, and says nothing of the rest.

    Attributes:
        name: the JSON's `kind`.
        record: fields of its JSON, without `kind`.
        aims: whether the object is to hit something: then there is a `target`.
    """

    name: ClassVar[str]
    record: ClassVar[Record]
    aims: ClassVar[bool] = False

    @property
    def joint_state(self) -> JointState | None:
        """The joint state; None where it is not given."""
        return None

    @property
    def tool_state(self) -> ToolState | None:
        """The tool's pose and twist; None where they are not given, or follow from the joint state."""
        return None

    @property
    def point_state(self) -> PointState | None:
        """Position and velocity of the tool centre point alone; None where they are not given, or more is."""
        return None

    @property
    def target(self) -> Target | None:
        """What the flight is to hit, and the bounds on the release to that end; None where that is open."""
        return None

    @property
    def fixes_joints(self) -> bool:
        """Whether a motion reaches one of the joint states at the release as it is, be it all or part of the demand.

        Of a joint state there is one, of a pose one for each branch.
        """
        return self.joint_state is not None or self.tool_state is not None

    @property
    def is_at_rest(self) -> bool:
        """Whether the demanded state is at rest; such a move throws nothing."""
        state = self.joint_state or self.tool_state or self.point_state
        return state is not None and bool(np.abs(state[1]).max() < REST_SPEED)

    @property
    def lasts_s(self) -> float:
        """Time for which the demand goes on [s]: 0 of a state, that of a line."""
        return 0.0

    def with_target(self, target: Target) -> Self:
        """Returns this release with another target; for kinds that have one."""
        raise NotImplementedError(f"a release of kind {self.name} has no target")

    def slower(self, share: float) -> Self:
        """Returns this release with a share of its velocity; for kinds that have one."""
        raise NotImplementedError(f"a release of kind {self.name} has no velocity")

    def moved_to(self, p_WT: Array) -> Self:
        """Returns this release with the tool at another position (3,); for kinds that have one."""
        raise NotImplementedError(f"a release of kind {self.name} has no tool position")

    def towards(self, q_0: Array, X_W0: Array, share: float) -> Self:
        """Returns this release at a share of the way to its own joint positions or tool pose; for kinds that have them.

        Args:
            q_0: joint positions (6,) from which the way leads [rad].
            X_W0: the tool's pose (4, 4) there.
            share: of the way; the velocity stays.
        """
        raise NotImplementedError(f"a release of kind {self.name} has no state")

    def errors(self, cell: Cell) -> list[FieldError]:
        """Returns every field that contradicts another one or the cell."""
        return []

    def position_bounds(self, at: ReleaseSample) -> list[Bound]:
        """Returns what the request says of the place of the release; empty where that is free."""
        raise NotImplementedError

    def velocity_bounds(self, at: ReleaseSample) -> list[Bound]:
        """Returns what the request says of the velocity of the release; empty where that is free."""
        raise NotImplementedError

    @classmethod
    def from_json(cls, given: Mapping[str, Any], X_WR: Array) -> Self:
        """Returns the release in the world.

        Args:
            given: the fields, checked by `record`.
            X_WR: pose of the request's frame.
        """
        raise NotImplementedError

    def to_json(self) -> dict[str, Any]:
        """Returns the fields of the release, in the world frame."""
        raise NotImplementedError


def between(near: Array, far: Array, share: float) -> Array:
    """Returns the position at a share of the way from `near` to `far`."""
    return (1.0 - share) * near + share * far


def move(X_WR: Array, p: list[float]) -> Array:
    """Returns a point of the request's frame in the world frame."""
    return X_WR[:3, :3] @ np.array(p) + X_WR[:3, 3]


def turn(X_WR: Array, v: list[float]) -> Array:
    """Returns a vector of the request's frame in the world frame."""
    return X_WR[:3, :3] @ np.array(v)
