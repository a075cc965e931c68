"""A motion as each gripper sees it that has a say in it: one that lets go, or whose tool centre point passes states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from planner.cell import Cell
from verifier.elementary import Array
from verifier.grippers import gripper_names, seen_by
from verifier.plan_document import Demands, SampledMotion


@dataclass(frozen=True, eq=False)
class MotionPart:
    """A motion as one gripper sees it.

    Attributes:
        cell: with this gripper alone; what others hold as it lets go is part of the tool.
        motion: whose release is this gripper's.
        demands: of its release.
    """

    cell: Cell
    motion: SampledMotion
    demands: Demands

    @property
    def p_FT(self) -> Array:
        """Its tool centre point (3,) in the flange frame [m]."""
        return self.cell.tool.X_FT[:3, 3]

    @property
    def of(self) -> str:
        """What tells its tool centre point from others in words; nothing of the cell's own."""
        return f" of {self.demands.gripper}" if self.demands.gripper else ""


def motion_parts(cell: Cell, motion: SampledMotion, demands: Sequence[Demands]) -> list[MotionPart]:
    """Returns a motion as each gripper sees it that has a say in it, in their order."""
    found = []
    holding = set(gripper_names(cell))
    for each in demands:
        if each.throws:
            holding.discard(each.gripper)
        seen = seen_by(cell, each.gripper, frozenset(holding - {each.gripper}))
        own = motion if each is demands[0] else replace(motion, release=each.released_at)
        found.append(MotionPart(seen, own, each))
    return found
