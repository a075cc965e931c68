"""The room that each joint needs to come to its velocity at the release, and to lose it again.

A joint at velocity v last stood still v^2 / (2 a) before, and stands still again as far behind at the soonest, where a
is its acceleration limit: with a limit on jerk, and with other joints to wait for, it is farther. A release state of
which a joint would stand still beyond its limits, or beyond what self-collision blocks, has no motion through it.
"""

from __future__ import annotations

import numpy as np

from planner.arrays import Array
from planner.errors import Violation
from planner.geometry import barriers
from planner.problem import ThrowProblem

# [rad] by which a joint may turn too far: the certificate takes a release a ten-thousandth of a radian per second too
# slow, next to a singularity some joint by twenty times as much. Far more than the last bits of the limits.
SLACK_RAD = 1e-3


def lack_of_room(problem: ThrowProblem, q: Array, qd: Array) -> Array:
    """Returns how far each joint turns beyond what is reachable (n, 6), at least [rad]; negative where it need not.

    Args:
        problem: its start, limits and cell.
        q: positions (n, 6) at the release [rad].
        qd: velocities (n, 6) [rad/s].
    """
    stands = _standstills(problem, q, qd)
    reachable = problem.reachable
    return np.asarray(np.maximum(reachable.q_lower - stands.min(axis=0), stands.max(axis=0) - reachable.q_upper))


def no_room(problem: ThrowProblem, q: Array, qd: Array) -> Violation:
    """Returns the joint position that rules out the states q, qd (n, 6): of the one that lacks least room."""
    lack = lack_of_room(problem, q, qd)
    best = int(lack.max(axis=1).argmin())
    joint = int(lack[best].argmax())
    run_up, stop = _standstills(problem, q[best], qd[best])[:, joint].tolist()
    reachable, limits = problem.reachable, problem.limits
    lower, upper = float(reachable.q_lower[joint]), float(reachable.q_upper[joint])
    is_below = lower - min(run_up, stop) == lack[best, joint]
    position, limit = (min(run_up, stop), lower) if is_below else (max(run_up, stop), upper)
    begins = position == run_up
    speed, name = float(abs(qd[best, joint])), problem.cell.robot.joint_names[joint]
    what = "begin to accelerate" if begins else "come to a stop"
    detail = f"{name} at {speed:.2f} rad/s at the release would have to {what} there"
    if limit not in (limits.q_lower[joint], limits.q_upper[joint]):
        detail += f", and {' and '.join(_names_at(problem, joint, limit))} collide before"
    return Violation("joint_position", position, limit, "rad", detail=detail)


def _standstills(problem: ThrowProblem, q: Array, qd: Array) -> Array:
    """Returns where each joint stood still last before the release, and where it does next (2, ..., 6) [rad]."""
    turned = 0.5 * qd * np.abs(qd) / problem.limits.qdd_max
    return np.stack([q - turned, q + turned])


def _names_at(problem: ThrowProblem, joint: int, position: float) -> tuple[str, str]:
    """Returns the two capsules that collide from a joint position on."""
    of_joint = [each for each in barriers(problem.cell.robot, problem.cell.tool.capsules) if each.joint == joint]
    return min(of_joint, key=lambda each: float(np.abs(each.q - position).min())).names
