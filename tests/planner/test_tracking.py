"""The filter of tracked targets against a dense Gaussian posterior of all observations at once, and against samples."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from planner.tracking import (
    INNOVATION_MAX,
    SPEED_STD_M_S,
    MotionUncertainty,
    ObservationRefused,
    TargetObservation,
    TargetTrack,
)

DRIFT_M_S = 0.02
BEGUN_S = 500.0


def observations(count: int, seed: int, measures_velocity: bool = False) -> list[TargetObservation]:
    """Returns observations of a target on a belt whose speed wanders, at uneven times and with uneven noise."""
    rng = np.random.default_rng(seed)
    p = np.array([1.0, -0.5, 0.02])
    v = np.array([0.1, 0.35, 0.0])
    at_s = BEGUN_S
    seen = []
    for _ in range(count):
        std_m = float(rng.uniform(0.002, 0.006))
        place = tuple((p + std_m * rng.standard_normal(3)).tolist())
        speed = {}
        if measures_velocity and rng.random() < 0.5:
            told = v + np.append(0.01 * rng.standard_normal(2), 0.0)
            speed = {"velocity": tuple(told.tolist()), "velocity_std_m_s": 0.01}
        seen.append(TargetObservation(place, std_m, at_s, **speed))
        later_s = float(rng.uniform(0.01, 0.2))
        p = p + later_s * v
        v = v + np.append(DRIFT_M_S * np.sqrt(later_s) * rng.standard_normal(2), 0.0)
        at_s += later_s
    return seen


def tracked(seen: list[TargetObservation]) -> TargetTrack:
    track = TargetTrack.begun(seen[0], DRIFT_M_S)
    for each in seen[1:]:
        track = track.observed(each)
    return track


def integrated(s: float, t: float) -> tuple[float, float, float, float]:
    """Returns the covariances of a Wiener process and its integral at two times, of unit rate.

    They are of integral and integral, integral and process, process and integral, process and process; by
    integration of min(s, t), not by the steps of a filter.
    """
    low = min(s, t)
    both = low**2 * (3.0 * max(s, t) - low) / 6.0
    of_integral_s = 0.5 * s**2 if s <= t else s * t - 0.5 * t**2
    of_integral_t = 0.5 * t**2 if t <= s else s * t - 0.5 * s**2
    return both, of_integral_s, of_integral_t, low


def posterior(seen: list[TargetObservation], axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns place and velocity at the last observation, and their covariance, from all observations at once."""
    last_s = seen[-1].observed_at_s - BEGUN_S
    wide = 1e3  # [m] as good as unknown; the filter begins at its first observation
    rows = []  # (is a velocity, time, value, variance)
    for each in seen:
        s = each.observed_at_s - BEGUN_S
        rows.append((False, s, each.position[axis], each.std_m**2))
        if each.velocity is not None:
            rows.append((True, s, each.velocity[axis], each.velocity_std_m_s**2))

    def covariance(a: tuple[bool, float], b: tuple[bool, float]) -> float:
        (a_speed, s), (b_speed, t) = a, b
        pp, pv, vp, vv = integrated(s, t)
        noise = DRIFT_M_S**2
        prior = SPEED_STD_M_S**2
        if a_speed and b_speed:
            return prior + noise * vv
        if a_speed:
            return t * prior + noise * vp
        if b_speed:
            return s * prior + noise * pv
        return wide**2 + s * t * prior + noise * pp

    known = [(speed, s) for speed, s, _, _ in rows]
    wanted = [(False, last_s), (True, last_s)]
    K = np.array([[covariance(a, b) for b in known] for a in known]) + np.diag([row[3] for row in rows])
    C = np.array([[covariance(a, b) for b in known] for a in wanted])
    P = np.array([[covariance(a, b) for b in wanted] for a in wanted])
    gain = np.linalg.solve(K, C.T).T
    return gain @ np.array([row[2] for row in rows]), P - gain @ C.T


