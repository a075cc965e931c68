"""Kind `belt`, a sketch: hit a target that a belt carries, some time after it was seen.

The kind `target` does this as it should be done: it starts in time, and its release window moves with the belt.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np

from planner.arrays import Array
from planner.fields import Number, Record, Vector, required
from planner.releases import TargetRelease
from planner.releases.release import turn


@dataclass(frozen=True, eq=False)
class BeltRelease(TargetRelease):
    """Hit a target that moves, where it then is.

    Attributes:
        p_W: where object and target meet (3,) [m].
        carried: velocity of the target (3,) [m/s].
        meets_after_s: time from when the target was seen to the landing [s].
    """

    carried: Array = field(default_factory=lambda: np.zeros(3))
    meets_after_s: float = 0.0

    name: ClassVar[str] = "belt"
    record: ClassVar[Record] = Record(
        "BeltReleaseRequest",
        "Hit a point on a belt by free flight; the planner chooses the release.",
        {
            **TargetRelease.record.fields,
            "belt_velocity": required(Vector(3), "Velocity of the target, in `frame` [m/s]."),
            "meets_after_s": required(Number(0.0), "Time from the target at `position` to the landing [s]."),
        },
    )

    @classmethod
    def from_json(cls, given: Mapping[str, Any], X_WR: Array) -> Self:
        """Returns the release in the world."""
        seen = vars(TargetRelease.from_json(given, X_WR))
        carried = turn(X_WR, given["belt_velocity"])
        after_s = given["meets_after_s"]
        return cls(**{**seen, "p_W": seen["p_W"] + after_s * carried}, carried=carried, meets_after_s=after_s)

    def to_json(self) -> dict[str, Any]:
        """Returns the target as it was seen, and its velocity, in the world."""
        return {
            **super().to_json(),
            "position": (self.p_W - self.meets_after_s * self.carried).tolist(),
            "belt_velocity": self.carried.tolist(),
            "meets_after_s": self.meets_after_s,
        }
