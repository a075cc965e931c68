"""Where the next throw will land: samples of the posterior, of the jitter and of the arm, flown through the plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from learning.joint_speeds import JointSpeeds
from learning.release import CLING_LOSS, CLING_LOSS_STD, FACTOR, LEAD, ReleasePosterior, circumstances
from learning.throws import Throws, ThrowTable
from planner.arrays import Array

PARAMETERS = 200  # samples of what is not known for certain
REPEATS = 10  # throws of each, in which only what varies from throw to throw differs
SEED = 0  # the same plan has the same odds


@dataclass(frozen=True, eq=False)
class LandingForecast:
    """Where throws of one plan land.

    Attributes:
        points: landing points (parameters, repeats, 2) [m].
    """

    points: Array

    @property
    def center(self) -> Array:
        """Median landing point (2,) [m]: few throws that fall short do not move it, unlike the mean."""
        return np.median(self.points.reshape(-1, 2), axis=0)

    @property
    def covariance(self) -> Array:
        """Covariance of the landing points (2, 2) [m^2]."""
        return np.cov(self.points.reshape(-1, 2).T)

    def hit_probability(self, target: Array, radius_m: float) -> float:
        """Returns the probability of a landing within `radius_m` of `target` (2,) [m]."""
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
        return LandingForecast(self.points - std_m * rng.standard_normal(self.points.shape))

    def miss_radius(self, target: Array, share: float = 0.9) -> float:
        """Returns the distance from `target` (2,) within which a throw lands with probability `share` [m]."""
        return float(np.quantile(np.linalg.norm(self.points - target, axis=-1), share))

    def _hits(self, target: Array, radius_m: float) -> Array:
        return np.linalg.norm(self.points - target, axis=-1) <= radius_m


def forecast(
    posterior: ReleasePosterior,
    speeds: JointSpeeds,
    table: ThrowTable,
    lead_s: float,
    parameters: int = PARAMETERS,
    repeats: int = REPEATS,
) -> LandingForecast:
    """Returns where throws of a plan land.

    Args:
        posterior: of the cell.
        speeds: of its joints.
        table: of the plan.
        lead_s: time from the command to the opening that the plan assumes [s].
        parameters: samples of what stays the same from throw to throw.
        repeats: throws of each.
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
    throws = Throws([table])
    c = circumstances(states, late, factor)
    dv = (dqd.reshape(-1, 6) @ table.J[table.planned].T)[:, None]
    return LandingForecast(throws.landings(c, dv).reshape(*size, 2))
