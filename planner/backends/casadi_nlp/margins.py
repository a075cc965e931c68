"""What is kept free of the limits that are only looked at on knots and in the middles of steps, and learns by failing.

A certificate looks everywhere. What it finds between two looks says by how much more to stay away.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Protocol

from planner.solution import Solution
from planner.trajectory import Trajectory

SPARE_M = 0.001  # [m] added to what was lacking: the next solution passes elsewhere
SPARE_SHARE = 0.01  # [-] likewise of a limit
PASSED_ON = 1.5  # [-] what was lacking between two looks takes more than as much at them
MOST_SHARE = 0.4  # [-] of a limit, beyond which keeping away from it is no remedy
MOST_M = 0.1  # [m] likewise of a clearance
MOST_EVERYWHERE_M = 0.01  # [m] likewise of a clearance that is kept everywhere
FAR_OFF_M = 0.005  # [m] lacking between two looks: they are too far apart
DIAGONAL = math.sqrt(2.0)  # a landing point at the window's end is held in two directions, and judged by its distance
MOST_RAD = 0.2  # [rad] likewise of a joint's position
EVERYWHERE = {"self_collision": "self_m", "floor": "floor_m", "keep_in": "keep_in_m", "keep_out": "box_m"}
LOCAL = {  # which group of rows a check is about, and the first and last of them
    "joint_torque": ("effort", 0, 6),
    "tcp_speed": ("effort", 6, 7),
    "self_collision": ("space", 0, 1),
    "floor": ("space", 1, 2),
    "keep_in": ("space", 2, 3),
    "keep_out": ("boxes", 0, 1),
}


class Finding(Protocol):
    """A failed check, of whatever judge: its name, the worst value, the limit it is held against."""

    @property
    def name(self) -> str:
        """Of the contract, such as "floor"."""
        ...

    @property
    def value(self) -> float:
        """The worst value."""
        ...

    @property
    def limit(self) -> float:
        """What it is held against."""
        ...

    @property
    def at_s(self) -> float | None:
        """When [s]."""
        ...


@dataclass(frozen=True)
class Spot:
    """Where on the way more is to be kept free, and how much.

    Attributes:
        check: of `LOCAL`.
        share: of the launch's time, up to 1; 1 and on: of the brake's.
        amount: of the limit [-], or of the clearance [m].
    """

    check: str
    share: float
    amount: float


@dataclass(frozen=True)
class Margins:
    """How much is kept free of each limit.

    Attributes:
        torque: share of the limit that may be used [-].
        tcp_speed: likewise.
        floor_m: added to the clearance asked for [m].
        self_m: likewise; less than nothing, because the optimiser's distance is a little smaller than the true one.
        keep_in_m: likewise.
        box_m: likewise: a hand passes a corner between two looks.
        position_rad: kept free of a joint's position limits [rad].
        singularity: multiple of the distance asked for [-].
        window: share of the landing tolerance that may be used at the window's ends, in each of two directions [-].
        spots: where more was lacking.
        known: groups of rows that turned out to matter.
    """

    torque: float = 0.98
    tcp_speed: float = 0.985
    floor_m: float = 0.0005
    self_m: float = -0.0005
    keep_in_m: float = 0.0005
    box_m: float = 0.003
    position_rad: float = 0.001
    singularity: float = 1.03
    window: float = 0.62
    spots: tuple[Spot, ...] = ()
    known: frozenset[str] = frozenset()

    @property
    def held(self) -> frozenset[str]:
        """Groups of rows to be held from the beginning."""
        return self.known | {LOCAL[spot.check][0] for spot in self.spots}

    def widened(self, failures: Iterable[Finding], solution: Solution) -> Margins | None:
        """Returns the margins after what a certificate found in a solution, None where a margin is no remedy."""
        made: Margins | None = replace(self, known=self.known | solution.held)
        for check in failures:
            made = made and made._after(check, solution.trajectory)
        return made

    def _after(self, check: Finding, failed: Trajectory) -> Margins | None:
        lacking = abs(check.value - check.limit)
        if check.name == "singularity_distance":
            return replace(self, singularity=self.singularity + lacking / check.limit + SPARE_SHARE)
        if check.name == "joint_position" and lacking < MOST_RAD:
            return replace(self, position_rad=self.position_rad + PASSED_ON * lacking)
        if check.name == "landing_window":
            left = self.window - lacking / check.limit / DIAGONAL - SPARE_SHARE
            return replace(self, window=left) if left > 0.0 else None
        if check.name not in LOCAL or check.at_s is None:
            return None
        relative = LOCAL[check.name][0] == "effort"
        amount = lacking / check.limit + SPARE_SHARE if relative else PASSED_ON * lacking + SPARE_M
        if amount > (MOST_SHARE if relative else MOST_M):
            return None
        again = any(spot.check == check.name for spot in self.spots)
        if again and check.name in EVERYWHERE and amount < MOST_EVERYWHERE_M:
            everywhere = EVERYWHERE[check.name]  # the motion passes as near as before at another time
            return replace(self, **{everywhere: getattr(self, everywhere) + amount})
        at, release_s, end_s = check.at_s, failed.release_time_s, failed.duration_s
        share = at / release_s if at <= release_s else 1.0 + (at - release_s) / (end_s - release_s)
        return replace(self, spots=(*self.spots, Spot(check.name, share, amount)))


CLOSE = Margins()  # those to begin with


def far_off(failures: Iterable[Finding]) -> bool:
    """Returns whether a clearance was missed by so much between two looks that closer looks are called for."""
    near = [finding for finding in failures if LOCAL.get(finding.name, ("",))[0] in ("space", "boxes")]
    return any(finding.limit - finding.value > FAR_OFF_M for finding in near)
