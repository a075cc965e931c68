"""The response of an arm with a truth of its own, against closed forms; and the arm as measured on a real UR5."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from simulator.physics.lag import Lag
from simulator.physics.overshoot import NO_SCATTER, RECOVERY_S, Overshoot
from simulator.truth import ArmDeviation, MotionTiming, Truth, truth_of
from tests.simulator.conftest import Driven, make_cell

SPEEDJ = 9
SENSOR_RAD_S = 5e-4  # [rad/s] standard deviation of a measured speed
PARTS_S = (0.0, 0.001, 0.002, 0.004, 0.006, 0.008)  # [s] first-order parts


def true_arm(robot: str = "ur5e", timing: dict[str, Any] | None = None, **arm: Any) -> Driven:
    """Returns an arm whose truth differs from its cell in some keys."""
    cell = make_cell(robot)
    truth: Truth = truth_of(cell)
    timing_s: MotionTiming = replace(truth.timing, **(timing or {}))
    return Driven(cell, truth=replace(truth, timing=timing_s, arm=ArmDeviation(**arm), seed=3))


def stream(driven: Driven, speed: Callable[[float], Any], duration_s: float) -> tuple[np.ndarray, ...]:
    """Streams joint speeds; returns times since the start, and true and measured speeds at them."""
    dt = driven.controller.timeline.dt
    start = driven.controller.timeline.t
    rows = []
    while (t := driven.controller.timeline.t - start) < duration_s:
        driven.write(SPEEDJ, [*speed(t), 40.0, dt])
        driven.cycle()
        rows.append([driven.controller.timeline.t - start, *driven.arm.true_qd, *driven.arm.measured_qd])
    assert not driven.controller.safety.stopped
    table = np.array(rows)
    return table[:, 0], table[:, 1:7], table[:, 7:]


def test_first_order_parts_a_joint_add_up_to_the_same_lag() -> None:
    """After a ramp that lasts, every first-order part is the ramp one lag earlier, whatever its time constant."""
    dt = 0.002
    lag_s = 0.030
    rate = 5.0
    lag = Lag(dt, lag_s, PARTS_S, [0.0] * 6)
    for k in range(1, 101):
        t = k * dt
        _, speeds = lag.step([0.5 * rate * t * t] * 6, [rate * t] * 6)
    np.testing.assert_allclose(speeds, rate * (t - (lag_s - dt)), atol=1e-4)


def test_a_first_order_part_answers_a_ramp_as_its_differential_equation_does() -> None:
    dt = 0.002
    lag_s = 0.030
    rate = 5.0
    lag = Lag(dt, lag_s, PARTS_S, [0.0] * 6)
    for k in range(1, 31):
        t = k * dt
        _, speeds = lag.step([0.5 * rate * t * t] * 6, [rate * t] * 6)
        for tau, found in zip(PARTS_S, speeds, strict=True):
            since = t - (lag_s - dt - tau)
            answer = since - tau + tau * math.exp(-since / tau) if tau else since
            assert found == pytest.approx(rate * answer if since > 0.0 else 0.0, abs=1e-9)


def test_the_gain_multiplies_the_speed_and_the_arm_stands_where_it_believes() -> None:
    gain = (1.04, 0.96, 1.02, 1.0, 0.98, 1.01)
    driven = true_arm(timing={"gain": gain})
    rest = list(driven.arm.q)
    t, true_qd, _ = stream(driven, lambda t: [0.5 * math.sin(math.pi * min(t, 1.0)) ** 2] * 6, 1.3)
    sent = 0.5 * np.sin(np.pi * np.clip(t - 0.020, 0.0, 1.0)) ** 2
    np.testing.assert_allclose(true_qd, np.outer(sent, gain), atol=2e-3)
    moved = np.array(driven.arm.true_q) - rest
    np.testing.assert_allclose(moved, 0.25 * np.array(gain), atol=1e-4)  # the integral of 0.5 sin^2 over a second
    np.testing.assert_allclose(driven.arm.true_q, driven.arm.q, atol=1e-9)


def test_overshoot_exceeds_a_step_by_its_share_and_dies_away() -> None:
    """The answer to a step that begins between two cycles; the commanded speed is linear over that first cycle."""
    dt = 0.002
    overshoot = [0.05, 0.1, 0.0, 0.02, 0.2, 0.01]
    ahead = Overshoot(dt, overshoot, NO_SCATTER, "seed")
    q = 0.0
    position = [0.0] * 6
    for k in range(400):
        q += dt * (0.5 if k == 0 else 1.0)
        position, speeds = ahead.step([q] * 6, [1.0] * 6)
        since = (k + 0.5) * dt
        np.testing.assert_allclose(speeds, 1.0 + np.array(overshoot) * math.exp(-since / RECOVERY_S), atol=1e-5)
    lead = np.array(overshoot) * RECOVERY_S * (1.0 - math.exp(-since / RECOVERY_S))
    np.testing.assert_allclose(np.array(position) - q, lead, atol=1e-5)


def test_overshoot_of_a_ramp_and_the_way_back_to_the_commanded_position() -> None:
    overshoot = 0.1
    length_s = 0.25
    driven = true_arm(timing={"first_order_s": (0.0,) * 6}, overshoot=(overshoot,) * 6)
    _, true_qd, _ = stream(driven, lambda t: [max(0.0, min(t, 0.5 - t)) * 4.0] * 6, 2.0)
    ahead = overshoot * RECOVERY_S / length_s * (1.0 - math.exp(-length_s / RECOVERY_S))
    assert np.max(true_qd) == pytest.approx(1.0 + ahead, abs=1e-4)
    assert driven.arm.true_q == pytest.approx(driven.arm.q, abs=1e-5)
    np.testing.assert_allclose(true_qd[-1], 0.0, atol=1e-4)


def test_scatter_is_drawn_anew_in_every_run_and_repeated_by_the_seed() -> None:
    def runs() -> list[np.ndarray]:
        driven = true_arm("ur5", disturbance="ur5-measured")
        return [stream(driven, lambda t: [math.sin(3.0 * t)] * 6, 2.0)[1] for _ in range(2)]

    first, second = runs()
    again, _ = runs()
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - second).max() > 0.01


def replay(throws: int) -> dict[str, np.ndarray]:
    """Replays throws at 125 Hz and compares measured speeds with the best pure delay of the commanded ones.

    The throws: six joints speed up to 0.4 to 2 rad/s within 0.2 to 0.4 s, and brake within the same.
    """
    driven = true_arm("ur5", timing={"lag_s": 0.020}, disturbance="ur5-measured")
    rng = np.random.default_rng(1)
    found: dict[str, list[Any]] = {"ratio": [], "after_peak": [], "moving": [], "release": [], "lag_s": []}
    peak = np.zeros(6)
    rise_s = 0.0
    fall_s = 0.0
    for number in range(throws):
        if number % 2 == 0:
            rise_s, fall_s = rng.uniform(0.2, 0.4, 2)
            peak = rng.uniform(0.4, 2.0, 6) * rng.choice([-1.0, 1.0], 6) * [1.0, 1.0, 1.0, 0.7, 0.7, 0.7]
        else:
            peak = -peak  # and back

        def shape(t: Any, rise_s: float = rise_s, fall_s: float = fall_s) -> Any:
            s = np.clip(np.minimum(t / rise_s, 1.0 - (t - rise_s) / fall_s), 0.0, 1.0)
            return s * s * (3.0 - 2.0 * s)

        t, _, measured = stream(driven, lambda t, peak=peak, shape=shape: peak * shape(t), rise_s + fall_s + 0.8)
        fits = [(lag, np.outer(shape(t - lag), peak)) for lag in np.arange(0.017, 0.0235, 0.00025)]
        lag_s, model = min(fits, key=lambda fit: float(((fit[1] - measured) ** 2).sum()))
        residual = measured - model
        after = round((rise_s + 0.024) / 0.008)  # three to five cycles after the commanded peak
        found["lag_s"].append(lag_s)
        found["ratio"].append(np.abs(measured[:, :3]).max(axis=0) / np.abs(peak[:3]))
        found["after_peak"].append(np.sign(peak[:3]) * residual[after - 1 : after + 2, :3])
        found["moving"].append(residual[np.abs(model).max(axis=1) > 0.02])
        at = int(np.argmax(np.abs(model).max(axis=1)))
        found["release"].append([np.linalg.norm(residual[at]) / np.linalg.norm(model[at])])
    return {name: np.concatenate([np.ravel(x) for x in values]) for name, values in found.items()}


def test_the_arm_as_measured_moves_as_the_real_ur5_did() -> None:
    """Figures of 211 recorded throws; the tolerances are what other throws and 80 of them leave open."""
    found = replay(80)
    assert np.median(found["ratio"]) == pytest.approx(1.023, abs=0.004)
    assert np.quantile(found["ratio"], 0.95) == pytest.approx(1.039, abs=0.006)
    assert np.sqrt(np.mean(found["after_peak"] ** 2)) == pytest.approx(0.027, abs=0.005)
    assert 0.010 <= np.mean(found["after_peak"]) <= 0.018
    assert np.sqrt(np.mean(found["moving"] ** 2)) == pytest.approx(0.0140, abs=0.002)
    assert np.median(found["release"]) == pytest.approx(0.017, abs=0.004)
    assert np.mean(found["lag_s"]) == pytest.approx(0.020, abs=0.0005)
    assert np.std(found["lag_s"]) == pytest.approx(0.00035, abs=0.00015)
