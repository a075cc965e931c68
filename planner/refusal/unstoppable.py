"""Refusal of a start in motion that a joint cannot leave within its limits: closed forms, so that they are proofs.

The acceleration at the start takes |a| / j to fade, in which the velocity changes by a^2 / 2j. A joint goes least far
where it brakes with full jerk to its full acceleration, and with that until it turns.
"""

from __future__ import annotations

import math

from planner.errors import Violation
from planner.problem import ThrowProblem

SLACK = 1e-6  # [rad, rad/s] beyond the certificate's tolerances


def unstoppable(problem: ThrowProblem) -> list[Violation]:
    """Returns the limits on position and velocity that a joint breaks after the start, whatever the motion."""
    if problem.starts_at_rest:
        return []
    return [violation for joint in range(6) for violation in _of_joint(problem, joint)]


def _of_joint(problem: ThrowProblem, joint: int) -> list[Violation]:
    limits = problem.limits
    q, qd, qdd = (float(x[joint]) for x in problem.start_state)
    a_max = float(limits.qdd_max[joint])
    jerk = float(limits.jerk_max[joint])
    name = problem.cell.robot.joint_names[joint]
    found = []
    fastest = abs(qd + qdd * abs(qdd) / (2.0 * jerk))
    most = float(limits.qd_max[joint])
    if qd * qdd > 0.0 and fastest > most + SLACK:
        detail = f"{name} after the start, until its acceleration has faded"
        found.append(Violation("joint_velocity", fastest, most, "rad/s", 0.0, detail))
    reachable = problem.reachable
    for side, bound in ((1.0, reachable.q_upper[joint]), (-1.0, reachable.q_lower[joint])):
        turns_at = q + side * _overshoot(side * qd, side * qdd, a_max, jerk)
        if side * (turns_at - bound) > SLACK:
            detail = f"{name} after the start: it cannot stop before"
            found.append(Violation("joint_position", turns_at, float(bound), "rad", 0.0, detail))
    return found


def _overshoot(v: float, a: float, a_max: float, jerk: float) -> float:
    """Returns how far a joint goes on at least [rad] until it turns; 0 where it does not go on."""
    square = a * a + 2.0 * jerk * v
    if square < 0.0:
        return 0.0
    turns_s = (a + math.sqrt(square)) / jerk
    t = min(turns_s, (a + a_max) / jerk)
    if t <= 0.0:
        return 0.0
    way = t * (v + t * (a / 2.0 - t * jerk / 6.0))
    left = v + t * (a - t * jerk / 2.0) if turns_s > t else 0.0
    return max(0.0, way + left * left / (2.0 * a_max))
