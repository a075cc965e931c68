"""The grippers of a tool, each by itself: its tool centre point and its object, beside what others still hold."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

from planner.cell import Cell, MountedGripper, ToolCapsule
from verifier.elementary import Array

CELLS_KEPT = 32  # cells seen from their grippers: pairs of capsules are kept by cells
OWN = ""  # name of the cell's own gripper


@dataclass(frozen=True, eq=False)
class HeldBall(ToolCapsule):
    """The ball that another gripper holds, as a part of the tool's shape; these come last."""


def gripper_names(cell: Cell) -> tuple[str, ...]:
    """Returns the names of a cell's grippers; that of `[gripper]` is empty."""
    return tuple(_mounted(cell)) if cell.grippers else (OWN,)


@lru_cache(maxsize=CELLS_KEPT)
def seen_by(cell: Cell, name: str, others: frozenset[str] = frozenset()) -> Cell:
    """Returns a cell as if it had one of its grippers alone; a cell that has only one itself.

    Args:
        cell: the cell.
        name: of the gripper.
        others: names of those whose balls are parts of the tool's shape.
    """
    if not cell.grippers:
        return cell
    mounted = _mounted(cell)
    shape = cell.tool.capsules[: len(cell.tool.capsules) - len(cell.carried)]
    balls = [_ball(mounted[other]) for other in mounted if other in others]
    own = mounted[name]
    tool = replace(cell.tool, X_FT=own.X_FT, capsules=(*shape, *balls), p_FH=cell.tool.end_F)
    alone = {"grippers": {}, "mounted": OWN, "carried": (), "content": ""}
    return replace(cell, tool=tool, gripper=own.gripper, object=own.object, **alone)


def _mounted(cell: Cell) -> dict[str, MountedGripper]:
    """Returns every gripper of a cell that has several; the one that the cell is given with, as a profile taught it."""
    return {**cell.grippers, cell.mounted: MountedGripper(cell.gripper, cell.tool.X_FT, cell.object)}


def _ball(of: MountedGripper) -> HeldBall:
    centre: Array = of.X_FT[:3, 3]
    return HeldBall(centre, centre, of.object.radius_m)
