"""What a check finds, and how a bound is proven over pieces of a motion that are halved where they do not decide."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from verifier.arm import ArmPieces
from verifier.elementary import Array

HALVINGS = 7  # [-] of a tick: its parts are then 16 microseconds of 500 Hz, in which nothing moves by more than 0.1 mm
NOT_COVERED = "not covered: "  # begin of the detail of a check that is not made
PIECES_MAX = 4096  # [-] that are looked at again at once: what needs more is undecided almost everywhere


class Status(StrEnum):
    """Whether a check is proven."""

    PROVEN = "proven"
    NOT_PROVEN = "not proven"
    VIOLATED = "violated"


@dataclass(frozen=True)
class Finding:
    """The result of a check.

    Attributes:
        name: of the check, as in the plan's certificate.
        status: whether it is proven.
        at_s: time where it is not [s]; None where there is none.
        detail: what stands in the way, or what the check is of.
    """

    name: str
    status: Status
    at_s: float | None = None
    detail: str = ""

    @property
    def is_not_covered(self) -> bool:
        """Whether it is of a check that is not made."""
        return NOT_COVERED in self.detail

    def __str__(self) -> str:
        """Returns it in words."""
        at = "" if self.at_s is None else f" at {self.at_s:.4f} s"
        return f"{self.status}: {self.name}{at}{': ' if self.detail else ''}{self.detail}"


Rooms = Callable[[ArmPieces], tuple[Array, Array]]  # lower and upper bounds on what is left of k limits (k, n)


def not_covered(name: str, what: str) -> Finding:
    """Returns that a check is not made, and of what."""
    return Finding(name, Status.NOT_PROVEN, None, NOT_COVERED + what)


def judged(name: str, lower: float, upper: float, at_s: float | None, detail: str = "") -> Finding:
    """Returns the finding of what is left of a limit, between two bounds."""
    if lower >= 0.0:
        return Finding(name, Status.PROVEN, at_s, detail)
    status = Status.VIOLATED if upper < 0.0 else Status.NOT_PROVEN
    return Finding(name, status, at_s, f"{detail}{', ' if detail else ''}left: {lower:.3g} to {upper:.3g}")


def prove(name: str, arm: ArmPieces, rooms: Rooms, items: Sequence[str]) -> Finding:
    """Returns whether nothing of k limits is exceeded over an arm's pieces.

    Args:
        name: of the check.
        arm: its pieces are halved where that does not decide.
        rooms: function of an arm that returns bounds on what is left; a limit is kept where that is not negative.
        items: what each limit is of (k,).
    """
    for halvings in range(HALVINGS + 1):
        if len(arm.pieces.tick) == 0:
            break
        lower, upper = rooms(arm)
        broken = np.argwhere(upper < 0.0)
        if len(broken):
            item, piece = min(broken.tolist(), key=lambda at: upper[at[0], at[1]])
            left = f"{items[item]}, left: {upper[item, piece]:.3g} at most"
            return Finding(name, Status.VIOLATED, float(arm.pieces.middle_s[piece]), left)
        is_open = ~(lower >= 0.0)  # not a number is undecided
        again = np.asarray(is_open.any(axis=0))
        if not again.any():
            break
        if halvings == HALVINGS or again.sum() > PIECES_MAX:
            item, piece = np.argwhere(is_open)[0]
            left = f"{items[item]}, left: {lower[item, piece]:.3g} to {upper[item, piece]:.3g}"
            return Finding(name, Status.NOT_PROVEN, float(arm.pieces.middle_s[piece]), left)
        arm = ArmPieces(arm.cell, arm.pieces.chosen(again).halves())
    return Finding(name, Status.PROVEN)
