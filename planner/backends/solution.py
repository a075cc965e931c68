"""The result of a back end."""

from __future__ import annotations

from dataclasses import dataclass

from planner.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Solution:
    """A motion that has not been certified yet.

    Attributes:
        trajectory: the motion.
        status: the solver's own status.
        iterations: of the solver.
        held: groups of limits that it was solved with, for a solver that starts without them.
    """

    trajectory: Trajectory
    status: str
    iterations: int = 0
    held: frozenset[str] = frozenset()
