"""What throws say about gripper, object and base: a Bayesian fit of where they landed.

The state of a cell is lead, speed factor, shift and turn of the base, and drag. For every point of a grid over jitter
and unexplained scatter, iterated Gauss-Newton through the throws' own flights finds its mean and covariance; each throw
is a mixture of an ordinary landing, an object that clung to the gripper, and a mistaken observation. The points'
evidence weighs them: the posterior is a mixture of Gaussians.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from learning.throws import Circumstances, Throws, ThrowTable
from planner.arrays import Array

STATE = ("lead_s", "speed_factor", "offset_x_m", "offset_y_m", "drag_coefficient", "turn_rad")
LEAD = 0
FACTOR = 1
OFFSET = slice(2, 4)
DRAG = 4
TURN = 5

# [s, -, m, m, -, rad] standard deviations of the prior. Sources: a gripper's published delay is off by 20 ms (RTDE
# guide's tool outputs, WSG50 and Robotiq measurements: 40 to 50 ms, 32 ms read with 10 ms steps); the speed of an
# object that slides in its grip, 3 %; a base measured by hand, 8 mm and 5 mrad; drag of a sphere, 0.1 to 0.5.
PRIOR_STD = np.array([0.020, 0.03, 0.008, 0.008, 0.15, 0.005])
UNKNOWN_DRAG = 0.2  # [-] between none and a smooth sphere's 0.47 at these Reynolds numbers
STEPS = np.array([5e-4, 1e-3, 0.0, 0.0, 0.0, 1e-3])  # [s, -, –, –, –, rad] of the forward differences

JITTERS_S = np.geomspace(0.001, 0.012, 10)  # [s] grid; below 1 ms rounded delays look like outliers of each other
JITTER_STD_S = 0.005  # [s] of the half-normal prior; source: pneumatic grippers 1 to 5 ms, buses of 10 ms steps 3 ms
SCATTERS_RAD_S = np.array([0.003, 0.012, 0.025, 0.05])  # [rad/s] grid of joint-speed errors that no recording shows
SCATTER_STD_RAD_S = 0.010  # [rad/s] of their half-normal prior; source: half of a real UR5's residual at the release
DRIFT_S = 0.0001  # [s] standard deviation of the delay's random walk from throw to throw: 1 ms in 100 throws

OUTLIER_SHARE = 0.05
OUTLIER_STD_M = 0.15  # [-, m] mistaken observations; source: contract, camera of a truth file
SLIP_SHARE = 0.005  # [-] of reports that have nothing to do with the throw: another one's, or a slip of the hand
SLIP_AREA_M2 = 400.0  # [m^2] over which they are spread evenly: 20 m by 20 m, more than any throw reaches
CLING_SHARE = 0.03  # [-] of throws in which the object leaves slower
CLING_LOSS = 0.05
CLING_LOSS_STD = 0.02  # [-] of its speed: some per cent, as of an object that sticks to a finger

ITERATIONS = 12
TEMPERING_M = (0.05, 0.02, 0.006, 0.002)  # [m] added to every standard deviation in the first iterations
STEP_MAX = 1.0  # [-] of an iteration, in prior standard deviations
SCAN_S = np.arange(-0.120, 0.1201, 0.0025)  # [s] leads about the prior's, from which the best one starts
SCAN_JITTER_S = 0.004  # [s] assumed in the scan
WEIGHT_MIN = 1e-4  # [-] of a point of the grid that is kept


@dataclass(frozen=True, eq=False)
class ObservedThrow:
    """One throw and where it landed.

    Attributes:
        table: of the plan, off by what was recorded of the arm.
        lead_s: time from the command to the opening that was assumed, plus how late the command was [s].
        landing: observed landing point (2,) [m].
        std_m: standard deviation of the observation in each direction [m].
        speed_variance: of the joint speeds at the release, beyond the table (6,) [rad^2/s^2].
    """

    table: ThrowTable
    lead_s: float
    landing: Array
    std_m: float
    speed_variance: Array


@dataclass(frozen=True, eq=False)
class ReleasePosterior:
    """Mixture of Gaussians over the state, one for each point (jitter, scatter) of the grid that counts.

    Attributes:
        weight: (g,) [-], sums to 1.
        mean, covariance: of the state, (g, 6) and (g, 6, 6); units of `STATE`.
        jitter_s: standard deviation of the opening (g,) [s].
        scatter_rad_s: joint-speed errors that no recording shows (g,) [rad/s].
        cling_alpha, cling_beta: of the beta distribution of the share of throws in which the object clings.
        mistaken: probability of each throw that it was learnt from that its observation is a mistake (n,) [-]; empty
            where that is not known.
    """

    weight: Array
    mean: Array
    covariance: Array
    jitter_s: Array
    scatter_rad_s: Array
    cling_alpha: float
    cling_beta: float
    mistaken: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def state(self) -> Array:
        """Mean of the state (6,)."""
        return np.asarray(self.weight @ self.mean)

    @property
    def state_covariance(self) -> Array:
        """Covariance of the state (6, 6)."""
        apart = self.mean - self.state
        return np.einsum("g,gij->ij", self.weight, self.covariance + apart[:, :, None] * apart[:, None, :])

    @property
    def jitter(self) -> float:
        """Mean of the jitter [s]."""
        return float(self.weight @ self.jitter_s)

    def expected_landing(self, throw: ObservedThrow) -> Array:
        """Returns where the mean state puts the landing of a throw (2,) [m], without jitter."""
        at = self.state[:, None]
        c = Circumstances(at[LEAD] - throw.lead_s, at[FACTOR], self.state[None, OFFSET], at[DRAG], at[TURN])
        return Throws([throw.table]).landings(c)[0]

    def drawn(self, rng: np.random.Generator, count: int) -> tuple[Array, Array, Array]:
        """Returns states (count, 6), jitters (count,) [s] and scatters (count,) [rad/s]."""
        g = rng.choice(len(self.weight), size=count, p=self.weight)
        root = np.linalg.cholesky(self.covariance + 1e-18 * np.eye(len(STATE)))
        states = self.mean[g] + (root[g] @ rng.standard_normal((count, len(STATE), 1)))[..., 0]
        return states, self.jitter_s[g], self.scatter_rad_s[g]


def circumstances(states: Array, late_s: Array, factor: Array) -> Circumstances:
    """Returns the circumstances of k throws of each of n states (n, 6), in one column (n k, 1).

    Args:
        states: of the cell; shift, turn and drag are the same in all throws of a state.
        late_s: releases after the planned one (n, k) [s].
        factor: release speeds over the tool's (n, k) [-].
    """
    repeats = late_s.shape[1]
    offset = np.repeat(states[:, None, OFFSET], repeats, axis=1).reshape(-1, 1, 2)
    drag, turn = (np.repeat(states[:, k], repeats)[:, None] for k in (DRAG, TURN))
    return Circumstances(late_s.reshape(-1, 1), factor.reshape(-1, 1), offset, drag, turn)


def prior_state(lead_s: float, drag_coefficient: float) -> Array:
    """Returns the prior's mean (6,) from the cell file's gripper delay and lag together [s], and its drag.

    A cell file without drag does not say that there is none: then the drag is between none and a sphere's.
    """
    return np.array([lead_s, 1.0, 0.0, 0.0, drag_coefficient or UNKNOWN_DRAG, 0.0])


def learn_release(throws: Sequence[ObservedThrow], prior: Array) -> ReleasePosterior:
    """Returns the posterior after these throws, oldest first; `prior` is of `prior_state`."""
    jitter, scatter = (x.ravel() for x in np.meshgrid(JITTERS_S, SCATTERS_RAD_S, indexing="ij"))
    log_prior = -0.5 * (jitter / JITTER_STD_S) ** 2 + np.log(jitter)  # the grid is even in the logarithm
    log_prior = log_prior - 0.5 * (scatter / SCATTER_STD_RAD_S) ** 2 + np.log(scatter)
    if throws:
        fit = _Fit(throws, prior, jitter, scatter)
        fit.run(_best_lead(throws, prior))
        evidence = fit.evidence()
        z = fit.z
        covariance = fit.covariance()
        clings = fit.clings()
        mistakes = fit.mistake_weight
    else:
        z = np.zeros((len(jitter), 6))
        covariance = np.tile(np.eye(6), (len(jitter), 1, 1))
        evidence = np.zeros(len(jitter))
        clings = np.zeros(len(jitter))
        mistakes = np.zeros((len(jitter), 0))
    log_weight = log_prior + evidence
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    share = float(weight @ clings)
    kept = weight > WEIGHT_MIN
    alpha = 1.0 + share
    beta = 1.0 / CLING_SHARE - 1.0 + len(throws) - share
    scaled = covariance[kept] * PRIOR_STD[:, None] * PRIOR_STD
    mean = prior + PRIOR_STD * z[kept]
    share_kept = weight[kept] / weight[kept].sum()
    return ReleasePosterior(share_kept, mean, scaled, jitter[kept], scatter[kept], alpha, beta, weight @ mistakes)


def told_by_reports(release: ReleasePosterior, opened: Sequence[tuple[float, float]]) -> ReleasePosterior:
    """Returns the posterior with what a gripper itself reported of its openings.

    Reports are read at the same ticks after each command, and may all be off to the same side: many tell the delay no
    better than one, but for the jitter, or for how far apart they lie where that is more. Their median counts, as a
    finger that creeps opens nothing. They are taken for independent of the landings.

    Args:
        release: the posterior without them.
        opened: times after the command [s] between which the gripper opened, a throw each.
    """
    if not opened:
        return release
    reports = np.array(opened)
    middles = reports.mean(axis=1)
    scatter = np.maximum(release.jitter_s**2, middles.var())
    variance = np.mean(np.diff(reports) / 2.0) ** 2 + scatter / len(reports)
    gap = np.median(middles) - release.mean[:, LEAD]
    shared = release.covariance[:, LEAD]
    total = shared[:, LEAD] + variance
    gain = shared / total[:, None]
    log_weight = np.log(release.weight) - 0.5 * gap**2 / total - 0.5 * np.log(total)
    weight = np.exp(log_weight - log_weight.max())
    mean = release.mean + gain * gap[:, None]
    return replace(
        release,
        weight=weight / weight.sum(),
        mean=mean,
        covariance=release.covariance - gain[:, :, None] * shared[:, None],
    )


class _Fit:
    """Gauss-Newton over the throws, for g points of the grid at once; states as `z`, in prior standard deviations."""

    def __init__(self, throws: Sequence[ObservedThrow], prior: Array, jitter: Array, scatter: Array) -> None:
        self.throws = Throws([throw.table for throw in throws])
        self.lead = np.array([throw.lead_s for throw in throws])
        self.seen = np.stack([throw.landing for throw in throws])
        self.noise = np.array([throw.std_m for throw in throws]) ** 2
        self.speed = np.stack([throw.speed_variance for throw in throws])
        self.prior = prior
        self.jitter = jitter
        self.scatter = scatter
        self.age = np.arange(len(throws))[::-1]
        self.z = np.zeros((len(jitter), len(STATE)))
        self.late = np.zeros((len(jitter), len(throws)))  # each throw's own part of the jitter [s]

    def run(self, lead_s: float) -> None:
        """Iterates from a lead about the prior's [s]."""
        self.z[:, LEAD] = lead_s / PRIOR_STD[LEAD]
        for i in range(ITERATIONS):
            extra = TEMPERING_M[i] if i < len(TEMPERING_M) else 0.0
            self._linearise(extra)
            step = np.linalg.solve(self.normal, (self.gradient - self.z)[..., None])[..., 0]
            step = np.clip(step, -STEP_MAX, STEP_MAX)
            self.z = self.z + step
            rest = self.residual - (self.H @ step[:, None, :, None])[..., 0]
            self.late = self._jitter_variance() * (self.by_lead * (self.S_inverse @ rest[..., None])[..., 0]).sum(-1)
            self.late = np.clip(self.late, -4.0 * self.jitter[:, None], 4.0 * self.jitter[:, None])
        self._linearise(0.0)

    def evidence(self) -> Array:
        """Returns the logarithm of each point's evidence (g,), by Laplace's approximation."""
        _, log_det = np.linalg.slogdet(self.normal)
        return self.log_density.sum(axis=1) - 0.5 * (self.z**2).sum(axis=1) - 0.5 * log_det

    def covariance(self) -> Array:
        """Returns the covariance of the states (g, 6, 6), in prior standard deviations."""
        return np.linalg.inv(self.normal)

    def clings(self) -> Array:
        """Returns the expected number of throws in which the object clung (g,)."""
        return self.cling_weight.sum(axis=1)

    def _jitter_variance(self) -> Array:
        return np.asarray(self.jitter[:, None] ** 2 + DRIFT_S**2 * self.age, float)

    def _circumstances(self, theta: Array) -> Circumstances:
        t = theta[:, None, :]
        late = t[..., LEAD] - self.lead + self.late
        return Circumstances(late, t[..., FACTOR], t[..., OFFSET], t[..., DRAG], t[..., TURN])

    def _landings(self, theta: Array) -> Array:
        return self.throws.landings(self._circumstances(theta))

    def _linearise(self, extra_m: float) -> None:
        """Computes residuals, derivatives and weights at the present states."""
        theta = self.prior + PRIOR_STD * self.z
        c = self._circumstances(theta)
        landing = self.throws.landings(c)
        H = np.zeros((*landing.shape, len(STATE)))
        for k in (LEAD, FACTOR, TURN):
            moved = theta.copy()
            moved[:, k] += STEPS[k]
            H[..., k] = (self._landings(moved) - landing) / STEPS[k]
        H[..., 0, 2] = H[..., 1, 3] = 1.0
        H[..., DRAG] = self.throws.by_drag_at(c.late_s)
        self.by_lead = H[..., LEAD]
        by_factor = H[..., FACTOR]
        self.residual = self.seen - landing + self.by_lead * self.late[..., None]
        Q = self.throws.by_joint_speed(c.late_s, c.factor)
        speed = self.speed + self.scatter[:, None, None] ** 2
        S = self._jitter_variance()[..., None, None] * _outer(self.by_lead)
        S = S + (Q * speed[..., None, :]) @ np.swapaxes(Q, -1, -2)
        S = S + (self.noise[:, None, None] + extra_m**2) * np.eye(2)
        self._weigh(S, by_factor)
        self.H = H * PRIOR_STD
        H_T = np.swapaxes(self.H, -1, -2)
        self.normal = np.eye(len(STATE)) + (H_T @ self.W @ self.H).sum(axis=1)
        self.gradient = (H_T @ self.pull[..., None])[..., 0].sum(axis=1)

    def _weigh(self, S: Array, by_factor: Array) -> None:
        """Computes the mixture's weights: the matrix `W` and the weighted residual `pull` of each throw."""
        kinds = (
            (1.0 - OUTLIER_SHARE - SLIP_SHARE - CLING_SHARE, 0.0 * by_factor, S),
            (OUTLIER_SHARE, 0.0 * by_factor, S + OUTLIER_STD_M**2 * np.eye(2)),
            (CLING_SHARE, -CLING_LOSS * by_factor, S + CLING_LOSS_STD**2 * _outer(by_factor)),
        )
        inverses = [_inverse(cov) for _, _, cov in kinds]
        rests = [self.residual - shift for _, shift, _ in kinds]
        log = [
            math.log(share)
            + 0.5 * np.log(np.linalg.det(inverse))
            - 0.5 * _quadratic(inverse, rest)
            - math.log(2 * np.pi)
            for (share, _, _), inverse, rest in zip(kinds, inverses, rests, strict=True)
        ]
        slip = math.log(SLIP_SHARE / SLIP_AREA_M2)  # wherever it is: such a report moves nothing
        self.log_density = np.logaddexp(np.logaddexp.reduce(log, axis=0), slip)
        weights = [np.exp(x - self.log_density) for x in log]
        self.mistake_weight = weights[1] + np.exp(slip - self.log_density)
        self.cling_weight = weights[2]
        self.S_inverse = inverses[0]
        each = zip(weights, inverses, strict=True)
        self.W = np.sum([w[..., None, None] * inverse for w, inverse in each], axis=0)
        pulls = zip(weights, inverses, rests, strict=True)
        self.pull = np.sum([w[..., None] * (inverse @ rest[..., None])[..., 0] for w, inverse, rest in pulls], axis=0)

    def likeliest(self) -> int:
        """Returns the point of the highest evidence after one step in which only the leads stay as they are."""
        self._linearise(TEMPERING_M[1])
        is_lead = np.arange(len(STATE)) == LEAD
        pinned = self.normal + 1e9 * np.diag(is_lead.astype(float))
        step = np.linalg.solve(pinned, (self.gradient - self.z * ~is_lead)[..., None])[..., 0]
        self.z = self.z + np.clip(step, -2.0, 2.0)
        self._linearise(TEMPERING_M[1])
        return int(np.argmax(self.evidence()))


def _best_lead(throws: Sequence[ObservedThrow], prior: Array) -> float:
    """Returns the lead about the prior's from which the throws are likeliest [s], the rest of the state linear."""
    n = len(SCAN_S)
    scan = _Fit(throws, prior, np.full(n, SCAN_JITTER_S), np.full(n, SCATTER_STD_RAD_S))
    scan.z[:, LEAD] = SCAN_S / PRIOR_STD[LEAD]
    return float(SCAN_S[scan.likeliest()])


def _outer(x: Array) -> Array:
    return x[..., :, None] * x[..., None, :]


def _inverse(S: Array) -> Array:
    """Returns the inverses of symmetric matrices (…, 2, 2)."""
    a = S[..., 0, 0]
    b = S[..., 0, 1]
    d = S[..., 1, 1]
    det = a * d - b * b
    return np.stack([np.stack([d, -b], -1), np.stack([-b, a], -1)], -2) / det[..., None, None]


def _quadratic(M: Array, x: Array) -> Array:
    return (x * (M @ x[..., None])[..., 0]).sum(axis=-1)
