"""Learning from ordinary throws with their recordings: landing errors, and whether predicted odds are honest.

A cell throws mixed plans at random. After 0, 1, 2, 5 and 10 of them further throws assess it, aimed with what it knows
then, and beside it an oracle that knows the truth. A moved aim is taken as a shift of the landing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.learning.diagram import reliability_svg
from benchmarks.learning.gripper_calibration import CAMERA_STD_M, NO_SHIFT, SPEED_VARIANCE
from benchmarks.learning.hidden_cells import HiddenCell, hidden_cell, throw
from benchmarks.learning.plans import PlannedThrow
from benchmarks.learning.reliability import Bin, brier_share, calibration_error, reliability_bins
from learning import (
    JointSpeeds,
    LandingForecast,
    ObservedThrow,
    ReleasePosterior,
    ThrowTable,
    forecast,
    learn_joint_speeds,
    learn_release,
    prior_state,
    throw_table,
)

STAGES = (0, 1, 2, 5, 10)  # throws after which a cell is assessed
ASSESSED = 8  # throws at each
RADII_M = (0.05, 0.10)
SAMPLES = (150, 4)  # of a forecast that gives odds
AIMING_SAMPLES = (60, 3)
CERTAIN = 1e9  # shape of an inverse gamma without spread


@dataclass(frozen=True)
class AssessedThrow:
    """One throw that judges what is known: its miss, the oracle's, and what was predicted."""

    cell: int
    misspecified: bool
    stage: int
    window_s: float
    miss_m: float
    oracle_miss_m: float
    hit_probabilities: tuple[float, ...]
    miss_radius_m: float


@dataclass
class LearningCell:
    """One hidden cell with what is known of it."""

    rng: np.random.Generator
    truth: HiddenCell
    plans: list[PlannedThrow]
    tables: list[ThrowTable]
    seen: list[ObservedThrow] = field(default_factory=list)
    speeds_seen: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)

    def learn(self) -> tuple[ReleasePosterior, JointSpeeds, float]:
        """Returns posterior, joint speeds and the lead to use; before the first throw the cell file's."""
        posterior = learn_release(self.seen, prior_state(self.truth.assumed_delay_s, 0.0))
        pairs = np.reshape(self.speeds_seen, (-1, 2, 6))
        lead = float(posterior.state[0]) if self.seen else self.truth.assumed_delay_s
        return posterior, learn_joint_speeds(pairs[:, 0], pairs[:, 1]), lead

    def target(self, i: int) -> np.ndarray:
        """Returns the target of plan `i` (2,) [m]."""
        return self.plans[i].problem.release.p_W[:2]  # type: ignore[union-attr]

    def one_throw(
        self, known: tuple[ReleasePosterior, JointSpeeds, float], i: int, aims: bool, samples: tuple[int, int]
    ):
        """Throws plan `i`, aimed with what is known; returns the throw, its shifted forecast and the shift."""
        posterior, speeds, lead = known
        guess = forecast(posterior, speeds, self.tables[i], lead, *samples)
        shift = self.target(i) - guess.center if aims else NO_SHIFT
        late = float(self.truth.openings(self.rng, 1)[0]) - lead
        return throw(self.rng, self.truth, self.plans[i], late, shift), LandingForecast(guess.points + shift), shift

    def ordinary_throw(self, known: tuple[ReleasePosterior, JointSpeeds, float]) -> None:
        """Throws a plan at random and remembers what is observed of it."""
        i = int(self.rng.integers(len(self.plans)))
        true, _, shift = self.one_throw(known, i, bool(self.seen), AIMING_SAMPLES)
        table = self.tables[i]
        self.speeds_seen.append((table.qd[table.planned], true.deviation))
        table = table.deviated(true.deviation)
        self.seen.append(ObservedThrow(table, known[2], true.seen - shift, CAMERA_STD_M, SPEED_VARIANCE))


def throws_report(throws: list[PlannedThrow], seed: int, cells: int = 200, diagram: Path | None = None) -> str:
    """Returns the learning curves and the honesty of the odds; writes the reliability diagram where asked to."""
    assessed = assessed_throws(throws, seed, cells)
    head = f"Ordinary throws: {cells} hidden cells, a third misspecified, {len(assessed)} assessed throws, seed {seed}"
    if diagram is not None:
        diagram.write_text(reliability_svg(_reliability(assessed), f"{len(assessed)} throws in {cells} hidden cells"))
    return "\n".join([head, "", *_curves(assessed), "", *_odds(assessed), "", *_bins(assessed)])


def assessed_throws(throws: list[PlannedThrow], seed: int, cells: int) -> list[AssessedThrow]:
    """Returns every assessed throw of `cells` hidden cells."""
    tables = [throw_table(planned.problem, planned.trajectory) for planned in throws]
    found = []
    for k in range(cells):
        rng = np.random.default_rng([seed, k])
        cell = LearningCell(rng, hidden_cell(rng, misspecified=k % 3 == 0), throws, tables)
        for n in range(max(STAGES) + 1):
            known = cell.learn()
            if n in STAGES:
                found += [_assess(cell, known, k, n) for _ in range(ASSESSED)]
            if n < max(STAGES):
                cell.ordinary_throw(known)
    return found


