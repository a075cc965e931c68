"""Per-joint lower bound on the launch time; ranks candidates.

Source: time-optimal control of a double integrator with bounded acceleration and velocity (Pontryagin; e.g. Biagiotti
and Melchiorri, Trajectory Planning for Automatic Machines and Robots, Springer 2008, section 3.2).
"""

from __future__ import annotations

import numpy as np

from planner.arrays import Array
from planner.cell import Limits


def least_time(distance: Array, qd: Array, limits: Limits) -> Array:
    """Returns a lower bound (...,) [s] on the time from rest over `distance` to the velocity `qd`.

    The maximum over the joints of each joint's own least time with unbounded jerk.

    Args:
        distance: joint distances (..., n) [rad].
        qd: joint velocities (..., n) at the end [rad/s].
        limits: of velocity and acceleration.
    """
    v_max, a_max = limits.qd_max, limits.qdd_max
    turn = np.where(distance >= qd * np.abs(qd) / (2.0 * a_max), 1.0, -1.0)
    d, v = turn * distance, turn * qd
    peak = np.sqrt(np.maximum(a_max * d + v**2 / 2.0, 0.0))
    direct = (2.0 * peak - v) / a_max
    accelerating = (2.0 * v_max**2 - v**2) / (2.0 * a_max)
    cruising = (2.0 * v_max - v) / a_max + (d - accelerating) / v_max
    return np.where(peak <= v_max, direct, cruising).max(axis=-1)
