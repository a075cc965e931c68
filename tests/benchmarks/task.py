"""One question of a problem set, and one answer to it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.problem import JointRelease, PoseRelease, ThrowProblem

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Task:
    """A problem of a set.

    Attributes:
        name: "set/cell/number".
        problem: asked with back end "auto".
        state: the joint state it was made from, None where there is none.
        impossible: why no motion exists ("reach", "speed"), empty where one may.
    """

    name: str
    problem: ThrowProblem
    state: JointRelease | None = None
    impossible: str = ""

    @property
    def group(self) -> str:
        """Name of the set."""
        return self.name.split("/")[0]

    @property
    def coupled(self) -> bool:
        """Whether the release leaves a posture to choose, so that the joint-wise bound says nothing."""
        return not isinstance(self.problem.release, JointRelease | PoseRelease)


@dataclass
class Row:
    """How one back end did on one task; times in seconds, distances in metres, None where there is no answer.

    Attributes:
        backend: the one that was asked.
        outcome: "certified", "infeasible", "failed" or "invalid".
        by: the back end whose answer it is.
        solve_s: wall time of plan(), warm.
        cpu_s: processor time of the same, for comparison on a busy machine.
        certificate_s: wall time of judging the answer once more.
        window_m: worst landing error within ±10, ±20 and ±30 ms of the release, by "10", "20", "30".
        bound_s: no launch is sooner, joint by joint; None where postures are free.
        nearest: for an infeasible one: "certified", "wrong", or "none".
    """

    task: str
    backend: str
    outcome: str
    by: str = ""
    release_time_s: float | None = None
    duration_s: float | None = None
    solve_s: float = 0.0
    cpu_s: float = 0.0
    certificate_s: float | None = None
    window_m: dict[str, float] = field(default_factory=dict)
    bound_s: float | None = None
    tick_s: float = 0.002
    nearest: str = ""
    reason: str = ""

    @property
    def certified(self) -> bool:
        return self.outcome == "certified"

    @property
    def group(self) -> str:
        return self.task.split("/")[0]

    def document(self) -> dict[str, Any]:
        return asdict(self)
