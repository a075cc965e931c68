"""Forecasts of landings, and the regression of joint speeds behind them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.learning.ordinary_throws import AssessedThrow, assessed_throws
from benchmarks.learning.plans import PlannedThrow
from benchmarks.learning.reliability import brier_share, calibration_error, reliability_bins
from learning import JointSpeeds, LandingForecast, ReleasePosterior, forecast, learn_joint_speeds, throw_table
from learning.throws import Throws, bin_rim
from planner.geometry import tool_state
from planner.releases import Opening


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


@pytest.mark.parametrize("ahead_m", [-0.06, -0.03, 0.0, 0.03, 0.06, 0.1])
def test_odds_of_a_bin_are_those_of_flights_that_clear_its_rim(soonest: list[PlannedThrow], ahead_m: float):
    """Beside balls followed by the millisecond: they may touch neither the rim's edge nor the wall below it.

    The bin lies ahead of where they land, or behind. The room at the rim is that of its near edge all around, so that
    the odds may be too low by a little, where balls pass at its sides.
    """
    planned = soonest[1]
    problem = planned.problem
    radius, rim, ball = 0.15, 0.1, problem.cell.object.radius_m
    target = problem.release.target
    assert target is not None
    table = throw_table(problem, planned.trajectory)
    along = table.J[table.planned][:2] @ table.qd[table.planned]
    bin_W = target.p_W + np.append(ahead_m * along / np.linalg.norm(along), 0.0)
    into = problem.with_release(problem.release.with_target(replace(target, p_W=bin_W, opening=Opening(radius, rim))))
    found = forecast(certain(0.005), STEADY, table, 0.060, 400, 10, bin_rim(into, table))
    odds = found.hit_probability(bin_W[:2], radius - ball)
    late = 0.005 * np.random.default_rng(5).standard_normal(1500)
    q, qd, _ = planned.trajectory.at(planned.trajectory.release_time_s + late)
    states = [tool_state(problem.cell, *each) for each in zip(q, qd, strict=True)]
    share = np.mean([falls_in(s.p_WT, s.v_WT, problem.gravity, bin_W, radius, rim, ball) for s in states])
    assert odds <= share + 0.03
    assert odds >= share - 0.10


def falls_in(p: np.ndarray, v: np.ndarray, g: float, bin_W: np.ndarray, radius: float, rim: float, ball: float) -> bool:
    """Returns whether a ball that flies from p at v, both (3,), lands on a bin's bottom without touching it before."""
    lands = (v[2] + np.sqrt(v[2] ** 2 + 2.0 * g * (p[2] - bin_W[2]))) / g
    t = np.arange(0.0, lands, 0.001)[:, None]
    at = p + v * t - 0.5 * g * t**2 * np.array([0.0, 0.0, 1.0]) - bin_W
    off = np.linalg.norm(at[:, :2], axis=1)
    edge = np.hypot(off - radius, at[:, 2] - rim)
    below = at[:, 2] < rim
    return bool(edge.min() >= ball and np.all(off[below] <= radius - ball))


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


@pytest.mark.slow
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
