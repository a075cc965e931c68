"""Ruckig's motion as it comes: a first guess for others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from planner.backends.ruckig_otg import calls
from planner.backends.ruckig_otg.arrival import soonest
from planner.backends.ruckig_otg.calls import State
from planner.problem import ThrowProblem
from planner.seeds.candidates import Candidate


@dataclass(frozen=True, eq=False)
class Rough:
    """Ruckig's synchronised motion, not on ticks.

    Attributes:
        launch: to the release; Ruckig's trajectory.
        brake: from there to rest; None for a move that ends at rest.
    """

    launch: Any
    brake: Any

    @property
    def release_time_s(self) -> float:
        """Duration of the launch [s]."""
        return float(self.launch.duration)

    @property
    def duration_s(self) -> float:
        """Duration of the whole [s]."""
        return self.release_time_s + (float(self.brake.duration) if self.brake else 0.0)

    def at(self, t: ArrayLike) -> State:
        """Returns q, qd, qdd (n, 6) at times `t` (n,) [s]."""
        times, released = np.asarray(t, float), self.release_time_s
        states = [
            self.launch.at_time(s) if s <= released or not self.brake else self.brake.at_time(s - released)
            for s in times.tolist()
        ]
        q, qd, qdd = (np.array(column) for column in zip(*states, strict=True))
        return q, qd, qdd


def rough(problem: ThrowProblem, candidate: Candidate) -> Rough:
    """Returns a first guess of a motion to the candidate, as soon as its slowest joint alone, and from there to rest.

    Raises:
        SolverFailed: Ruckig refuses the states.
        BackendUnavailable: ruckig is not installed.
    """
    zero, limits, dt = np.zeros(6), problem.limits, problem.dt
    release = (candidate.q, candidate.qd, soonest(problem, candidate).qdd)
    launch = calls.reaching((problem.start, zero, zero), release, limits, dt, on_ticks=False)
    brake = None if problem.ends_at_rest else calls.resting(release, limits, dt)
    return Rough(launch, brake)
