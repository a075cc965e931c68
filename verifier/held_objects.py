"""What the tool holds at each time: of every gripper its object, until that may have left."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from planner.cell import Cell
from verifier.capsules import OBJECT
from verifier.elementary import Mask
from verifier.grippers import OWN, gripper_names, seen_by
from verifier.motion_parts import MotionPart
from verifier.pieces import Pieces

TICK_SHARE = 1e-6  # [-] of a tick, 2 ns: a spread that is longer by it is not a tick longer


@dataclass(frozen=True, eq=False)
class HeldObject:
    """An object in a gripper.

    Attributes:
        name: of the gripper.
        cell: with this gripper alone.
        gone_from, held_until: from when it may have left, and until when it may be held, in ticks, rounded outwards;
            infinite where it is held to the end.
    """

    name: str
    cell: Cell
    gone_from: float = math.inf
    held_until: float = math.inf

    @property
    def called(self) -> str:
        """What it is called in words."""
        return f"{OBJECT} of {self.name}" if self.name != OWN else OBJECT

    def may_be_held(self, pieces: Pieces) -> Mask:
        """Returns in which pieces (n,) it may be held."""
        return np.asarray(pieces.tick + pieces.begin <= self.held_until)

    def may_be_gone(self, pieces: Pieces) -> Mask:
        """Returns in which pieces (n,) it may be gone."""
        return np.asarray(pieces.tick + pieces.end >= self.gone_from)


def held_objects(cell: Cell, parts: Sequence[MotionPart]) -> list[HeldObject]:
    """Returns the objects of all grippers: what is let go leaves at its release, up to the spread early or late."""
    thrown = {part.demands.gripper: part for part in parts if part.demands.throws}
    return [_held(name, seen_by(cell, name), thrown.get(name)) for name in gripper_names(cell)]


def _held(name: str, cell: Cell, part: MotionPart | None) -> HeldObject:
    if part is None or part.motion.release is None:
        return HeldObject(name, cell)
    motion = part.motion
    ticks = math.ceil(part.demands.spread_s * motion.rate_hz - TICK_SHARE)
    assert motion.release is not None
    first, last = max(motion.release - ticks, 0), min(motion.release + ticks, len(motion.q) - 1)
    return HeldObject(name, cell, first, last)


@dataclass(frozen=True, eq=False)
class ToolLoad:
    """Some objects that may be held while the other ones are gone.

    Attributes:
        held, gone: both.
    """

    held: tuple[HeldObject, ...]
    gone: tuple[HeldObject, ...]

    @property
    def called(self) -> str:
        """What it is called in words."""
        if not self.held or not self.gone:
            return "held" if self.held else "empty"
        return f"with {' and '.join(each.called for each in self.held)}"

    def may_be(self, pieces: Pieces) -> Mask:
        """Returns in which pieces (n,) it may be the one."""
        found = np.ones(len(pieces.tick), bool)
        for each in self.held:
            found &= each.may_be_held(pieces)
        for each in self.gone:
            found &= each.may_be_gone(pieces)
        return found


def possible_loads(objects: Sequence[HeldObject]) -> list[ToolLoad]:
    """Returns the loads that the tool may have at some time, the largest number of objects first.

    This rests on no order of the releases: where several may be held or gone, every load of some of them counts.
    """
    found = []
    for count in range(len(objects), -1, -1):
        for held in combinations(objects, count):
            gone = tuple(each for each in objects if each not in held)
            begins = max((each.gone_from for each in gone), default=0.0)
            ends = min((each.held_until for each in held), default=math.inf)
            if begins <= ends and begins < math.inf:
                found.append(ToolLoad(held, gone))
    return found