@pytest.mark.parametrize("measures_velocity", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_the_track_is_the_posterior_of_all_observations(seed: int, measures_velocity: bool) -> None:
    seen = observations(25, seed, measures_velocity)
    track = tracked(seen)
    for axis in (0, 1):
        mean, covariance = posterior(seen, axis)
        assert track.position[axis] == pytest.approx(mean[0], abs=1e-6)
        assert track.velocity[axis] == pytest.approx(mean[1], abs=1e-6)
        place, both, velocity = track.uncertainty.covariance
        np.testing.assert_allclose([place, both, velocity], covariance[[0, 0, 1], [0, 1, 1]], rtol=1e-3)
    weights = np.array([each.std_m**-2 for each in seen])
    heights = np.array([each.position[2] for each in seen])
    assert track.position[2] == pytest.approx(np.average(heights, weights=weights), abs=1e-12)
    assert track.height_std_m == pytest.approx(weights.sum() ** -0.5, rel=1e-9)
    assert track.velocity[2] == 0.0


def test_without_drift_it_is_a_line_by_least_squares() -> None:
    rng = np.random.default_rng(7)
    seen = [
        TargetObservation(tuple(0.1 * s * np.array([1.0, 3.0, 0.0]) + 0.003 * rng.standard_normal(3)), 0.003, s)
        for s in np.sort(rng.uniform(0.0, 2.0, 40)).tolist()
    ]
    track = TargetTrack.begun(seen[0], 0.0)
    for each in seen[1:]:
        track = track.observed(each)
    s = np.array([each.observed_at_s for each in seen]) - seen[-1].observed_at_s
    for axis in (0, 1):
        slope, place = np.polyfit(s, [each.position[axis] for each in seen], 1)
        assert track.position[axis] == pytest.approx(place, abs=1e-6)
        assert track.velocity[axis] == pytest.approx(slope, abs=1e-6)


def test_uncertainty_grows_as_samples_of_wandering_targets_do() -> None:
    begun = MotionUncertainty(0.01, 0.05, 0.6, 0.1)
    rng = np.random.default_rng(1)
    steps, s = 400, 1.5
    place, both, velocity = begun.covariance
    p, v = rng.multivariate_normal([0.0, 0.0], [[place, both], [both, velocity]], 20_000).T
    for _ in range(steps):
        p = p + s / steps * v
        v = v + 0.1 * np.sqrt(s / steps) * rng.standard_normal(len(v))
    later = begun.after(s)
    assert later.position_std_m == pytest.approx(p.std(), rel=0.02)
    assert later.velocity_std_m_s == pytest.approx(v.std(), rel=0.02)
    assert later.correlation == pytest.approx(np.corrcoef(p, v)[0, 1], abs=0.02)
    twice = begun.after(0.5).after(1.0)
    np.testing.assert_allclose(twice.covariance, later.covariance, rtol=1e-9)


def test_innovations_of_a_target_that_moves_as_assumed_are_chi_square() -> None:
    sizes = []
    for seed in range(60):
        seen = observations(30, 100 + seed)
        track = TargetTrack.begun(seen[0], DRIFT_M_S)
        for each in seen[1:]:
            track = track.observed(each)
            sizes.append(track.chi_square)
    assert np.mean(sizes) == pytest.approx(3.0, rel=0.06)
    assert np.mean(np.array(sizes) < 7.815) == pytest.approx(0.95, abs=0.015)  # of tables: 95 % with three numbers


def test_an_observation_far_from_what_was_predicted_is_refused() -> None:
    seen = observations(30, 3)
    track = tracked(seen[:-1])
    last = seen[-1]
    predicted = track.after(last.observed_at_s - track.observed_at_s)
    total = np.hypot(predicted.uncertainty.position_std_m, last.std_m)
    for deviations, is_taken in ((5.5, True), (5.8, False)):  # 5.64^2 = 31.8
        x, y, z = predicted.position
        away = replace(last, position=(x + deviations * total, y, z))
        if is_taken:
            assert track.observed(away).chi_square == pytest.approx(deviations**2, rel=1e-6)
            continue
        with pytest.raises(ObservationRefused, match=r"limit 31\.8") as refused:
            track.observed(away)
        assert refused.value.field == "position"
    fast = replace(last, position=predicted.position, velocity=(2.0, 0.0, 0.0), velocity_std_m_s=0.01)
    with pytest.raises(ObservationRefused, match="m/s") as refused:
        track.observed(fast)
    assert refused.value.field == "velocity"
    assert track.observed(last).chi_square_max == INNOVATION_MAX[3]


@pytest.mark.parametrize("later_s", [0.0, -0.1])
def test_times_that_are_repeated_or_out_of_order_are_refused(later_s: float) -> None:
    seen = observations(3, 0)
    track = tracked(seen)
    with pytest.raises(ObservationRefused, match="not after") as refused:
        track.observed(replace(seen[-1], observed_at_s=seen[-1].observed_at_s + later_s))
    assert refused.value.field == "observed_at_s"


def test_a_target_that_comes_back_after_long_is_still_known_to_its_observation() -> None:
    first = TargetObservation((1.0, 0.0, 0.0), 1e-6, 0.0)
    track = TargetTrack.begun(first, 0.0).observed(replace(first, observed_at_s=1e9, position=(2.0, 0.0, 0.0)))
    assert 0.0 < track.uncertainty.position_std_m <= 1e-6
    assert 0.0 <= track.uncertainty.velocity_std_m_s < 1e-6
    assert track.velocity[0] == pytest.approx(1e-9, rel=1e-3)


def test_a_track_is_read_as_it_was_written() -> None:
    track = tracked(observations(10, 2, True))
    assert TargetTrack.from_document(json.loads(json.dumps(track.as_document()))) == track
