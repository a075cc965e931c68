"""The arm's lag and ramps, against closed forms."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from simulator.physics.lag import Lag
from tests.simulator.conftest import Driven, make_cell

FIT_WITHIN_S = 0.0005  # what the simulator promises: the fitted shift recovers the configured delay to 0.5 ms
SPEEDJ = 9
SPEED_STOP = 15


def speed(t):
    """A smooth joint speed [rad/s] with jerks of up to some 150 rad/s3."""
    return 1.5 * np.sin(9.0 * t) * np.sin(2.0 * t)


def streamed(robot, **sim):
    """Streams `speed` to all joints; returns when each was sent, and times and values of what was measured."""
    driven = Driven(make_cell(robot, **sim))
    dt = driven.controller.timeline.dt
    sent_at = []
    stamps = []
    measured = []
    for _ in range(round(1.5 / dt)):
        now = driven.controller.timeline.t
        sent_at.append(now)
        driven.write(SPEEDJ, [speed(now - sent_at[0])] * 6 + [40.0, dt])
        driven.cycle()
        stamps.append(driven.controller.timeline.t)
        measured.append(driven.arm.measured_qd[0])
    return np.array(sent_at) - sent_at[0], np.array(stamps) - sent_at[0], np.array(measured)


@pytest.mark.parametrize(("robot", "version"), [("ur5e", "5.11.1"), ("ur5", "3.15")])
@pytest.mark.parametrize("lag_s", [0.012, 0.020, 0.0333])
def test_the_fitted_shift_of_measured_speed_is_the_lag(robot, version, lag_s):
    sent, stamps, measured = streamed(robot, polyscope=version, lag_s=lag_s)

    def residual(shift):
        return np.sum((np.interp(stamps - shift, sent, speed(sent), left=0.0) - measured) ** 2)

    found = minimize_scalar(residual, bounds=(0.0, 0.1), method="bounded", options={"xatol": 1e-6}).x
    assert abs(found - lag_s) < FIT_WITHIN_S


def test_the_lag_is_a_delay_and_a_first_order_part():
    dt = 0.002
    lag_s = 0.020
    tau = 0.004
    lag = Lag(dt, lag_s, [tau], [0.0])
    speeds = [lag.step([dt / 2 + dt * k], [1.0])[1][0] for k in range(60)]
    delay = lag_s - dt - tau  # behind the end of the cycle in which the speed was commanded
    for k, found in enumerate(speeds):
        since = k * dt - delay
        # the command ramps up during the cycle before its end; a first-order answer to that ramp
        expected = 0.0 if since <= -dt else 1.0 - tau / dt * (math.exp(dt / tau) - 1.0) * math.exp(-(since + dt) / tau)
        assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("lag_s", [0.0, 0.002, 0.011, 0.020])
def test_position_is_the_integral_of_speed(lag_s):
    dt = 0.002
    lag = Lag(dt, lag_s, [0.002], [0.0])
    q = qd = 0.0
    before = (0.0, 0.0)
    after = (0.0, 0.0)
    sums = []
    for k in range(400):
        new = 1.0 - math.cos(0.02 * k)
        q = q + dt * (qd + new) / 2
        qd = new
        (x,), (v,) = lag.step([q], [qd])
        before = after
        after = (x, v)
        sums.append(after[0] - before[0] - dt * (after[1] + before[1]) / 2)
    assert max(map(abs, sums)) < 5e-7  # [rad] the trapezoidal rule's own error over one cycle


@pytest.mark.parametrize(("dt", "lag_s"), [(0.002, 0.020), (0.008, 0.020), (0.008, 0.0333)])
def test_between_cycles_the_motion_is_that_of_a_finer_lag(dt, lag_s):
    """The delay falls between two cycles of 125 Hz: there the true motion is still the filtered command, delayed."""
    fine = 16
    coarse = Lag(dt, lag_s, [0.002], [0.0])
    exact = Lag(dt / fine, lag_s - dt + dt / fine, [0.002], [0.0])
    q = 0.0
    qd = 0.0
    for k in range(60):
        new = math.sin(0.3 * k)
        q_of = [q + dt * s * qd + dt * s * s * (new - qd) / 2 for s in np.arange(1, fine + 1) / fine]
        found = [exact.step([x], [qd + (new - qd) * (i + 1) / fine]) for i, x in enumerate(q_of)]
        q = q_of[-1]
        qd = new
        coarse.step([q], [qd])
        for i, (x, v) in enumerate(found):
            (position,), (speed,) = coarse.before(dt * (1.0 - (i + 1) / fine))
            assert position == pytest.approx(x[0], abs=1e-9)
            assert speed == pytest.approx(v[0], abs=1e-9)


def test_the_leading_axis_ramps_and_the_others_keep_in_proportion():
    driven = Driven(make_cell())
    driven.write(SPEEDJ, [1.0, 0.5, 0.0, 0.0, 0.0, -0.25, 10.0, 0.002])
    driven.cycle(10)
    np.testing.assert_allclose(driven.arm.qd, [0.2, 0.1, 0, 0, 0, -0.05], atol=1e-12)
    driven.cycle(100)
    assert driven.arm.qd[0] == 1.0
    # 0.1 s up, then level: the area under the trapezoid
    assert driven.arm.q[0] == pytest.approx(0.5 * 0.1 + 1.0 * (110 * 0.002 - 0.1), abs=1e-12)


def test_speed_stop_decelerates_at_its_rate():
    driven = Driven(make_cell())
    driven.write(SPEEDJ, [1.0] * 6 + [40.0, 0.002])
    driven.cycle(50)
    assert driven.call(SPEED_STOP, [5.0]) * 0.002 == pytest.approx(1.0 / 5.0, abs=0.004)
    assert driven.arm.qd == [0.0] * 6


def test_noise_has_the_size_it_is_said_to_have():
    driven = Driven(make_cell())
    rows = []
    for _ in range(2000):
        driven.cycle()
        rows.append([*driven.arm.measured_q, *driven.arm.measured_qd])
    spread = np.std(rows, axis=0)
    np.testing.assert_allclose(spread[:6], 5e-6, rtol=0.15)
    np.testing.assert_allclose(spread[6:], 5e-4, rtol=0.15)
