"""What is kept free of the limits that are only looked at on knots and in the middles of steps, and learns by failing.

A certificate looks everywhere. What it finds between two looks says by how much more to stay away.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Protocol

SPARE_M = 0.001  # [m] added to what was lacking: the next solution passes elsewhere
SPARE_SHARE = 0.01  # [-] likewise of a limit
LEAST_SHARE = {"torque": 0.6, "tcp_speed": 0.6, "window": 0.1}  # [-] of a limit below which a margin is no remedy
MOST_M = 0.1  # [m] likewise, beyond which a clearance's margin is none
GROUPS = {  # which rows a check is about, and the margin that keeps it
    "joint_torque": ("effort", "torque"),
    "tcp_speed": ("effort", "tcp_speed"),
    "floor": ("space", "floor_m"),
    "self_collision": ("space", "self_m"),
    "keep_in": ("space", "keep_in_m"),
    "keep_out": ("boxes", "box_m"),
    "singularity_distance": ("", "singularity"),
    "landing_window": ("", "window"),
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
        singularity: multiple of the distance asked for [-].
        window: share of the landing tolerance that may be used at the window's ends, in each of two directions [-].
        held: groups of rows known to matter.
    """

    torque: float = 0.98
    tcp_speed: float = 0.985
    floor_m: float = 0.0005
    self_m: float = -0.0005
    keep_in_m: float = 0.0005
    box_m: float = 0.003
    singularity: float = 1.03
    window: float = 0.55
    held: frozenset[str] = frozenset()

    def widened(self, failures: Iterable[Finding]) -> Margins | None:
        """Returns the margins after what a certificate found, None where a margin is no remedy."""
        made = self
        for check in failures:
            if check.name not in GROUPS:
                return None
            group, name = GROUPS[check.name]
            now = getattr(made, name)
            if name in LEAST_SHARE:
                wide = now * check.limit / check.value - SPARE_SHARE
                if wide < LEAST_SHARE[name]:
                    return None
            elif name == "singularity":
                wide = now + (check.limit - check.value) / check.limit + SPARE_SHARE
            else:
                wide = now + check.limit - check.value + SPARE_M
                if wide > MOST_M:
                    return None
            made = replace(made, held=made.held | ({group} if group else set()), **{name: wide})
        return made
