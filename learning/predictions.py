"""Where the next throw will land: samples of the posterior, of the jitter and of the arm, flown through the plan."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from learning.joint_speeds import JointSpeeds
from learning.release import CLING_LOSS, CLING_LOSS_STD, FACTOR, LEAD, ReleasePosterior, circumstances
from learning.throws import BinRim, Throws, ThrowTable
from planner.arrays import Array

PARAMETERS = 200  # samples of what is not known for certain
REPEATS = 10  # throws of each, in which only what varies from throw to throw differs
SEED = 0  # the same plan has the same odds


@dataclass(frozen=True, eq=False)
class LandingForecast:
    """Where throws of one plan land, and where they pass the rim of a bin.

    Attributes:
        points: landing points (parameters, repeats, 2) [m].
        at_rim: where they pass the rim, likewise; None without a bin.
        lost_m: by how much less room the rim leaves than the bottom [m].
    """

    points: Array
    at_rim: Array | None = None
    lost_m: float = 0.0

    @property
    def center(self) -> Array:
        """Median landing point (2,) [m]: few throws that fall short do not move it, unlike the mean."""
        return np.median(self.points.reshape(-1, 2), axis=0)

    @property
    def aimed(self) -> Array:
        """What is brought onto the target (2,) [m]: the landing; into a bin the middle between there and its rim.

        Throws fall into a bin on a slant: those that land in the middle of its bottom pass nearest to its near rim.
        """
        if self.at_rim is None:
            return self.center
        return 0.5 * (self.center + np.median(self.at_rim.reshape(-1, 2), axis=0))

    @property
    def covariance(self) -> Array:
        """Covariance of the landing points (2, 2) [m^2]."""
        return np.cov(self.points.reshape(-1, 2).T)

    def hit_probability(self, target: Array, radius_m: float) -> float:
        """Returns the probability of a landing within `radius_m` of `target` (2,) [m], past the rim if there is one."""
        return float(self._hits(target, radius_m).mean())

    def hit_interval(self, target: Array, radius_m: float, share: float = 0.9) -> tuple[float, float]:
        """Returns the interval that holds the true hit probability of this cell with probability `share`."""
        each = self._hits(target, radius_m).mean(axis=1)
        tail = 0.5 * (1.0 - share)
        low, high = np.quantile(each, [tail, 1.0 - tail])
        return float(low), float(high)

    def beside_target(self, std_m: float) -> LandingForecast:
        """Returns where throws land beside a target whose place is known to a standard deviation along each axis [m].

        It differs from throw to throw.
        """
        rng = np.random.default_rng(SEED + 1)  # apart from the throw's own samples
        off = std_m * rng.standard_normal(self.points.shape)
        return replace(self, points=self.points - off, at_rim=None if self.at_rim is None else self.at_rim - off)

    def miss_radius(self, target: Array, share: float = 0.9) -> float:
        """Returns the distance from `target` (2,) within which a throw lands with probability `share` [m]."""
        return float(np.quantile(np.linalg.norm(self.points - target, axis=-1), share))

    def _hits(self, target: Array, radius_m: float) -> Array:
        inside = np.linalg.norm(self.points - target, axis=-1) <= radius_m
        if self.at_rim is not None:
            inside &= np.linalg.norm(self.at_rim - target, axis=-1) <= radius_m - self.lost_m
        return np.asarray(inside)


def forecast(
    posterior: ReleasePosterior,
    speeds: JointSpeeds,
    table: ThrowTable,
    lead_s: float,
    parameters: int = PARAMETERS,
    repeats: int = REPEATS,
    rim: BinRim | None = None,
) -> LandingForecast:
    """Returns where throws of a plan land.

    Args:
        posterior: of the cell.
        speeds: of its joints.
        table: of the plan.
        lead_s: time from the command to the opening that the plan assumes [s].
        parameters: samples of what stays the same from throw to throw.
        repeats: throws of each.
        rim: of the bin that they are thrown into.
    """
    rng = np.random.default_rng(SEED)
    size = (parameters, repeats)
    states, jitters, scatters = posterior.drawn(rng, parameters)
    late = states[:, None, LEAD] - lead_s + jitters[:, None] * rng.standard_normal(size)
    clings = rng.random(size) < rng.beta(posterior.cling_alpha, posterior.cling_beta, (parameters, 1))
    loss = np.clip(CLING_LOSS + CLING_LOSS_STD * rng.standard_normal(size), 0.0, None)
    factor = states[:, None, FACTOR] * (1.0 - np.where(clings, loss, 0.0))
    qd = table.qd[table.planned]
    dqd = speeds.drawn(rng, qd, parameters, repeats) + scatters[:, None, None] * rng.standard_normal((*size, 6))
    c = circumstances(states, late, factor)
    dv = (dqd.reshape(-1, 6) @ table.J[table.planned].T)[:, None]
    points = Throws([table]).landings(c, dv).reshape(*size, 2)
    if rim is None:
        return LandingForecast(points)
    return LandingForecast(points, Throws([rim.table]).landings(c, dv).reshape(*size, 2), rim.lost_m)
