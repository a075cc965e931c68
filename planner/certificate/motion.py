"""A trajectory looked at for its certificate: link poses and rate bounds, computed once and shared by the checks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.certificate.bounds import Rates, joint_rates
from planner.kinematics import LinkMotion, link_poses
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]
Index = NDArray[np.intp]

LOOKS = 64  # a trajectory is looked at about so often at first, but …
SPACING_S = (0.008, 0.016)  # [s] … at least and at most so far apart; bisection goes finer where it must
SPARSE = 2  # every so many of these looks serve distances, most of which are far from any limit


@dataclass(frozen=True, eq=False)
class Look:
    """The arm at k instants.

    Attributes:
        t: [s] (k,).
        X_WL: poses of base and links in the world (k, 7, 4, 4).
        links: how they move, in the world.
        p_WT: the tool centre point (3, k) [m].
    """

    t: Vector
    X_WL: Vector
    links: LinkMotion
    p_WT: Vector

    @cached_property
    def v_WT(self) -> Vector:
        """The tool centre point's velocity (3, k) [m/s]."""
        return self.links.velocity(self.p_WT)


class Motion:
    """A problem and a trajectory, with what several checks need.

    Attributes:
        knots: indices of the samples looked at first (m,), the first, the release and the last among them.
        sparse: those of the knots that serve distances, likewise.
    """

    def __init__(self, problem: ThrowProblem, trajectory: Trajectory) -> None:
        self.problem = problem
        self.trajectory = trajectory
        last, release = len(trajectory.q) - 1, trajectory.release_index
        spacing = min(max(trajectory.duration_s / LOOKS, SPACING_S[0]), SPACING_S[1])
        stride = max(1, round(spacing * trajectory.sample_rate_hz))
        self.knots = _with(np.arange(0, last, stride), release, last)
        regular = np.arange(0, len(self.knots) - 1, SPARSE)
        self.sparse = _with(regular, int(np.searchsorted(self.knots, release)), len(self.knots) - 1)

    @cached_property
    def look(self) -> Look:
        """The arm at the knots."""
        rows, trajectory = self.knots, self.trajectory
        return self._look(trajectory.t[rows], (trajectory.q[rows], trajectory.qd[rows], trajectory.qdd[rows]))

    @cached_property
    def rates(self) -> Rates:
        """What the joints do at most between neighbouring knots."""
        return joint_rates(self.trajectory, self.knots)

    @cached_property
    def sparse_speeds(self) -> Vector:
        """The joints' largest speeds between neighbouring sparse knots (6, k) [rad/s]."""
        return np.maximum.reduceat(self.rates.qd, self.sparse[:-1], axis=1)

    @cached_property
    def release(self) -> int:
        """Which knot is the release."""
        return int(np.searchsorted(self.knots, self.trajectory.release_index))

    @property
    def released_s(self) -> float:
        """Until when the object is held [s]: for ever in a move that ends at rest."""
        return np.inf if self.problem.ends_at_rest else self.trajectory.release_time_s

    def look_at(self, t: Vector) -> Look:
        """Returns the arm at times (k,) [s]."""
        return self._look(t, self.trajectory.at(t))

    def poses_at(self, t: Vector) -> Vector:
        """Returns poses of base and links in the world (k, 7, 4, 4) at times (k,) [s], many of them alike."""
        distinct, where = np.unique(t, return_inverse=True)
        cell = self.problem.cell
        return link_poses(cell.robot, self.trajectory.at(distinct)[0], cell.X_WB)[where]

    def _look(self, t: Vector, state: tuple[Vector, Vector, Vector]) -> Look:
        cell, (q, qd, qdd) = self.problem.cell, state
        X_WL = link_poses(cell.robot, q, cell.X_WB)
        links = LinkMotion(X_WL, qd, qdd)
        return Look(t, X_WL, links, links.on_flange(cell.tool.X_FT[:3, 3]))


def _with(rows: Index, *more: int) -> Index:
    """Returns increasing `rows` with others among them."""
    return np.unique(np.concatenate([rows, more]))
