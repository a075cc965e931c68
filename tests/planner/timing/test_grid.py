"""Bringing motions onto the tick grid: end states exact, limits kept, as little changed as possible."""

import numpy as np
import pytest
import ruckig

from planner.timing import fits, grid_limits, onto_grid
from planner.trajectory import integrate
from tests.planner.problems import cell

RNG = np.random.default_rng(2)


def launch(limits, dt):
    """A random Ruckig launch: its end state and its accelerations at the ticks."""
    request = ruckig.InputParameter(6)
    request.current_position = [0.0] * 6
    request.target_position = list(RNG.uniform(-2.0, 2.0, 6))
    request.target_velocity = list(RNG.uniform(-0.8, 0.8, 6) * limits.qd_max)
    request.max_velocity, request.max_acceleration = list(limits.qd_max), list(limits.qdd_max)
    request.max_jerk = list(limits.jerk_max)
    request.duration_discretization = ruckig.DurationDiscretization.Discrete
    motion = ruckig.Trajectory(6)
    ruckig.Ruckig(6, dt).calculate(request, motion)
    count = round(motion.duration / dt)
    end = (np.array(request.target_position), np.array(request.target_velocity), np.zeros(6))
    return end, np.array([motion.at_time(i * dt)[2] for i in range(count + 1)]), motion


@pytest.mark.parametrize("arm", ["ur5e-sim", "ur5-sim", "ur3e-sim", "ur10e-sim"])
def test_end_states_are_exact_and_limits_kept(arm):
    here = cell(arm)
    dt = 1.0 / here.robot.sample_rate_hz
    zero = np.zeros(6)
    for _ in range(40):
        end, qdd, motion = launch(grid_limits(here.limits, dt), dt)
        samples = onto_grid((zero, zero, zero), end, qdd, dt, here.limits.jerk_max)
        for reached, asked in zip(samples, end, strict=True):
            np.testing.assert_array_equal(reached[-1], asked)
        assert fits(samples, here.limits, dt)
        again = integrate(zero, zero, zero, np.diff(samples[2], axis=0) / dt, dt)
        np.testing.assert_allclose(samples[0], again[0], atol=1e-10)
        exact = np.array([motion.at_time(i * dt)[0] for i in range(len(qdd))])
        np.testing.assert_allclose(samples[0], exact, atol=here.limits.jerk_max.max() * dt**2)


def test_three_ticks_are_enough_for_any_end_state():
    dt = 0.002
    zero = np.zeros(6)
    end = (RNG.normal(size=6) * 1e-6, RNG.normal(size=6) * 1e-3, RNG.normal(size=6) * 0.1)
    samples = onto_grid((zero, zero, zero), end, np.zeros((4, 6)), dt, np.full(6, 500.0))
    for reached, asked in zip(samples, end, strict=True):
        np.testing.assert_array_equal(reached[-1], asked)


def test_what_exceeds_a_limit_does_not_fit():
    limits = cell().limits
    dt = 0.002
    still = np.zeros((5, 6))
    assert fits((still, still, still), limits, dt)
    fast = still.copy()
    fast[2, 3] = limits.qd_max[3] * 1.0001
    assert not fits((still, fast, still), limits, dt)
    assert not fits((still, still, np.cumsum(np.full((5, 6), 1.01 * 500.0 * dt), axis=0)), limits, dt)
