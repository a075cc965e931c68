"""Checks of stopping time and stopping distance from every state of the motion, by a model of the stop.

How the controller estimates its stop is not published. Here a stop slows all joints down together, in proportion, so
that the arm stays on its path, at a constant rate, as fast as the rated joint torques allow in the posture where it
begins: qd(s) = (1 - s/T) qd needs the torques h - b/T with h, those of gravity and velocity, and b = M qd. So T is the
least time for which |h - b/T| <= tau in every joint, and a point at speed v travels v T/2. Both are multiplied so that
no stop that Universal Robots has published for an arm of known masses is longer: see `MEASURED_TIME`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from planner.arrays import Array
from planner.certificate.bounds import Proof, curvature_bound, point_bound
from planner.certificate.certificate import ROUNDING
from planner.certificate.loads import watched_levers
from planner.certificate.samples import ArmSamples, MotionSamples

# [-] largest ratio of a measured stop to the model's: time 1.84 (UR3, base), distance 1.30 (UR3 and UR5, base)
# source: user manuals of UR3 and UR5 (CB3), appendix "Stopping time and stopping distance": stop category 0 of base,
# shoulder and elbow from 183 deg/s, stretched out, with the largest payload; compared in the tests
MEASURED_TIME = 1.85
MEASURED_DISTANCE = 1.31
Worst = tuple[float, float, bool]  # the most found, or a bound on it; its time [s]; whether the limit is proven
MORE_SHARES = (0.002, 0.01, 0.05, 0.2)  # [-] of the limit, beyond the worst stop found, that are tried for a bound


def worst_stopping_time(motion: MotionSamples, limit_s: float) -> Worst:
    """Returns the longest time that a stop takes from any state of the motion, against a limit."""

    def prove(longest_s: float) -> Proof:
        rate = MEASURED_TIME / longest_s
        bending = rate * motion.load_bounds.joint_momentum[2]
        return _prove(motion, lambda arm: np.full(len(arm.t), rate), bending)

    return _worst(motion, lambda arm: stopping_times(motion, arm), prove, limit_s)


def worst_stopping_distance(motion: MotionSamples, limit_m: float) -> Worst:
    """Returns how far tool centre point, flange and elbow travel in a stop from any state, against a limit.

    v T/2 <= D where braking in T = 2 D / v needs no more than the rated torques. Between two instants s apart the speed
    v is at most c s^2/8 above its chord, c = sup |p'''|; |h - b v / (2 D)|, convex in v, exceeds its values there by at
    most (|h''| + (2 A |b'| + V |b''| + c |b|) / (2 D)) s^2/8, with V and A bounds on the points' speed and
    acceleration. What it needs at v = 0, the torque |h|, must be there too.
    """
    b, b1, b2 = motion.load_bounds.joint_momentum
    v, a, c = _point_bounds(motion)
    v = v + c * np.diff(motion.at_knots.t) ** 2 / 8.0

    def prove(farthest_m: float) -> Proof:
        half = 0.5 * MEASURED_DISTANCE / farthest_m
        return _prove(motion, lambda arm: half * arm.watched_speed, half * (2.0 * a * b1 + v * b2 + c * b))

    return _worst(motion, lambda arm: stopping_distances(motion, arm), prove, limit_m)


def stopping_times(motion: MotionSamples, arm: ArmSamples) -> Array:
    """Returns the times (k,) [s] that stops take; infinite where the rated torques do not hold the arm up."""
    return MEASURED_TIME * _times(motion, arm)


def stopping_distances(motion: MotionSamples, arm: ArmSamples) -> Array:
    """Returns how far (k,) [m] the fastest of tool centre point, flange and elbow travels in stops."""
    v = arm.watched_speed
    times = _times(motion, arm)
    return 0.5 * MEASURED_DISTANCE * v * np.where(v > 0.0, times, 0.0)


def _point_bounds(motion: MotionSamples) -> tuple[Array, Array, Array]:
    """Returns bounds (m,) on the first three derivatives of the watched points between the knots."""
    lever = np.max(watched_levers(motion.problem.cell), axis=0)
    first, second, third = (point_bound(lever, motion.rates, derivative) for derivative in (1, 2, 3))
    return first, second, third


def _prove(motion: MotionSamples, inverse_time: Callable[[ArmSamples], Array], bending: Array) -> Proof:
    """Returns the proof that no joint exceeds its rated torque while braking in the time given; of the share left.

    Args:
        motion: the motion.
        inverse_time: function of the arm that returns 1/T (k,) [1/s].
        bending: bounds on the second derivative of b/T between the knots (6, m) [N m/s^2].
    """
    tau = motion.problem.cell.robot.tau_max[:, None]

    def room(arm: ArmSamples) -> Array:
        inverse = inverse_time(arm)

        def share(h: Array, b: Array) -> Array:
            return np.maximum(np.abs(h), np.abs(h - b * inverse)) / tau

        held, empty = _braking_terms(arm)
        return 1.0 - motion.worse_of(arm.t, share(*held), share(*empty))

    rates = (motion.load_bounds.torque + bending) / tau
    return motion.prove(room, rates, -ROUNDING, curvature_bound, math.inf)


@lru_cache(maxsize=2)
def _braking_terms(arm: ArmSamples) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Returns h [N m] and b [N m s] (6, k) of the joints, with the object and without it."""
    loaded = arm.loaded_torques
    return (loaded.held, loaded.momentum), (arm.torques.held[0], arm.torques.momentum[0])


@lru_cache(maxsize=2)  # of the knots, for time and distance
def _times(motion: MotionSamples, arm: ArmSamples) -> Array:
    """Returns the model's stopping times (k,) [s]; infinite where the rated torques do not hold the arm up."""
    held, empty = (_least_time(*terms, arm.cell.robot.tau_max[:, None]) for terms in _braking_terms(arm))
    return motion.worse_of(arm.t, held, empty)


def _least_time(h: Array, b: Array, tau: Array) -> Array:
    """Returns the least T (k,) [s] for which |h - b/T| <= tau in every joint (6, k)."""
    spare = tau + np.where(b < 0.0, -h, h)
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.where(np.abs(h) > tau, np.inf, np.where(b == 0.0, 0.0, np.abs(b) / np.maximum(spare, 0.0)))
    return times.max(axis=0)


def _worst(
    motion: MotionSamples, value: Callable[[ArmSamples], Array], prove: Callable[[float], Proof], limit: float
) -> Worst:
    """Returns the most that a stop takes, against `limit`.

    Args:
        motion: the motion.
        value: function of the arm that returns what stops take (k,).
        prove: function of a limit that returns the proof of it.
        limit: the limit.
    """
    proof = prove(limit)
    worst, at_s = _worst_found(motion, value, proof)
    if proof.proven and motion.is_told:
        tried = (worst + share * limit for share in MORE_SHARES)
        worst = next((more for more in tried if more < limit and prove(more).proven), limit)
    return worst, at_s, proof.proven


def _worst_found(motion: MotionSamples, value: Callable[[ArmSamples], Array], proof: Proof) -> tuple[float, float]:
    """Returns the largest value at the knots and where the proof found least room, and its time [s]."""
    arms = [motion.at_knots]
    if not np.any(motion.at_knots.t == proof.at_s):
        arms.append(motion.at(np.array([proof.at_s])))
    t = np.concatenate([arm.t for arm in arms])
    values = np.concatenate([value(arm) for arm in arms])
    worst = int(values.argmax())
    return float(values[worst]), float(t[worst])
