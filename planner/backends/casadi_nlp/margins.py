"""Safety margins of the optimiser's rows, and which of them a failed check of the certificate widens.

The rows hold at knots and in the middle of each step; the certificate checks all times. What it finds missing between
them is added to the margin, and the problem is solved again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Protocol

from planner.backends.casadi_nlp.layout import ARM_CAPSULES
from planner.backends.casadi_nlp.tuning import (
    OPENING_RAD,
    OVER,
    ROOM_M,
    USABLE,
)
from planner.cell import SAFETY_LIMITS

SPARE_M = 0.001  # [m], [rad] beyond `OVER` times what is missing
SPARE_SHARE = 0.01  # [-] of a limit beyond what is missing
DIAGONAL = math.sqrt(2.0)  # the optimiser bounds a landing error in x and y, the certificate its norm

# What each check's rows keep: a share of a limit, or a distance from it.
SHARES = {"joint_torque": "torque", "tcp_speed": "tcp_speed", "grip_acceleration": "grip", "landing_window": "window"}
DISTANCES = {
    "self_collision": "self_m",
    "floor": "floor_m",
    "keep_in": "keep_in_m",
    "keep_out": "shape_m",
    "joint_position": "position_rad",
}
POSITIONS = "positions"  # group of the joints' position limits: bounds of variables, and rows of block "motion"
# The groups of rows that margins belong to.
GROUPS = {
    "effort": ("torque", "tcp_speed"),
    "clearance": ("self_m", "floor_m", "keep_in_m"),
    "keep_out": ("shape_m",),
    "rooms": ("keep_in_m",),
    POSITIONS: ("position_rad",),
    "grip": ("grip",),
    "flight": ("flight_m", "mouth_m", "opening_rad", "leaves"),
    "standing": ("standing_m",),
    "leaving": ("leaves",),
    "passing": ("passing_m",),
}
# Checks that no rows bound: the power of limit over value by which the tool has to be slower at the worst time.
SLOWED = {limit.check: 1.0 / limit.growth for limit in SAFETY_LIMITS.values() if limit.check not in SHARES}
LINKS = ARM_CAPSULES.keys() - {"base"}  # of block "passing"
STANDING = {"foot", "base"}  # of block "standing"


class FailedCheck(Protocol):
    """A failed check of a certificate."""

    @property
    def name(self) -> str:
        """Name of the check, such as "floor"."""
        ...

    @property
    def value(self) -> float:
        """The worst value."""
        ...

    @property
    def limit(self) -> float:
        """The limit that it violates."""
        ...

    @property
    def at_s(self) -> float | None:
        """Time of the worst value [s]."""
        ...

    @property
    def detail(self) -> str:
        """What the value is of, such as the name of a link."""
        ...


@dataclass(frozen=True)
class Margins:
    """Margins on every limit.

    Attributes:
        torque: usable share of the limit [-].
        tcp_speed: the same.
        grip: usable share of what the grip withstands [-].
        window: usable share of the landing tolerance in the release window, in x and in y [-].
        floor_m: added to the required clearance [m].
        self_m: the same; none, because the optimiser's distance is slightly smaller than the true one.
        keep_in_m: the same.
        shape_m: the same.
        position_rad: distance from a joint's position limits [rad].
        singularity: multiple of the required distance [-].
        flight_m: room between the object's flight and the boxes that it passes.
        mouth_m: the same at the rim of a bin.
        passing_m: room between the object in flight and the braking arm.
        standing_m: the same for what never moves of the arm.
        opening_rad: by which the gripper's opening cone is narrowed [rad].
        heeds_shapes: whether there are rows for shapes; of more than there are slots for, not before one was met.
        leaves: whether block "leaving" follows the object on its way out of the grip, in place of the row "out".
    """

    torque: float = USABLE
    tcp_speed: float = USABLE
    grip: float = USABLE
    window: float = USABLE / DIAGONAL
    floor_m: float = ROOM_M
    self_m: float = 0.0
    keep_in_m: float = ROOM_M
    shape_m: float = ROOM_M
    position_rad: float = 0.001
    singularity: float = 1.0 / USABLE
    flight_m: float = ROOM_M
    mouth_m: float = ROOM_M
    passing_m: float = ROOM_M
    standing_m: float = ROOM_M
    opening_rad: float = OPENING_RAD
    heeds_shapes: bool = True
    leaves: bool = False

    def widened(self, failures: Iterable[FailedCheck], tool_speed: Callable[[float], float]) -> Margins | None:
        """Returns the margins after a motion's failed checks, None if a margin is no remedy for one of them.

        Args:
            failures: the failed checks.
            tool_speed: the motion's at a time [s], over its limit.
        """
        wider: Margins | None = self
        for check in failures:
            wider = wider and wider._widened_for(check, tool_speed)
        return wider

    @property
    def widened_groups(self) -> frozenset[str]:
        """The groups of rows that some margin was widened of."""
        return frozenset(
            group
            for group, names in GROUPS.items()
            if any(getattr(self, name) != getattr(DEFAULT_MARGINS, name) for name in names)
        )

    def _widened_for(self, check: FailedCheck, tool_speed: Callable[[float], float]) -> Margins | None:
        missing = abs(check.value - check.limit)
        if check.name in SHARES:
            share = missing / check.limit / (DIAGONAL if check.name == "landing_window" else 1.0)
            return self._with_share(SHARES[check.name], getattr(self, SHARES[check.name]) - share)
        if check.name == "keep_out" and not self.heeds_shapes:
            return replace(self, heeds_shapes=True)
        if check.name in DISTANCES:
            return self._with_more(missing, DISTANCES[check.name])
        if check.name == "flight_clearance":
            return self._with_more(missing, *_flight_margins(check))
        if check.name == "opening_direction":
            return self._with_way_out(missing)
        if check.name == "singularity_distance":
            return replace(self, singularity=self.singularity + missing / check.limit + SPARE_SHARE)
        if check.name in SLOWED and check.at_s is not None:
            slower = (check.limit / check.value) ** SLOWED[check.name]
            return self._with_share("tcp_speed", slower * min(tool_speed(check.at_s), self.tcp_speed))
        return None

    def _with_share(self, name: str, share: float) -> Margins | None:
        """Returns the margins with a share of a limit, a little less; None where none is left."""
        return replace(self, **{name: share - SPARE_SHARE}) if share > SPARE_SHARE else None

    def _with_more(self, missing: float, *names: str) -> Margins:
        """Returns the margins with distances that are wider by what is missing, and a little more."""
        return replace(self, **{name: getattr(self, name) + OVER * missing + SPARE_M for name in names})

    def _with_way_out(self, missing_rad: float) -> Margins:
        """Returns the margins that follow the object's way out; once they do, with a narrower opening."""
        if not self.leaves:
            return replace(self, leaves=True)
        return replace(self, opening_rad=self.opening_rad + OVER * missing_rad + OPENING_RAD)


DEFAULT_MARGINS = Margins()


def meets_arm(check: FailedCheck) -> bool:
    """Returns whether a failed check is of a flight that meets a link, which can brake another way."""
    return check.name == "flight_clearance" and check.detail in LINKS


def _flight_margins(check: FailedCheck) -> tuple[str, ...]:
    """Returns the margins of what a flight meets: a link, what never moves of the arm, or the surroundings."""
    if meets_arm(check):
        return ("passing_m",)
    return ("standing_m",) if check.detail in STANDING else ("flight_m", "mouth_m")