def _assess(cell: LearningCell, known: tuple[ReleasePosterior, JointSpeeds, float], k: int, n: int) -> AssessedThrow:
    i = int(cell.rng.integers(len(cell.plans)))
    target = cell.target(i)
    true, guess, _ = cell.one_throw(known, i, n > 0, SAMPLES)
    best, _, _ = cell.one_throw(_oracle(cell.truth), i, True, AIMING_SAMPLES)
    return AssessedThrow(
        cell=k,
        misspecified=cell.truth.cling_share > 0.0,
        stage=n,
        window_s=cell.plans[i].window_s,
        miss_m=float(np.linalg.norm(true.landing - target)),
        oracle_miss_m=float(np.linalg.norm(best.landing - target)),
        hit_probabilities=tuple(guess.hit_probability(target, radius) for radius in RADII_M),
        miss_radius_m=guess.miss_radius(target),
    )


def _oracle(truth: HiddenCell) -> tuple[ReleasePosterior, JointSpeeds, float]:
    """Returns the truth in the form of a posterior without doubt."""
    delay, jitter = truth.true_delay()
    mean = np.array([[delay, truth.factor, *truth.offset, truth.drag, truth.turn_rad]])
    cling = (max(CERTAIN * truth.cling_share, 1e-9), CERTAIN)
    posterior = ReleasePosterior(np.ones(1), mean, np.zeros((1, 6, 6)), np.array([jitter]), np.zeros(1), *cling)
    return posterior, JointSpeeds(truth.gain - 1.0, np.zeros(6), CERTAIN, CERTAIN * truth.noise_rad_s**2), delay


def _curves(assessed: list[AssessedThrow]) -> list[str]:
    """Returns median misses by throws and cells: a cell's over the first, the oracle's beside."""
    lines = ["| throws | cells | " + " | ".join(f"after {n} [mm]" for n in STAGES) + " | oracle [mm] |"]
    lines[-1] += " after 5 / first | after 10 / oracle |"
    lines.append("|---" * (len(STAGES) + 5) + "|")
    for kind, wanted in (("soonest", {0.0}), ("robust", {0.01, 0.02})):
        for cells, choice in (("well specified", {False}), ("misspecified", {True}), ("all", {False, True})):
            some = [t for t in assessed if t.window_s in wanted and t.misspecified in choice]
            miss = [1e3 * float(np.median([t.miss_m for t in some if t.stage == n])) for n in STAGES]
            oracle = 1e3 * float(np.median([t.oracle_miss_m for t in some]))
            values = " | ".join(f"{m:.0f}" for m in miss)
            lines.append(
                f"| {kind} | {cells} | {values} | {oracle:.0f} | {miss[3] / miss[0]:.2f} | {miss[4] / oracle:.2f} |"
            )
    return lines


def _odds(assessed: list[AssessedThrow]) -> list[str]:
    lines = ["| cells | calibration error 5, 10 cm | Brier score 5, 10 cm / base rate's | 90 % miss radius covers |"]
    lines.append("|---|---|---|---|")
    for name, choice in (("all", {False, True}), ("well specified", {False}), ("misspecified", {True})):
        some = [t for t in assessed if t.misspecified in choice]
        errors = []
        scores = []
        for r in range(len(RADII_M)):
            predicted, hit = hits_of(some, r)
            errors.append(f"{calibration_error(predicted, hit):.3f}")
            scores.append(f"{brier_share(predicted, hit):.2f}")
        covered = np.mean([t.miss_m <= t.miss_radius_m for t in some])
        lines.append(f"| {name} | {', '.join(errors)} | {', '.join(scores)} | {covered:.1%} |")
    return lines


def _bins(assessed: list[AssessedThrow]) -> list[str]:
    lines = ["| predicted (5 cm) | hit | throws | 99 % band | inside |", "|---|---|---|---|---|"]
    for b in _reliability(assessed):
        band = f"{b.band[0]:.3f} … {b.band[1]:.3f}"
        lines.append(f"| {b.predicted:.3f} | {b.hit:.3f} | {b.count} | {band} | {'yes' if b.is_inside else 'NO'} |")
    return lines


def _reliability(assessed: list[AssessedThrow]) -> list[Bin]:
    return reliability_bins(*hits_of(assessed, 0), np.array([t.cell for t in assessed]))


def hits_of(assessed: list[AssessedThrow], radius: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns predicted probabilities and hits of one of the radii."""
    predicted = np.array([t.hit_probabilities[radius] for t in assessed])
    return predicted, np.array([float(t.miss_m <= RADII_M[radius]) for t in assessed])
