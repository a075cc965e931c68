"""Lag, gain, first-order part and overshoot of every joint, from one recording, with standard errors.

Fractional-delay least squares of measured on commanded joint velocity: measured(t) = gain * u(t - lag), where u is the
command behind speedj's ramp and a first-order part, whose time constant counts towards the lag. The residual of an arm
is correlated over some cycles, so the standard errors are those of Newey and West (Econometrica 55, 1987).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from learning.arm_response import CommandedMotion, commanded_motion, leading_rates
from learning.recordings import JOINTS, MotionRecording, RecordingError
from planner.arrays import Array

LAG_MAX_S = 0.2  # [s] longest lag that is looked for; source: 0.18 s is the longest of learning configurations in use
LAG_STEP_S = 0.004  # [s] of the first scan: a tenth of the shortest ramp of a joint; the fit starts there
FIRST_ORDER_MAX_S = 0.03  # [s] longest first-order part that is looked for: it would halve a launch's peak
FIRST_ORDER_STEP_S = 0.003  # [s] of the scan; the fit is refined from the best
FIRST_ORDER_STD_S = 0.010  # [s] prior about none; source: the published servo loops of these arms are 0 to 10 ms
GAIN_STD = 0.05  # [-] prior about 1; source: a real UR5's peaks are 0.99 to 1.04 of the command
SENSOR_STD_RAD_S = 5e-4  # [rad/s] least scatter of a measured joint speed: a resolver's
MOVING_RAD_S = 0.05  # [rad/s] a joint whose command stays below tells nothing
CORRELATION_S = 0.05  # [s] over which residuals are correlated; source: 3 to 5 cycles of 8 ms on a real UR5
OVERSHOOT_S = 0.04  # [s] after a joint's peak, in which its overshoot is seen; source: the same recordings
SIGNIFICANT = 2.0  # [-] standard errors above which an overshoot is reported
ITERATIONS = 6  # of Gauss-Newton; three reach 1e-9 s
DIFFERENCE_S = 2e-4  # [s] of the first-order part's numerical derivative
RAMP_RANGE = 20.0  # [-] fastest command over the slowest ramp that is looked for
RAMP_FIRST_ORDERS_S = (0.0, 0.003, 0.006, 0.010)  # [s] tried beside each ramp, so that none passes for the other
RAMP_ITERATIONS = 3  # of the lag, for each of them
RAMP_STEPS = 12  # accelerations that are tried for an unknown ramp, evenly in their logarithm
RAMP_REFINEMENTS = 12  # of the golden section around the best of them: a thousandth
RAMP_EVIDENCE = 10.0  # [-] of the log likelihood, for a ramp that nobody announced: "very strong", Kass and Raftery
RAMP_DIFFERENCE = 0.1  # [-] of the ramp's logarithm, for the curvature of its likelihood
RAMP_STD_MAX = 0.3  # [-] of the same: where the likelihood is flat, a third of the ramp
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


@dataclass(frozen=True, eq=False)
class JointTiming:
    """Timing of one joint; `lag_s` and `overshoot` are None where the recording does not show them.

    Attributes:
        lag_s, lag_std_s: delay and first-order part together [s], and its standard error.
        first_order_s, first_order_std_s: time constant of the first-order part [s].
        gain, gain_std: measured over commanded velocity [-].
        overshoot, overshoot_std: mean excess after the peak, as a share of the peak [-].
    """

    lag_s: float | None
    lag_std_s: float | None
    first_order_s: float
    first_order_std_s: float
    gain: float
    gain_std: float
    overshoot: float | None = None
    overshoot_std: float | None = None


@dataclass(frozen=True, eq=False)
class TimingEstimate:
    """Timing of one recording.

    Attributes:
        lag_s, lag_std_s: of all joints together [s].
        joints: of each.
        ramp_rad_s2: acceleration of a ramp that the recording shows [rad/s^2]; None where none held the arm back.
        residual_rms_rad_s: of the moving joints [rad/s].
        rows: number of rows.
    """

    lag_s: float
    lag_std_s: float
    joints: tuple[JointTiming, ...]
    ramp_rad_s2: float | None
    residual_rms_rad_s: float
    rows: int

    def as_document(self) -> dict[str, Any]:
        """Returns the estimate as JSON: numbers of the joints as lists of six."""
        head = {"lag_s": self.lag_s, "lag_std_s": self.lag_std_s}
        names = ("gain", "gain_std", "first_order_s", "first_order_std_s", "overshoot", "overshoot_std")
        lists = {name: [getattr(joint, name) for joint in self.joints] for name in names}
        by_joint = {f"joint_{name}": [getattr(joint, name) for joint in self.joints] for name in ("lag_s", "lag_std_s")}
        tail = {"ramp_rad_s2": self.ramp_rad_s2, "residual_rms_rad_s": self.residual_rms_rad_s, "rows": self.rows}
        return {**head, **lists, **by_joint, **tail}


def estimate_timing(recording: MotionRecording, ramp_rad_s2: float | None = None) -> TimingEstimate:
    """Returns the timing of an arm in one recording.

    Args:
        recording: commanded and measured velocity.
        ramp_rad_s2: acceleration argument of the speedj commands [rad/s^2]; None: looked for.

    Raises:
        RecordingError: no joint moves, or none within the recording, or none changes its velocity.
    """
    moving = [j for j, most in enumerate(np.abs(recording.command).max(axis=0)) if most > MOVING_RAD_S]
    if not moving:
        raise RecordingError(f"no joint is commanded above {MOVING_RAD_S:g} rad/s")
    if not leading_rates(recording).max() > 0.0:
        raise RecordingError("no command changes: a lag shows where one does")
    ramp = _shown_ramp(recording) if ramp_rad_s2 is None else ramp_rad_s2
    fits = {j: fit for j, fit in _joint_fits(recording, ramp, moving).items() if np.abs(fit.predicted).max() > 0.0}
    if not fits:
        raise RecordingError("the recording ends before any joint follows its command")
    lag, std = _pooled_lag(fits)
    joints = [_joint_timing(fits[j], recording.time_s) if j in fits else _unmoved() for j in range(JOINTS)]
    rms = math.sqrt(float(np.mean([np.mean(fit.residual**2) for fit in fits.values()])))
    binding = ramp if leading_rates(recording).max() > ramp else None
    if binding is not None and ramp_rad_s2 is None:
        std = math.hypot(std, _lag_spread_by_ramp(recording, ramp, fits))
    return TimingEstimate(lag, std, tuple(joints), binding, rms, len(recording.time_s))


def weighted_mean(values: Sequence[float], stds: Sequence[float]) -> tuple[float, float]:
    """Returns the mean of values with standard errors, and its own; a spread beyond theirs widens it."""
    x = np.array(values)
    weights = 1.0 / np.maximum(np.array(stds), 1e-6) ** 2
    mean = float(weights @ x / weights.sum())
    spread = float(weights @ (x - mean) ** 2) / max(len(x) - 1, 1)
    return mean, math.sqrt(max(1.0, spread) / float(weights.sum()))


@dataclass(frozen=True, eq=False)
class _JointFit:
    """Fit of one joint: `theta` = (lag [s], first-order part [s], gain), standard errors, residual, prediction."""

    theta: Array
    std: Array
    residual: Array
    predicted: Array


def _joint_fits(recording: MotionRecording, ramp: float, moving: list[int]) -> dict[int, _JointFit]:
    """Returns the fits of the moving joints behind a ramp [rad/s^2]."""
    motion = commanded_motion(recording, ramp)
    start = _first_lag(motion, recording)
    return {j: _fit_joint(_column(motion, j), recording.time_s, recording.measured[:, j], start) for j in moving}


def _pooled_lag(fits: dict[int, _JointFit]) -> tuple[float, float]:
    return weighted_mean([fit.theta[0] for fit in fits.values()], [fit.std[0] for fit in fits.values()])


def _lag_spread_by_ramp(recording: MotionRecording, ramp: float, fits: dict[int, _JointFit]) -> float:
    """Returns the standard error of the lag [s] that comes from not knowing a ramp but by the recording.

    The ramp's own, of its logarithm, is that of the curvature of its likelihood; the lag is fitted again on both sides.
    """
    at = math.log(ramp)
    moving = list(fits)
    low, here, high = (_least_misfit(recording, math.exp(at + x)) for x in (-RAMP_DIFFERENCE, 0.0, RAMP_DIFFERENCE))
    independent = sum(_independent_rows(fit.residual, recording.time_s) for fit in fits.values())
    curvature = 0.5 * independent * (low + high - 2.0 * here) / (here * RAMP_DIFFERENCE**2)
    spread = min(1.0 / math.sqrt(max(curvature, 1e-12)), RAMP_STD_MAX)
    lags = [_pooled_lag(_joint_fits(recording, math.exp(at + x), moving))[0] for x in (-spread, spread)]
    return 0.5 * abs(lags[1] - lags[0])


def _independent_rows(residual: Array, times: Array) -> float:
    """Returns how many of a joint's residuals count as independent, by their autocorrelation (Bartlett's weights)."""
    span = max(1, round(CORRELATION_S / float(np.median(np.diff(times)))))
    power = float(residual @ residual)
    inflation = 1.0
    for k in range(1, min(span, len(residual) - 1)):
        inflation += 2.0 * (1.0 - k / span) * float(residual[k:] @ residual[:-k]) / power
    return len(residual) / max(inflation, 1.0)


def _fit_joint(motion: CommandedMotion, times: Array, measured: Array, lag_s: float) -> _JointFit:
    starts = np.arange(0.0, min(FIRST_ORDER_MAX_S, max(lag_s, 0.0)) + 1e-9, FIRST_ORDER_STEP_S)
    fits = [_gauss_newton(motion, times, measured, np.array([lag_s, tau, 1.0]), free_first_order=False)
            for tau in starts]  # fmt: skip
    best = min(fits, key=lambda fit: float(fit[1] @ fit[1]))[0]
    theta, residual, jacobian, predicted = _gauss_newton(motion, times, measured, best, free_first_order=True)
    std = np.sqrt(np.maximum(np.diag(_covariance(jacobian, residual, times)), 0.0))  # rounding makes it negative
    return _JointFit(theta, std, residual, predicted)


def _gauss_newton(
    motion: CommandedMotion, times: Array, measured: Array, theta: Array, free_first_order: bool
) -> tuple[Array, Array, Array, Array]:
    """Returns theta (3,), residual (k,), Jacobian (k, 3) and prediction (k,) of one joint."""
    prior = _prior_weights(SENSOR_STD_RAD_S)
    mean = np.array([0.0, 0.0, 1.0])
    shapes = partial(_shapes, motion, times)
    fixed = motion.filtered(theta[1])
    for _ in range(ITERATIONS):
        predicted, jacobian = shapes(theta, None if free_first_order else fixed)
        residual = measured - predicted
        if not free_first_order:
            jacobian = jacobian * np.array([1.0, 0.0, 1.0])
        normal = jacobian.T @ jacobian + np.diag(prior)
        normal[1, 1] += 0.0 if free_first_order else 1.0
        right = jacobian.T @ residual - prior * (theta - mean)
        step = np.linalg.lstsq(normal, right, rcond=None)[0]  # least norm: a lag that the data does not show stays
        theta = _within_bounds(theta + step)
        prior = _prior_weights(math.sqrt(float(np.mean(residual**2))))
    predicted, jacobian = shapes(theta, None if free_first_order else fixed)
    return theta, measured - predicted, jacobian, predicted


def _shapes(
    motion: CommandedMotion, times: Array, theta: Array, filtered: CommandedMotion | None
) -> tuple[Array, Array]:
    """Returns prediction (k,) and its derivatives (k, 3) by lag, first-order part and gain."""
    lag, tau, gain = theta
    behind = motion.filtered(tau) if filtered is None else filtered
    shape, rate = (x[:, 0] for x in behind.delayed(times, lag - tau))
    by_tau = np.zeros(len(times))
    if filtered is None:
        later = motion.filtered(tau + DIFFERENCE_S).delayed(times, lag - tau - DIFFERENCE_S)[0][:, 0]
        by_tau = gain * (later - shape) / DIFFERENCE_S
    return gain * shape, np.stack([-gain * rate, by_tau, shape], axis=1)


def _prior_weights(scatter: float) -> Array:
    """Returns the weights (3,) of the priors against residuals of this scatter [rad/s]: the residuals' own unit."""
    scatter = max(scatter, SENSOR_STD_RAD_S)
    return np.array([0.0, (scatter / FIRST_ORDER_STD_S) ** 2, (scatter / GAIN_STD) ** 2])


