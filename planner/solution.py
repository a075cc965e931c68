"""What every back end returns."""

from __future__ import annotations

from dataclasses import dataclass

from planner.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Solution:
    """A motion, not judged yet.

    Attributes:
        trajectory: the motion.
        status: the solver's own word for how it ended.
        iterations: of the solver.
        held: groups of limits that turned out to matter, where the solver begins without them.
    """

    trajectory: Trajectory
    status: str
    iterations: int = 0
    held: frozenset[str] = frozenset()
