"""Shape of every brake: the acceleration fades out while a trapezoid of deceleration takes the speed away.

From a state (q, qd, qdd), over the duration T, with u = s / T and ramps of the share r of the duration:

    qdd(s) = qdd A(u) - (qd / T + qdd r / 2) H(u) (1 + k (1 - 2 u)) / (1 - r)

A falls from 1 to 0 over the first ramp; H rises from 0 to 1 over it, stays, and falls to 0 over the last. So the
acceleration is continuous, its peak follows from qd and qdd, and the arm is at rest at T. A launch stretches the arm,
and the torque of one deceleration grows along the brake: the slope k takes more of the speed early, and as much in all.
The peak is 1.31 |qd| / T, that of a cubic polynomial of the speed 1.5 |qd| / T. Position and speed are the integrals.

`planner.approach.brakes` chooses T and verifies the brake; the streaming process flies it. No numpy: that process
imports none.
"""

from __future__ import annotations

RAMP = 0.125  # [-] r: 10 ms at 3 rad/s and 40 rad/s^2; a multiple of the spacing at which brakes are verified
SLOPE = 0.2  # [-] k: the deceleration falls by a third; at the same torques a brake is a tenth shorter
Weights = tuple[float, float, float, float, float, float]


def brake_weights(u: float) -> Weights:
    """Returns the weights of the initial state at the share `u` of the duration.

    Six numbers: of qd T and qdd T^2 in the position (added to q), of qd and qdd T in the speed, and of qd / T and qdd
    in the acceleration.
    """
    u = min(max(u, 0.0), 1.0)
    r = RAMP
    fade, fade1, fade2 = _fading(u)
    slowing, slowing1, slowing2 = _deceleration(u)
    weight = 1.0 / (1.0 - r)
    share = 0.5 * r / (1.0 - r)
    return (
        u - weight * slowing2,
        fade2 - share * slowing2,
        1.0 - weight * slowing1,
        fade1 - share * slowing1,
        -weight * slowing,
        fade - share * slowing,
    )


def _fading(u: float) -> tuple[float, float, float]:
    """Returns A and its first and second integrals."""
    r = RAMP
    if u >= r:
        return 0.0, 0.5 * r, r * r / 3.0 + 0.5 * r * (u - r)
    return 1.0 - u / r, u - 0.5 * u * u / r, 0.5 * u * u - u**3 / (6.0 * r)


def _deceleration(u: float) -> tuple[float, float, float]:
    """Returns H (1 + k (1 - 2 u)) and its first and second integrals."""
    h, h1, h2 = _trapezoid(u)
    tilt1, tilt2 = _tilt_integrals(min(u, 1.0 - u))
    if u > 0.5:  # H (1 - 2 u) is odd about the middle
        tilt2 = 2.0 * _tilt_integrals(0.5)[1] - tilt2
    return h * (1.0 + SLOPE * (1.0 - 2.0 * u)), h1 + SLOPE * tilt1, h2 + SLOPE * tilt2


def _tilt_integrals(u: float) -> tuple[float, float]:
    """Returns the first and the second integral of H (1 - 2 u), up to u = 1/2."""
    r = RAMP
    if u < r:
        return u * u / (2.0 * r) - 2.0 * u**3 / (3.0 * r), u**3 / (6.0 * r) - u**4 / (6.0 * r)
    first = r / 2.0 - 2.0 * r * r / 3.0
    along = u - r
    ramped = r * r / 6.0 - r**3 / 6.0
    return first + u - u * u - (r - r * r), ramped + (first - r + r * r) * along + (u * u - r * r) / 2.0 - (
        u**3 - r**3
    ) / 3.0


def _trapezoid(u: float) -> tuple[float, float, float]:
    """Returns H and its first and second integrals."""
    r = RAMP
    if u < r:
        return u / r, 0.5 * u * u / r, u**3 / (6.0 * r)
    if u <= 1.0 - r:
        return 1.0, u - 0.5 * r, 0.5 * u * u - 0.5 * r * u + r * r / 6.0
    left = 1.0 - u
    return left / r, 1.0 - r - 0.5 * left * left / r, (1.0 - r) * (u - 0.5) + left**3 / (6.0 * r)