def _within_bounds(theta: Array) -> Array:
    lag = min(max(theta[0], 0.0), LAG_MAX_S)
    return np.array([lag, min(max(theta[1], 0.0), lag, FIRST_ORDER_MAX_S), theta[2]])


def _covariance(jacobian: Array, residual: Array, times: Array) -> Array:
    """Returns the covariance (3, 3) of a least-squares fit whose residuals are correlated in time."""
    scatter = math.sqrt(float(np.mean(residual**2)))
    bread = np.linalg.inv(jacobian.T @ jacobian + np.diag(np.maximum(_prior_weights(scatter), 1e-12)))
    scores = jacobian * residual[:, None]
    span = max(1, round(CORRELATION_S / float(np.median(np.diff(times)))))
    meat = scores.T @ scores
    for k in range(1, min(span, len(scores) - 1)):
        product = scores[k:].T @ scores[:-k]
        meat = meat + (1.0 - k / span) * (product + product.T)
    prior = np.diag(_prior_weights(scatter)) * scatter**2
    return bread @ (meat + prior) @ bread


def _joint_timing(fit: _JointFit, times: Array) -> JointTiming:
    lag, tau, gain = (float(x) for x in fit.theta)
    std = [float(x) for x in fit.std]
    timing = JointTiming(lag, std[0], tau, std[1], gain, std[2])
    peak = int(np.argmax(np.abs(fit.predicted)))
    after = (times > times[peak]) & (times <= times[peak] + OVERSHOOT_S)
    if after.sum() < 2:
        return timing
    excess = float(np.mean(fit.residual[after])) / float(fit.predicted[peak])
    scatter = _scatter_of_means(fit.residual, int(after.sum())) / abs(float(fit.predicted[peak]))
    return replace(timing, overshoot=excess, overshoot_std=scatter) if excess > SIGNIFICANT * scatter else timing


