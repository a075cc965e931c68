"""The trajectory between samples, against scipy's piecewise polynomials."""

import numpy as np
import pytest
from scipy.interpolate import PPoly

from planner.trajectory import Trajectory, integrate, join

RNG = np.random.default_rng(5)


def random_motion(n=40, dt=0.002):
    jerk = RNG.uniform(-500.0, 500.0, (n, 6))
    q0, qd0, qdd0 = RNG.normal(size=(3, 6))
    return jerk, (q0, qd0, qdd0), integrate(q0, qd0, qdd0, jerk, dt)


def test_integration_and_evaluation_agree_with_piecewise_polynomials():
    jerk, (q0, qd0, qdd0), (q, qd, qdd) = random_motion()
    knots = np.arange(41) * 0.002
    acceleration = PPoly(np.array([jerk, qdd[:-1]]), knots)
    velocity = acceleration.antiderivative()
    velocity.c[-1] += qd0
    position = velocity.antiderivative()
    position.c[-1] += q0
    trajectory = Trajectory(500.0, q, qd, qdd, release_index=40)
    t = RNG.uniform(0.0, 0.08, 200)
    at = trajectory.at(t)
    np.testing.assert_allclose(at[0], position(t), atol=1e-12)
    np.testing.assert_allclose(at[1], velocity(t), atol=1e-11)
    np.testing.assert_allclose(at[2], acceleration(t), atol=1e-9)
    np.testing.assert_allclose(trajectory.jerk, jerk, rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(qdd0, qdd[0])


def test_outside_its_time_a_trajectory_stands_at_its_ends():
    _, _, arrays = random_motion()
    trajectory = Trajectory(500.0, *arrays, release_index=0)
    np.testing.assert_allclose(trajectory.at(-1.0)[0], arrays[0][0])
    np.testing.assert_allclose(trajectory.at(99.0)[0], arrays[0][-1], atol=1e-12)


def test_join_keeps_the_release_once():
    _, _, head = random_motion(10)
    tail = integrate(head[0][-1], head[1][-1], head[2][-1], np.ones((5, 6)), 0.002)
    trajectory = join(head, tail, 500.0)
    assert len(trajectory.q) == 16
    assert trajectory.release_index == 10
    assert trajectory.release_time_s == pytest.approx(0.02)
    assert trajectory.duration_s == pytest.approx(0.03)


def test_what_is_left_of_a_motion_is_the_same_motion_later():
    _, _, arrays = random_motion()
    whole = Trajectory(500.0, *arrays, release_index=30)
    left = whole.since(12)
    assert left.release_index == 18
    t = np.linspace(0.0, left.duration_s, 7)
    np.testing.assert_allclose(left.at(t), whole.at(t + 0.024), atol=1e-9)


def test_samples_are_read_only_and_must_fit():
    _, _, (q, qd, qdd) = random_motion()
    trajectory = Trajectory(500.0, q, qd, qdd, release_index=3)
    with pytest.raises(ValueError, match="read-only"):
        trajectory.q[0, 0] = 1.0
    with pytest.raises(ValueError, match="must be one"):
        Trajectory(500.0, q, qd[:-1], qdd, release_index=3)
    with pytest.raises(ValueError, match="release_index"):
        Trajectory(500.0, q, qd, qdd, release_index=41)
