"""Ballistics against scipy's integrator, closed forms and finite differences."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from planner import flight

G = 9.81
RNG = np.random.default_rng(3)
RELEASES = [
    (np.array([0.4, -0.1, h]), np.array([vx, vy, vz]))
    for h, vx, vy, vz in RNG.uniform([0.2, -3.0, -3.0, -1.0], [1.2, 3.0, 3.0, 4.0], (20, 4))
]


def integrated(p, v, plane_z, drag):
    """Landing state and time by scipy's integrator with event location."""

    def ground(_t, x):
        return x[2] - plane_z

    ground.terminal = True
    ground.direction = -1
    solution = solved(p, v, 20.0, drag, events=ground)
    return solution.y_events[0][0], solution.t_events[0][0]


def solved(p, v, duration_s, drag, **options):
    """The flight by scipy's eighth-order integrator."""

    def rate(_t, x):
        return np.concatenate([x[3:], -drag * np.linalg.norm(x[3:]) * x[3:] - [0.0, 0.0, G]])

    return solve_ivp(rate, (0.0, duration_s), [*p, *v], method="DOP853", rtol=1e-12, atol=1e-13, **options)


@pytest.mark.parametrize("drag", [0.0, 0.05, 0.8])
def test_landing_agrees_with_an_integrator(drag):
    for p, v in RELEASES:
        flown = flight.fly(p, v, 0.05, G, drag)
        state, t = integrated(p, v, 0.05, drag)
        assert flown is not None
        np.testing.assert_allclose(flown.landing_point, state[:3], atol=1e-8)
        np.testing.assert_allclose(flown.landing_velocity, state[3:], atol=1e-8)
        assert flown.time_of_flight_s == pytest.approx(t, abs=1e-9)


@pytest.mark.parametrize("drag", [0.0, 0.3])
def test_apex_and_speed(drag):
    p = np.array([0.0, 0.0, 0.5])
    v = np.array([1.0, 0.5, 3.0])
    flown = flight.fly(p, v, 0.0, G, drag)
    assert flown is not None
    assert flown.speed_m_s == pytest.approx(math.sqrt(1.0 + 0.25 + 9.0))
    if drag == 0.0:
        heights = flight.path(p, v, np.linspace(0.0, 0.6, 20001), G, drag)[:, 2]
        assert flown.apex_height_m == pytest.approx(heights.max(), abs=1e-8)
    heights = solved(p, v, 0.6, drag, dense_output=True).sol(np.linspace(0.0, 0.6, 60001))[2]
    assert flown.apex_height_m == pytest.approx(heights.max(), abs=1e-7)


def test_a_plane_above_the_apex_is_never_reached():
    p = np.array([0.0, 0.0, 0.5])
    v = np.array([1.0, 0.0, 1.0])
    assert flight.fly(p, v, 2.0, G) is None
    assert flight.fly(p, v, 2.0, G, 0.1) is None
    assert np.isnan(flight.landing_points(p, v, 2.0, G)).all()


def test_landing_points_of_many_flights_are_those_of_one():
    p = np.array([r[0] for r in RELEASES])
    v = np.array([r[1] for r in RELEASES])
    many = flight.landing_points(p, v, 0.1, G)
    for row, (p_i, v_i) in zip(many, RELEASES, strict=True):
        flown = flight.fly(p_i, v_i, 0.1, G)
        assert flown is not None
        np.testing.assert_allclose(row, flown.landing_point, atol=1e-12)


@pytest.mark.parametrize("drag", [0.0, 0.4])
def test_sensitivities_agree_with_finite_differences(drag):
    step = 1e-5
    for p, v in RELEASES[:6]:
        sensitivity = flight.landing_sensitivity(p, v, 0.0, G, drag)
        assert sensitivity is not None
        for k in range(3):
            e = np.eye(3)[k] * step
            by_p = (integrated(p + e, v, 0.0, drag)[0][:3] - integrated(p - e, v, 0.0, drag)[0][:3]) / (2 * step)
            by_v = (integrated(p, v + e, 0.0, drag)[0][:3] - integrated(p, v - e, 0.0, drag)[0][:3]) / (2 * step)
            np.testing.assert_allclose(sensitivity[0][:, k], by_p, atol=2e-5)
            np.testing.assert_allclose(sensitivity[1][:, k], by_v, atol=2e-5)


def test_drift_by_a_late_release_agrees_with_finite_differences():
    p = np.array([0.5, 0.1, 0.8])
    v = np.array([1.5, -0.5, 2.0])
    a = np.array([3.0, -7.0, 4.0])

    def landing(delay):
        return integrated(p + v * delay + a * delay**2 / 2, v + a * delay, 0.0, 0.0)[0][:3]

    expected = (landing(1e-5) - landing(-1e-5)) / 2e-5
    np.testing.assert_allclose(flight.landing_per_release_delay(p, v, a, 0.0, G), expected, atol=1e-5)


@pytest.mark.parametrize("drag", [0.0, 0.3])
def test_launch_velocity_hits(drag):
    p = np.array([0.4, 0.2, 0.7])
    target = np.array([1.9, -0.6, 0.1])
    for time_s in (0.3, 0.5, 0.9):
        v = flight.launch_velocity(p, target, time_s, G, drag)
        assert v is not None
        state, t = integrated(p, v, target[2], drag)
        np.testing.assert_allclose(state[:3], target, atol=1e-7)
        assert t == pytest.approx(time_s, abs=1e-7)


def test_least_speed_is_least_over_flight_times():
    p = np.array([0.0, 0.0, 0.6])
    target = np.array([1.2, 0.4, 0.1])
    times = np.linspace(0.15, 1.5, 5000)
    speeds = [np.linalg.norm(flight.launch_velocity(p, target, t, G)) for t in times]
    assert float(flight.least_speed(p, target, G)) == pytest.approx(min(speeds), abs=1e-6)
    assert flight.slowest_time(p, target, G) == pytest.approx(times[int(np.argmin(speeds))], abs=1e-3)


def test_time_at_elevation_gives_that_elevation():
    p = np.array([0.0, 0.0, 0.6])
    target = np.array([1.2, 0.4, 0.1])
    elevations = np.array([-0.2, 0.3, 1.0])
    v = flight.launch_velocity(p, target, flight.time_at_elevation(p, target, elevations, G), G)
    np.testing.assert_allclose(flight.elevation(v), elevations, atol=1e-12)
    assert np.isnan(flight.time_at_elevation(p, target, -0.6, G))


def test_drag_constant_of_a_table_tennis_ball():
    # 2.7 g, 20 mm, c_d 0.45: k = 0.5 * 1.204 * 0.45 * pi * 4e-4 / 0.0027 = 0.126 /m
    assert flight.drag_constant(0.0027, 0.02, 0.45) == pytest.approx(0.12608, abs=1e-4)
