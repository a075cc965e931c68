"""What hits and misses teach where no landing was measured: particles of the posterior, weighted by them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from learning.release import FACTOR, LEAD, ReleasePosterior, circumstances
from learning.throws import Throws, ThrowTable
from planner.arrays import Array

PARTICLES = 1000  # states; 500 degenerate after ten outcomes
REPEATS = 16  # throws of each, over which what varies from throw to throw is averaged
BLUR_M = 0.01  # [m] over which a hit becomes a miss: an object that touches the rim, a person that judges by eye
EDGE_M = 0.02  # [m] distance from the radius that is reported as an edge
MISTAKEN = 0.03  # [-] share of reports that say nothing
SEED = 0  # the same evidence gives the same profile


@dataclass(frozen=True, eq=False)
class TargetOutcome:
    """Whether one throw hit.

    Attributes:
        table: of the plan, off by what was recorded of the arm.
        lead_s: time from the command to the opening that was assumed [s].
        target: (2,) [m].
        radius_m: of the target [m].
        result: "hit", "edge" or "miss".
        speed_std: scatter of the joint speeds that the table does not hold [rad/s].
    """

    table: ThrowTable
    lead_s: float
    target: Array
    radius_m: float
    result: str
    speed_std: float


def weighed_by_outcomes(posterior: ReleasePosterior, outcomes: Sequence[TargetOutcome]) -> ReleasePosterior:
    """Returns the posterior after these outcomes: the particles' weights, mean and covariance.

    The points of the grid keep their jitter and scatter, with new weights, and share the state's new moments.
    """
    if not outcomes:
        return posterior
    rng = np.random.default_rng(SEED)
    states, jitters, scatters = posterior.drawn(rng, PARTICLES)
    log = np.zeros(PARTICLES)
    for outcome in outcomes:
        log = log + np.log(MISTAKEN / 3.0 + (1.0 - MISTAKEN) * _likelihood(rng, outcome, states, jitters, scatters))
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    same = (jitters[:, None] == posterior.jitter_s) & (scatters[:, None] == posterior.scatter_rad_s)
    points = weight @ same
    kept = points > 0.0
    mean = weight @ states
    covariance = (states - mean).T @ (weight[:, None] * (states - mean))
    return replace(
        posterior,
        weight=points[kept] / points[kept].sum(),
        mean=np.tile(mean, (int(kept.sum()), 1)),
        covariance=np.tile(covariance, (int(kept.sum()), 1, 1)),
        jitter_s=posterior.jitter_s[kept],
        scatter_rad_s=posterior.scatter_rad_s[kept],
    )


def _likelihood(
    rng: np.random.Generator, outcome: TargetOutcome, states: Array, jitters: Array, scatters: Array
) -> Array:
    """Returns the probability of an outcome for each particle (n,)."""
    size = (len(states), REPEATS)
    late = states[:, None, LEAD] - outcome.lead_s + jitters[:, None] * rng.standard_normal(size)
    std = np.hypot(scatters, outcome.speed_std)[:, None, None]
    dv = (std * rng.standard_normal((*size, 6))) @ outcome.table.J[outcome.table.planned].T
    c = circumstances(states, late, np.repeat(states[:, FACTOR, None], REPEATS, axis=1))
    landed = Throws([outcome.table]).landings(c, dv.reshape(-1, 1, 3)).reshape(*size, 2)
    inside = outcome.radius_m - np.linalg.norm(landed - outcome.target, axis=-1)
    if outcome.result == "edge":
        return np.exp(-0.5 * (inside / EDGE_M) ** 2).mean(axis=1)
    hit = 1.0 / (1.0 + np.exp(-np.clip(inside / BLUR_M, -50.0, 50.0)))
    return (hit if outcome.result == "hit" else 1.0 - hit).mean(axis=1)
