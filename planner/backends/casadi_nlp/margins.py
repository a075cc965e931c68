"""Safety margins on constraints enforced only at knots and midpoints; widened from failed certificate checks.

The certificate also checks the motion between them. What it finds missing there is added as a margin around that time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Protocol

from planner.solution import Solution
from planner.trajectory import Trajectory

SPARE_M = 0.001  # [m] added to a missing clearance: the next solution passes elsewhere
SPARE_SHARE = 0.01  # [-] the same for a share of a limit
BETWEEN_KNOTS_FACTOR = 1.5  # [-] margin at knots and midpoints per clearance missing between them
MOST_SHARE = 0.4  # [-] of a limit; beyond it a margin is no remedy
MOST_M = 0.1  # [m] the same for a clearance
MOST_EVERYWHERE_M = 0.01  # [m] the same for a clearance margin along the whole motion
MOST_RAD = 0.2  # [rad] the same for a joint position
FOLLOWED_OPENING_RAD = 0.1  # [rad] by which the opening is narrower where the object's way out is followed
OPENING_FACTOR = 2.5  # [-] of an angle missing there, with `FOLLOWED_OPENING_RAD` once more: by releases without rows
MOST_OPENING_RAD = 0.6  # [rad] missing angle beyond which a margin is no remedy
# Checks of what the arm's own safety system watches, which no rows bound: the power of limit over value that the tool's
# speed at the worst time is to be multiplied by.
SLOWED = {"stopping_time": 1.0, "stopping_distance": 0.5, "elbow_speed": 1.0, "momentum": 1.0, "power": 1.0}
LINKS = {"shoulder", "upper_arm", "elbow", "forearm", "wrist_1", "wrist_2", "wrist_3"}  # of block "passing"
POSITIONS = "positions"  # group of the joints' position limits: bounds of variables, and rows of block "motion"
STANDING = {"foot", "base"}  # of block "standing"
DIAGONAL = math.sqrt(2.0)  # the optimiser bounds a landing error in x and y, the certificate its norm


@dataclass(frozen=True)
class LocalCheck:
    """The rows that a certificate check is enforced by.

    Attributes:
        group: of `layout.LAZY_GROUPS`.
        rows: of the group.
        is_relative: whether margins are shares of the limit [-] instead of clearances [m].
        upper: whether the rows have an upper bound to be lowered.
        lower: whether they have a lower bound to be raised.
        everywhere: the margin of `Margins` that applies along the whole motion, if there is one.
    """

    group: str
    rows: slice
    is_relative: bool = False
    upper: bool = False
    lower: bool = True
    everywhere: str | None = None


LOCAL_CHECKS = {
    "joint_torque": LocalCheck("effort", slice(0, 6), is_relative=True, upper=True),
    "tcp_speed": LocalCheck("effort", slice(6, 7), is_relative=True, upper=True, lower=False),
    "self_collision": LocalCheck("clearance", slice(0, 1), everywhere="self_m"),
    "floor": LocalCheck("clearance", slice(1, 2), everywhere="floor_m"),
    "keep_in": LocalCheck("clearance", slice(2, 3), everywhere="keep_in_m"),
    "keep_out": LocalCheck("keep_out", slice(0, 1), everywhere="box_m"),
    "grip_acceleration": LocalCheck("grip", slice(0, 4), is_relative=True, upper=True),
}


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
class LocalMargin:
    """A margin around one time of the motion.

    Attributes:
        check: key of `LOCAL_CHECKS`.
        phase: share of the launch's duration, 0 to 1, or 1 + share of the brake's.
        amount: share of the limit [-], or clearance [m].
    """

    check: str
    phase: float
    amount: float


@dataclass(frozen=True)
class Margins:
    """Margins on every limit.

    Attributes:
        torque: usable share of the limit [-].
        tcp_speed: the same.
        floor_m: added to the required clearance [m].
        self_m: the same; negative, because the optimiser's distance is slightly smaller than the true one.
        keep_in_m: the same.
        box_m: the same; larger, because a hand can pass a corner between knot and midpoint.
        position_rad: distance from a joint's position limits [rad].
        singularity: multiple of the required distance [-].
        watched: whether the stages on which that distance is kept last as long as the certificate watches it.
        grip: usable share of what the grip withstands [-].
        flight_m: room between the object's flight and the boxes that it passes.
        mouth_m: the same at the rim of a bin.
        opening_rad: by which the gripper's opening cone is narrowed [rad].
        leaves: whether block "leaving" follows the object on its way out of the grip, in place of the row "out".
        passing_m: room between the object in flight and the braking arm.
        standing_m: the same for what never moves of the arm.
        window: usable share of the landing tolerance in the release window, in x and in y [-].
        local: margins around a time.
        held: groups of rows to include from the beginning.
    """

    torque: float = 0.98
    tcp_speed: float = 0.985
    floor_m: float = 0.0005
    self_m: float = -0.0005
    keep_in_m: float = 0.0005
    box_m: float = 0.003
    position_rad: float = 0.001
    singularity: float = 1.03
    watched: bool = False
    grip: float = 0.98
    flight_m: float = 0.015
    mouth_m: float = 0.002
    opening_rad: float = 0.03
    leaves: bool = False
    passing_m: float = 0.002
    standing_m: float = 0.002
    window: float = 0.62
    local: tuple[LocalMargin, ...] = ()
    held: frozenset[str] = frozenset()

    @property
    def are_default(self) -> bool:
        """Whether no margin was widened; rows may be held."""
        return replace(self, held=frozenset()) == DEFAULT_MARGINS

    def widened(
        self,
        failures: Iterable[FailedCheck],
        solution: Solution,
        tool_speed: Callable[[float], float] | None = None,
    ) -> Margins | None:
        """Returns the margins after a solution's failed checks, None if a margin is no remedy for one of them.

        Args:
            failures: the failed checks.
            solution: that failed them.
            tool_speed: the solution's at a time [s], over its limit; without it there is no remedy for `SLOWED` checks.
        """
        wider: Margins | None = replace(self, held=self.held | solution.held)
        for check in failures:
            if check.name in SLOWED and check.at_s is not None and tool_speed is not None:
                wider = wider and wider._slower(check, tool_speed(check.at_s))
            else:
                wider = wider and wider._widened_for(check, solution.trajectory)
        return wider

    def _slower(self, check: FailedCheck, speed: float) -> Margins | None:
        """Returns the margins with a slower tool all along, which had that speed at the worst time, over its limit."""
        share = (check.limit / check.value) ** SLOWED[check.name] - SPARE_SHARE
        if share < 1.0 - MOST_SHARE:
            return None
        slower = min(speed, self.tcp_speed) * share
        return replace(self, tcp_speed=slower, held=self.held | {LOCAL_CHECKS["tcp_speed"].group})

    def _widened_for(self, check: FailedCheck, failed: Trajectory) -> Margins | None:
        missing = abs(check.value - check.limit)
        if check.name == "singularity_distance":
            more = (missing / check.limit if self.watched else 0.0) + SPARE_SHARE  # at first it may not be watched
            return replace(self, singularity=self.singularity + more, watched=True)
        if check.name == "joint_position" and missing < MOST_RAD:
            return replace(self, position_rad=self.position_rad + BETWEEN_KNOTS_FACTOR * missing)
        if check.name == "landing_window":
            left = self.window - missing / check.limit / DIAGONAL - SPARE_SHARE
            return replace(self, window=left) if left > 0.0 else None
        if check.name in ("flight_clearance", "opening_direction"):
            return self._widened_for_flight(check, missing)
        return self._widened_locally(check, missing, failed)

    def _widened_for_flight(self, check: FailedCheck, missing: float) -> Margins | None:
        held = replace(self, held=self.held | {"flight"})
        if check.name == "opening_direction":
            return self._with_way_out(missing)
        more = BETWEEN_KNOTS_FACTOR * missing + SPARE_M
        if meets_base(check):
            wider = replace(self, held=self.held | {"standing"}, standing_m=self.standing_m + more)
            return wider if wider.standing_m < MOST_M else None
        if meets_arm(check):
            wider = replace(self, held=self.held | {"passing"}, passing_m=min(self.passing_m + more, MOST_M))
            return wider if self.passing_m < MOST_M else None
        wider = replace(held, flight_m=self.flight_m + more, mouth_m=self.mouth_m + more)
        return wider if wider.flight_m < MOST_M else None

    def _with_way_out(self, missing_rad: float) -> Margins | None:
        """Returns the margins that follow the object's way out; once they do, with a narrower opening."""
        held = self.held | {"flight", "leaving"}
        if not self.leaves:
            return replace(self, held=held, leaves=True, opening_rad=FOLLOWED_OPENING_RAD)
        narrower = self.opening_rad + OPENING_FACTOR * missing_rad + FOLLOWED_OPENING_RAD
        return replace(self, held=held, opening_rad=narrower) if missing_rad < MOST_OPENING_RAD else None

    def _widened_locally(self, check: FailedCheck, missing: float, failed: Trajectory) -> Margins | None:
        local = LOCAL_CHECKS.get(check.name)
        if local is None or check.at_s is None:
            return None
        amount = missing / check.limit + SPARE_SHARE if local.is_relative else BETWEEN_KNOTS_FACTOR * missing + SPARE_M
        if amount > (MOST_SHARE if local.is_relative else MOST_M):
            return None
        is_repeated = any(margin.check == check.name for margin in self.local)
        if is_repeated and local.everywhere is not None and amount < MOST_EVERYWHERE_M:
            # With the first margin the motion passed as close at another time.
            return replace(self, **{local.everywhere: getattr(self, local.everywhere) + amount})
        margin = LocalMargin(check.name, _phase(check.at_s, failed), amount)
        return replace(self, local=(*self.local, margin), held=self.held | {local.group})


def _phase(t: float, motion: Trajectory) -> float:
    release = motion.release_time_s
    end = motion.duration_s
    return t / release if t <= release else 1.0 + (t - release) / (end - release)


DEFAULT_MARGINS = Margins()


def meets_arm(check: FailedCheck) -> bool:
    """Returns whether a failed check is of a flight that meets a link, which can brake another way."""
    return check.name == "flight_clearance" and check.detail in LINKS


def meets_base(check: FailedCheck) -> bool:
    """Returns whether a failed check is of a flight that meets what never moves of the arm."""
    return check.name == "flight_clearance" and check.detail in STANDING
