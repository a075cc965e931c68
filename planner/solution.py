"""What every back end returns."""

from __future__ import annotations

from dataclasses import dataclass

from planner.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Solution:
    """A motion, not judged yet: the trajectory, the solver's own word for how it ended, and its iterations."""

    trajectory: Trajectory
    status: str
    iterations: int = 0
