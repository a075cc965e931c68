"""One problem of a set."""

from __future__ import annotations

from dataclasses import dataclass

from planner.problem import JointRelease, ThrowProblem
from planner.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Task:
    """A problem of a set.

    Attributes:
        name: "set/cell/number".
        problem: The problem, with back end "auto".
        state: Joint state it was derived from, None without one.
        motion: Certified motion that shows the problem to be feasible, None without one.
    """

    name: str
    problem: ThrowProblem
    state: JointRelease | None = None
    motion: Trajectory | None = None

    @property
    def group(self) -> str:
        """Name of the set."""
        return self.name.split("/")[0]
