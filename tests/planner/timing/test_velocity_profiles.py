"""Textbook motions against what defines them: ends, limits, finite differences, known shortest times."""

from dataclasses import replace

import numpy as np
import pytest

from planner.errors import SolverFailed
from planner.seeds import least_time
from planner.timing import (
    cubic_brake,
    linear_brake,
    shortest_cubic,
    shortest_ramp,
    shortest_trapezoid,
    shortest_triangle,
    whole_ticks,
)
from planner.timing.velocity_profiles import trapezoid
from tests.planner.problems import cell

LIMITS = cell().limits
DT = 0.002
RNG = np.random.default_rng(11)
CASES = [(RNG.uniform(-1.5, 1.5, 6), RNG.uniform(-0.9, 0.9, 6) * LIMITS.qd_max) for _ in range(40)]
MAKERS = {"cubic": shortest_cubic, "trapezoid": shortest_trapezoid}


@pytest.mark.parametrize("kind", MAKERS)
@pytest.mark.parametrize("rest", [False, True], ids=["to speed", "to rest"])
def test_ends_are_met_and_limits_kept(kind, rest):
    for d, v in CASES:
        v = 0.0 * v if rest else v
        motion = MAKERS[kind](d, v, LIMITS, DT)
        q, qd, qdd = motion.at(np.linspace(0.0, motion.duration_s, 2001))
        np.testing.assert_allclose([q[0], qd[0]], 0.0, atol=1e-12)
        np.testing.assert_allclose(q[-1], d, atol=1e-9)
        np.testing.assert_allclose(qd[-1], v, atol=1e-9)
        assert np.all(np.abs(qd) <= LIMITS.qd_max + 1e-9)
        assert np.all(np.abs(qdd) <= LIMITS.qdd_max + 1e-6)


@pytest.mark.parametrize("kind", MAKERS)
def test_velocity_and_acceleration_are_the_derivatives(kind):
    for d, v in CASES[:10]:
        motion = MAKERS[kind](d, v, LIMITS, DT)
        t = np.linspace(0.01, motion.duration_s - 0.01, 301)
        h = 1e-6
        (early, *_), (late, *_) = motion.at(t - h), motion.at(t + h)
        _, qd, _ = motion.at(t)
        np.testing.assert_allclose((late - early) / (2 * h), qd, atol=1e-4)
        (_, slow, _), (_, fast, _) = motion.at(t - h), motion.at(t + h)
        smooth = np.abs((fast - slow) / (2 * h) - motion.at(t)[2]) < 1e-3
        assert smooth.mean() > 0.98  # all but the instants at which a trapezoid's acceleration steps


def test_no_shorter_cubic_keeps_the_limits():
    for d, v in CASES[:20]:
        best = shortest_cubic(d, v, LIMITS, DT)
        for count in range(1, round(best.duration_s / DT)):
            shorter = replace(best, duration_s=count * DT)
            _, qd, qdd = shorter.at(np.linspace(0.0, shorter.duration_s, 401))
            assert np.any(np.abs(qd) > LIMITS.qd_max * 0.9999) or np.any(np.abs(qdd) > LIMITS.qdd_max * 0.9999)


def test_the_trapezoid_takes_the_least_time_there_is():
    for d, v in CASES:
        motion = shortest_trapezoid(d, v, LIMITS, DT)
        bound = float(least_time(d, v, LIMITS))
        assert bound - 1e-9 <= motion.duration_s <= bound + DT


def test_a_trapezoid_can_be_as_slow_as_one_likes():
    for d, v in CASES[:10]:
        for stretch in (1.0, 1.1, 2.0, 5.0):
            duration = stretch * shortest_trapezoid(d, v, LIMITS, DT).duration_s
            q, qd, _ = trapezoid(d, v, duration, LIMITS.qdd_max).at(np.linspace(0.0, duration, 501))
            np.testing.assert_allclose(q[-1], d, atol=1e-9)
            np.testing.assert_allclose(qd[-1], v, atol=1e-9)
            assert np.all(np.abs(qd) <= LIMITS.qd_max + 1e-9)


def test_a_triangle_accelerates_evenly_half_the_way():
    d = np.array([0.5, -0.2, 0.0, 0.1, 0.3, -0.5])
    motion = shortest_triangle(d, LIMITS, DT)
    q, qd, _ = motion.at(np.array([motion.duration_s / 2, motion.duration_s]))
    np.testing.assert_allclose(q, [d / 2, d], atol=1e-12)
    np.testing.assert_allclose(qd, [2 * d / motion.duration_s, 0 * d], atol=1e-12)
    assert motion.duration_s == pytest.approx(2 * np.sqrt(0.5 / LIMITS.qdd_max[0]), abs=DT)


def test_a_ramp_is_straight_along_the_velocity():
    v = np.array([1.0, -2.0, 0.5, 0.0, 0.3, -0.1])
    motion = shortest_ramp(v, LIMITS, DT)
    t = np.linspace(0.0, motion.duration_s, 7)
    q, qd, _ = motion.at(t)
    np.testing.assert_allclose(qd, np.outer(t / motion.duration_s, v), atol=1e-12)
    np.testing.assert_allclose(q[-1], v * motion.duration_s / 2, atol=1e-12)
    assert motion.duration_s == pytest.approx(2.0 / LIMITS.qdd_max[1], abs=DT)


@pytest.mark.parametrize("brake", [linear_brake, cubic_brake])
def test_brakes_stop_straight_within_the_acceleration(brake):
    v = np.array([1.0, -2.0, 0.5, 0.0, 0.3, -0.1])
    qd = brake(v, LIMITS, DT)
    np.testing.assert_allclose(qd[[0, -1]], [v, 0 * v])
    np.testing.assert_allclose(qd, np.outer(qd[:, 0] / v[0], v), atol=1e-12)
    assert np.all(np.abs(np.diff(qd, axis=0)) <= LIMITS.qdd_max * DT + 1e-12)


def test_what_would_take_too_long_is_refused():
    slow = replace(LIMITS, qd_max=np.full(6, 1e-3))
    with pytest.raises(SolverFailed):
        shortest_cubic(np.ones(6), np.zeros(6), slow, DT)
    with pytest.raises(SolverFailed):
        shortest_trapezoid(np.ones(6), np.zeros(6), slow, DT)


def test_whole_ticks_forgive_rounding():
    assert whole_ticks(0.3, 0.1) == 3
    assert whole_ticks(0.3001, 0.1) == 4
    assert whole_ticks(0.0, 0.1) == 1