def _scatter_of_means(residual: Array, length: int) -> float:
    """Returns the standard deviation of a mean over `length` neighbouring residuals [rad/s]."""
    means = np.convolve(residual, np.full(length, 1.0 / length), mode="valid")
    return max(float(np.std(means)), SENSOR_STD_RAD_S / math.sqrt(length))


def _unmoved() -> JointTiming:
    return JointTiming(None, None, 0.0, FIRST_ORDER_STD_S, 1.0, GAIN_STD)


def _first_lag(motion: CommandedMotion, recording: MotionRecording) -> float:
    """Returns the best lag of a scan, without a first-order part [s]."""
    lags = np.arange(0.0, LAG_MAX_S, LAG_STEP_S)
    return float(lags[np.argmin([_misfit(motion, recording, lag)[0] for lag in lags])])


def _misfit(motion: CommandedMotion, recording: MotionRecording, lag_s: float) -> tuple[float, float]:
    """Returns the sum of squared residuals at a lag, and the step to a better lag [s].

    Each joint has its best gain, within the prior's reach.
    """
    shape, rate = motion.delayed(recording.time_s, lag_s)
    weight = (SENSOR_STD_RAD_S / GAIN_STD) ** 2
    gain = ((shape * recording.measured).sum(axis=0) + weight) / ((shape * shape).sum(axis=0) + weight)
    gain = np.clip(gain, 1.0 - 3.0 * GAIN_STD, 1.0 + 3.0 * GAIN_STD)
    residual = recording.measured - gain * shape
    slope = gain * rate
    return float(np.sum(residual**2)), -float(np.sum(residual * slope) / max(np.sum(slope**2), 1e-12))


