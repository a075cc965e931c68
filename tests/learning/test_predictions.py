"""Forecasts of landings, and the regression of joint speeds behind them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.learning.ordinary_throws import AssessedThrow, assessed_throws
from benchmarks.learning.plans import PlannedThrow
from benchmarks.learning.reliability import brier_share, calibration_error, reliability_bins
from learning import JointSpeeds, LandingForecast, ReleasePosterior, forecast, learn_joint_speeds, throw_table
from learning.throws import Throws


def certain(jitter_s: float, **changes: float) -> ReleasePosterior:
    state = np.array([[0.060, 1.0, 0.0, 0.0, 0.0, 0.0]])
    for name, value in changes.items():
        state[0, ["lead_s", "factor"].index(name)] = value
    return ReleasePosterior(np.ones(1), state, np.zeros((1, 6, 6)), np.array([jitter_s]), np.zeros(1), 1e-9, 1e9)


STEADY = JointSpeeds(np.zeros(6), np.zeros(6), 1e9, 1e-3)


def test_a_known_cell_lands_where_the_plan_says(soonest: list[PlannedThrow]):
    planned = soonest[0]
    table = throw_table(planned.problem, planned.trajectory)
    found = forecast(certain(0.0), STEADY, table, 0.060)
    target = planned.problem.release.p_W[:2]  # type: ignore[union-attr]
    assert found.center == pytest.approx(target, abs=1e-3)
    assert found.hit_probability(target, 0.01) == 1.0
    assert found.hit_interval(target, 0.01) == (1.0, 1.0)


def test_jitter_spreads_the_landings_along_their_drift(soonest: list[PlannedThrow]):
    """To first order the standard deviation is jitter times the landing's drift by the release time."""
    planned = soonest[1]
    jitter = 0.001
    table = throw_table(planned.problem, planned.trajectory)
    found = forecast(certain(jitter), STEADY, table, 0.060, 400, 10)
    later = forecast(certain(0.0, lead_s=0.061), STEADY, table, 0.060).center
    drift = later - forecast(certain(0.0), STEADY, table, 0.060).center
    assert np.sqrt(np.trace(found.covariance)) == pytest.approx(np.linalg.norm(drift), rel=0.1)


def test_scatter_of_the_joints_spreads_as_its_derivatives(soonest: list[PlannedThrow]):
    planned = soonest[2]
    scatter = 0.02
    table = throw_table(planned.problem, planned.trajectory)
    noisy = JointSpeeds(np.zeros(6), np.zeros(6), 1e9, 1e9 * scatter**2)
    found = forecast(certain(0.0), noisy, table, 0.060, 1600, 10)
    Q = Throws([table]).by_joint_speed(np.zeros(1), np.ones(1))[0]
    assert found.covariance == pytest.approx(scatter**2 * Q @ Q.T, rel=0.15, abs=1e-6)


def test_gains_and_scatter_come_out_of_recordings():
    rng = np.random.default_rng(2)
    qd = rng.uniform(-3.0, 3.0, (400, 6))
    gains = np.array([0.02, -0.01, 0.0, 0.01, 0.03, -0.02])
    found = learn_joint_speeds(qd, gains * qd + 0.015 * rng.standard_normal(qd.shape))
    assert found.gain_error == pytest.approx(gains, abs=0.003)
    assert found.scatter_rad_s == pytest.approx(0.015, rel=0.05)
    unseen = learn_joint_speeds(np.zeros((0, 6)), np.zeros((0, 6)))
    assert unseen.gain_error == pytest.approx(np.zeros(6))
    assert unseen.gain_std == pytest.approx(np.full(6, 0.02), rel=0.3)


def test_learning_from_ordinary_throws_quickly(soonest: list[PlannedThrow]):
    """A small version of the benchmark, to see that its numbers are of the right size."""
    assessed = assessed_throws(soonest, 7, 6)

    def median(n: int) -> float:
        return float(np.median([t.miss_m for t in assessed if t.stage == n]))

    assert median(5) < 0.5 * median(0)
    assert median(10) < 2.0 * float(np.median([t.oracle_miss_m for t in assessed]))
    covered = np.mean([t.miss_m <= t.miss_radius_m for t in assessed if t.stage > 0])
    assert 0.75 < covered <= 1.0
    assert isinstance(assessed[0], AssessedThrow)


def test_honest_forecasts_are_called_honest_and_others_not():
    rng = np.random.default_rng(3)
    p = rng.random(8000)
    cell = np.repeat(np.arange(200), 40)
    hit = (rng.random(8000) < p).astype(float)
    assert calibration_error(p, hit) < 0.02
    assert all(b.is_inside for b in reliability_bins(p, hit, cell))
    assert brier_share(p, hit) == pytest.approx((1 / 6) / (1 / 4), rel=0.05)  # E[p(1-p)] / (1/4) for uniform p
    sure = np.where(p > 0.5, 0.95, 0.05)
    assert calibration_error(sure, hit) > 0.15
    assert not all(b.is_inside for b in reliability_bins(sure, hit, cell))


def test_beside_a_target_that_may_be_elsewhere_landings_spread_by_that():
    points = np.random.default_rng(3).normal([1.0, 0.2], 0.02, (200, 10, 2))
    guess = LandingForecast(points)
    beside = guess.beside_target(0.03)
    assert np.allclose(beside.covariance, guess.covariance + 0.03**2 * np.eye(2), atol=1e-4)
    assert beside.hit_probability(np.array([1.0, 0.2]), 0.05) == pytest.approx(
        1.0 - np.exp(-(0.05**2) / 2.0 / (0.02**2 + 0.03**2)), abs=0.03
    )  # of a Rayleigh distribution
