"""A trajectory looked at for its certificate: link poses and rate bounds, computed once and shared by the checks."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.certificate.bounds import Rates, joint_rates
from planner.kinematics import link_poses
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

SPARSE_S = 0.032  # [s] spacing of the first look at distances, most of which are far from any limit
COARSE_S = 0.008  # [s] spacing of the first look (every tick at 125 Hz); bisection goes finer where it must


class Motion:
    """A problem and a trajectory, with what several checks need.

    Attributes:
        knots: indices of the samples looked at first (m,): every `spacing_s`, and the first, the release and the last.
        t: their times [s].
    """

    def __init__(self, problem: ThrowProblem, trajectory: Trajectory, spacing_s: float = COARSE_S) -> None:
        self.problem = problem
        self.trajectory = trajectory
        stride = max(1, round(spacing_s * trajectory.sample_rate_hz))
        last = len(trajectory.q) - 1
        self.knots = np.unique(np.concatenate([np.arange(0, last, stride), [trajectory.release_index, last]]))
        self.t = trajectory.t[self.knots]

    @cached_property
    def sparse(self) -> Motion:
        """The same motion with fewer knots."""
        motion = Motion(self.problem, self.trajectory, SPARSE_S)
        motion.tick_rates = self.tick_rates
        return motion

    @cached_property
    def X_WL(self) -> Vector:
        """Poses of base and links in the world at the knots (m, 7, 4, 4)."""
        return self.link_poses(self.trajectory.q[self.knots])

    @cached_property
    def rates(self) -> Rates:
        """What the joints do at most between neighbouring knots."""
        return self.tick_rates.between(self.knots)

    @cached_property
    def tick_rates(self) -> Rates:
        """What the joints do at most inside every tick."""
        return joint_rates(self.trajectory)

    def link_poses(self, q: Vector) -> Vector:
        """Returns poses of base and links in the world (..., 7, 4, 4)."""
        return self.problem.cell.X_WB @ link_poses(self.problem.cell.robot, q)

    def poses_at(self, t: Vector) -> Vector:
        """Returns poses of base and links in the world (k, 7, 4, 4) at times (k,) [s], many of them alike."""
        distinct, where = np.unique(t, return_inverse=True)
        return self.link_poses(self.trajectory.at(distinct)[0])[where]
