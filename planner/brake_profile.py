"""Shape of every brake: the acceleration fades out while a trapezoid of deceleration takes the speed away.

From a state (q, qd, qdd), over the duration T, with u = s / T and ramps of the share r of the duration:

    qdd(s) = qdd A(u) - (qd / T + qdd r / 2) H(u) / (1 - r)

A falls from 1 to 0 over the first ramp; H rises from 0 to 1 over it, stays, and falls to 0 over the last. So the
acceleration is continuous, its peak follows from qd and qdd, and the arm is at rest at T. The peak is 1.14 |qd| / T,
that of a cubic polynomial of the speed 1.5 |qd| / T. Position and speed are the integrals.

`planner.approach.brakes` chooses T and verifies the brake; the streaming process flies it. No numpy: that process
imports none.
"""

from __future__ import annotations

RAMP = 0.125  # [-] r: 10 ms at 3 rad/s and 40 rad/s^2; a multiple of the spacing at which brakes are verified
Weights = tuple[float, float, float, float, float, float]


def brake_weights(u: float) -> Weights:
    """Returns the weights of the initial state at the share `u` of the duration.

    Six numbers: of qd T and qdd T^2 in the position (added to q), of qd and qdd T in the speed, and of qd / T and qdd
    in the acceleration.
    """
    u = min(max(u, 0.0), 1.0)
    r = RAMP
    fade, fade1, fade2 = _fading(u)
    trapezoid, trapezoid1, trapezoid2 = _trapezoid(u)
    weight = 1.0 / (1.0 - r)
    share = 0.5 * r / (1.0 - r)
    return (
        u - weight * trapezoid2,
        fade2 - share * trapezoid2,
        1.0 - weight * trapezoid1,
        fade1 - share * trapezoid1,
        -weight * trapezoid,
        fade - share * trapezoid,
    )


def _fading(u: float) -> tuple[float, float, float]:
    """Returns A and its first and second integrals."""
    r = RAMP
    if u >= r:
        return 0.0, 0.5 * r, r * r / 3.0 + 0.5 * r * (u - r)
    return 1.0 - u / r, u - 0.5 * u * u / r, 0.5 * u * u - u**3 / (6.0 * r)


def _trapezoid(u: float) -> tuple[float, float, float]:
    """Returns H and its first and second integrals."""
    r = RAMP
    if u < r:
        return u / r, 0.5 * u * u / r, u**3 / (6.0 * r)
    if u <= 1.0 - r:
        return 1.0, u - 0.5 * r, 0.5 * u * u - 0.5 * r * u + r * r / 6.0
    left = 1.0 - u
    return left / r, 1.0 - r - 0.5 * left * left / r, (1.0 - r) * (u - 0.5) + left**3 / (6.0 * r)
