"""The motions of a job as planning requests: to a pick, and from one pick over a throw to the next.

    rest at pick k → line up → throw → line down → rest at pick k + 1

Each is one plan of passages (docs/decisions/0031-passages.md), at rest at its picks alone. A line ends a little above
the pick: from there the tool brakes, about evenly, on what is left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

# [m/s^2] of the tool on its last way down. With less room (2 m/s^2) a UR3e near a singularity cannot brake in it, and
# dips 3 mm below the pick; with more the tool gains speed first. python -m benchmarks.cycles measures both.
BRAKE_M_S2 = 1.5
UP = (0.0, 0.0, 1.0)  # in the world


@dataclass(frozen=True)
class PickLines:
    """The vertical lines above picks.

    Attributes:
        approach_m: height above the pick at which they begin, and at which those upwards end [m].
        speed_m_s: speed of the tool along them [m/s].
    """

    approach_m: float
    speed_m_s: float

    @property
    def brake_m(self) -> float:
        """Height above the pick at which the line down ends, and the line up begins [m]."""
        return self.speed_m_s**2 / (2.0 * BRAKE_M_S2)

    def down(self, pick: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the passage down to a pose."""
        return self._passage("down", raised(pick, self.approach_m), raised(pick, self.brake_m))

    def up(self, pick: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the passage up from a pose."""
        return self._passage("up", raised(pick, self.brake_m), raised(pick, self.approach_m))

    def _passage(self, name: str, begins: Mapping[str, Any], ends: Mapping[str, Any]) -> dict[str, Any]:
        return {"name": name, "line": {"from": begins, "to": ends, "speed_m_s": self.speed_m_s}}


def motion_request(
    cell: str,
    start: Sequence[float],
    lines: PickLines,
    rises_from: Mapping[str, Any] | None = None,
    target: Mapping[str, Any] | None = None,
    next_pick: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Returns the request of one motion, as `POST /plan` takes it.

    Args:
        cell: name of the cell.
        start: joint positions at rest (6,) [rad].
        lines: above the picks.
        rises_from: pose of the pick at which it starts; None: it starts elsewhere.
        target: what to throw at, a release of kind `target`; None: nothing is let go.
        next_pick: pose of the pick at which it ends at rest; None: it ends at home.
    """
    passages = [] if rises_from is None else [lines.up(rises_from)]
    if target is not None:
        passages.append({"name": "throw", "state": dict(target), "releases": True})
    end: dict[str, Any] = {"kind": "home"}
    if next_pick is not None:
        passages.append(lines.down(next_pick))
        end = {"kind": "pose", "pose": dict(next_pick)}
    return {"cell": cell, "start": {"positions": list(start)}, "passages": passages, "end": end}


def raised(pose: Mapping[str, Any], height_m: float) -> dict[str, Any]:
    """Returns a pose that is higher by so much [m]."""
    position = [p + height_m * u for p, u in zip(pose["position"], UP, strict=True)]
    return {**pose, "position": position}