def _shown_ramp(recording: MotionRecording) -> float:
    """Returns the acceleration of the ramp that the recording shows [rad/s^2]; infinite where it shows none.

    A ramp that never held the arm back cannot be seen. One that is slower than the commands is looked for by its
    likelihood, in which the residuals count as often as they are independent.
    """
    fastest = float(leading_rates(recording).max())
    tried = np.linspace(math.log(fastest / RAMP_RANGE), math.log(fastest), RAMP_STEPS, endpoint=False)

    def error(log_acceleration: float) -> float:
        return _least_misfit(recording, math.exp(log_acceleration))

    best = int(np.argmin([error(x) for x in tried]))
    step = tried[1] - tried[0]
    found, least = _golden_section(error, tried[best] - step, tried[best] + step)
    independent = JOINTS * max(1.0, (recording.time_s[-1] - recording.time_s[0]) / CORRELATION_S)
    evidence = 0.5 * independent * math.log(_least_misfit(recording, math.inf) / max(least, 1e-300))
    return math.exp(found) if evidence > RAMP_EVIDENCE else math.inf


def _least_misfit(recording: MotionRecording, acceleration: float) -> float:
    """Returns the least sum of squared residuals over lag and first-order part, behind a ramp."""
    motion = commanded_motion(recording, acceleration)
    start = _first_lag(motion, recording)
    errors = []
    for tau in RAMP_FIRST_ORDERS_S:
        behind = motion.filtered(tau)
        delay = max(start - tau, 0.0)
        for _ in range(RAMP_ITERATIONS):
            error, step = _misfit(behind, recording, delay)
            delay = min(max(delay + step, 0.0), LAG_MAX_S)
            errors.append(error)
    return min(errors)


def _golden_section(function: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Returns the place and the value of a function's least value between `low` and `high`."""
    a = high - GOLDEN * (high - low)
    b = low + GOLDEN * (high - low)
    fa = function(a)
    fb = function(b)
    for _ in range(RAMP_REFINEMENTS):
        if fa < fb:
            high = b
            b = a
            fb = fa
            a = high - GOLDEN * (high - low)
            fa = function(a)
        else:
            low = a
            a = b
            fa = fb
            b = low + GOLDEN * (high - low)
            fb = function(b)
    return (a, fa) if fa < fb else (b, fb)


def _column(motion: CommandedMotion, joint: int) -> CommandedMotion:
    return replace(motion, velocity=motion.velocity[:, joint : joint + 1])
