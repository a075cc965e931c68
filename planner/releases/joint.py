"""Kind `joint`: pass a joint state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from planner.arrays import Array, read_only
from planner.fields import Record, Vector, required
from planner.releases.release import Bound, JointState, Release, ReleaseSample, between


@dataclass(frozen=True, eq=False)
class JointRelease(Release):
    """Release at joint positions `q` (6,) [rad] with joint velocities `qd` (6,) [rad/s]."""

    q: Array
    qd: Array

    name: ClassVar[str] = "joint"
    record: ClassVar[Record] = Record(
        "JointReleaseRequest",
        "Pass a joint state.",
        {
            "positions": required(Vector(6), "Joint positions at the release [rad]."),
            "velocities": required(Vector(6), "Joint velocities at the release [rad/s]."),
        },
    )

    @property
    def joint_state(self) -> JointState:
        """The joint state."""
        return JointState(self.q, self.qd)

    def slower(self, share: float) -> Self:
        """Returns this release with a share of its velocity."""
        return replace(self, qd=share * self.qd)

    def towards(self, q_0: Array, X_W0: Array, share: float) -> Self:
        """Returns this release with positions at a share of the way from `q_0`."""
        return replace(self, q=between(q_0, self.q, share))

    def position_bounds(self, at: ReleaseSample) -> list[Bound]:
        """Returns the largest deviation of a joint's position."""
        return [Bound(float(np.abs(at.q - self.q).max()), 0.0, "rad")]

    def velocity_bounds(self, at: ReleaseSample) -> list[Bound]:
        """Returns the largest deviation of a joint's velocity."""
        return [Bound(float(np.abs(at.qd - self.qd).max()), 0.0, "rad/s")]

    @classmethod
    def from_json(cls, given: Mapping[str, Any], X_WR: Array) -> Self:
        """Returns the release: joints have no frame."""
        return cls(read_only(given["positions"]), read_only(given["velocities"]))

    def to_json(self) -> dict[str, Any]:
        """Returns positions and velocities."""
        return {"positions": self.q.tolist(), "velocities": self.qd.tolist()}
