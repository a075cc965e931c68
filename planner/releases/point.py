"""Kind `point`: pass a point with a velocity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from planner.arrays import Array
from planner.fields import Record, Vector, required
from planner.releases.release import Bound, PointState, Release, ReleaseSample, between, move, turn


@dataclass(frozen=True, eq=False)
class PointRelease(Release):
    """Release at the point `p_WT` (3,) [m] with the velocity `v_WT` (3,) [m/s]; orientation and spin are free."""

    p_WT: Array
    v_WT: Array

    name: ClassVar[str] = "point"
    record: ClassVar[Record] = Record(
        "PointReleaseRequest",
        "Pass a point with a velocity; orientation and angular velocity are free.",
        {
            "position": required(Vector(3), "Position of the tool centre point at the release, in `frame` [m]."),
            "velocity": required(Vector(3), "Its velocity, in `frame` [m/s]."),
        },
    )

    @property
    def point_state(self) -> PointState:
        """Position and velocity of the tool centre point."""
        return PointState(self.p_WT, self.v_WT)

    def slower(self, share: float) -> Self:
        """Returns this release with a share of its velocity."""
        return replace(self, v_WT=share * self.v_WT)

    def moved_to(self, p_WT: Array) -> Self:
        """Returns this release at another point."""
        return replace(self, p_WT=p_WT)

    def towards(self, q_0: Array, X_W0: Array, share: float) -> Self:
        """Returns this release at a share of the way from the tool pose's position."""
        return self.moved_to(between(X_W0[:3, 3], self.p_WT, share))

    def position_bounds(self, at: ReleaseSample) -> list[Bound]:
        """Returns the distance from the point."""
        return [Bound(float(np.linalg.norm(at.tool.p_WT - self.p_WT)), 0.0, "m")]

    def velocity_bounds(self, at: ReleaseSample) -> list[Bound]:
        """Returns the deviation of the velocity."""
        return [Bound(float(np.linalg.norm(at.tool.v_WT - self.v_WT)), 0.0, "m/s")]

    @classmethod
    def from_json(cls, given: Mapping[str, Any], X_WR: Array) -> Self:
        """Returns the release in the world."""
        return cls(move(X_WR, given["position"]), turn(X_WR, given["velocity"]))

    def to_json(self) -> dict[str, Any]:
        """Returns position and velocity in the world."""
        return {"position": self.p_WT.tolist(), "velocity": self.v_WT.tolist()}
