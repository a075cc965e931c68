"""The room that each joint needs to come to its velocity at the release, and to lose it again.

A joint at velocity v last stood still v^2 / (2 a) before, and stands still again as far behind it at the soonest, where
a is its acceleration limit: with a limit on jerk, and with other joints to wait for, it is farther. A release state of
which a joint would stand still beyond its limits, or beyond what self-collision blocks, has no motion through it.

The certificate takes a release that is a little off, and next to a singularity a joint is off by far more than the
tool. So the state is taken as uncertain by dq and dv; a joint turns then by v dv / a + dv^2 / (2 a) + dq less.
"""

from __future__ import annotations

import math

import numpy as np

from planner.arrays import Array
from planner.errors import Violation
from planner.geometry import barriers, body_model
from planner.kinematics import jacobian
from planner.problem import ThrowProblem

# [m, rad] and [m/s, rad/s] by which a release may be off: a little more than the certificate's tolerances
OFF = 1.01e-5
OFF_PER_S = 1.01e-4


def lack_of_room(problem: ThrowProblem, q: Array, qd: Array) -> Array:
    """Returns how far each joint turns beyond what is reachable (n, 6), at least [rad]; negative where it need not.

    Args:
        problem: of a given release state or pose: its start, limits and cell.
        q: positions (n, 6) at the release [rad].
        qd: velocities (n, 6) [rad/s].
    """
    return np.asarray(np.maximum(*_lacks(problem, q, qd)))


def no_room(problem: ThrowProblem, q: Array, qd: Array) -> Violation:
    """Returns the joint velocity that rules out the states q, qd (n, 6): of the one that lacks least room."""
    lacks = _lacks(problem, q, qd)
    lack = np.maximum(*lacks)
    best = int(lack.max(axis=1).argmin())
    joint = int(lack[best].argmax())
    is_below = bool(lacks[0][best, joint] >= lacks[1][best, joint])
    reachable = problem.reachable
    limits = problem.limits
    place = float(q[best, joint])
    bound = float(reachable.q_lower[joint] if is_below else reachable.q_upper[joint])
    room = abs(place - bound)
    speed = float(qd[best, joint])
    fastest = math.sqrt(2.0 * float(limits.qdd_max[joint]) * room)
    ends = "stop" if (speed < 0.0) == is_below else "get up to speed"
    detail = f"{problem.cell.robot.joint_names[joint]} at the release: it has {room:.3f} rad to {ends}"
    if bound in (limits.q_lower[joint], limits.q_upper[joint]):
        detail += ", to its position limit"
    else:
        detail += f", where {' and '.join(_names_at(problem, joint, bound))} collide"
    return Violation("joint_velocity", abs(speed), fastest, "rad/s", detail=detail)


def _lacks(problem: ThrowProblem, q: Array, qd: Array) -> tuple[Array, Array]:
    """Returns how far each joint turns below and above what is reachable, each (n, 6) [rad].

    A joint that is in motion at the start need not have stood still before: there only the way to its stop counts.
    """
    turned = 0.5 * qd**2 / problem.limits.qdd_max
    reachable = problem.reachable
    lacking = ((q - turned < reachable.q_lower) | (q + turned > reachable.q_upper)).any(axis=1)
    if lacking.any():  # few of a pose's states, mostly none
        turned[lacking] -= _uncertainty(problem, q[lacking], qd[lacking])
    below = reachable.q_lower - (q - turned)
    above = q + turned - reachable.q_upper
    if problem.starts_at_rest:
        return below, above
    return np.where(qd > 0.0, -np.inf, below), np.where(qd < 0.0, -np.inf, above)


def _uncertainty(problem: ThrowProblem, q: Array, qd: Array) -> Array:
    """Returns by how much less the joints may turn (n, 6) [rad], as the release may be off; infinite if unbounded.

    Of a pose, with the least singular value s of the Jacobian: dq = |off| / s. Over that way the Jacobian changes by c
    at most, so dv = (|off per second| + c |v|) / (s - c). Its columns have norms up to the lever's, and each change
    moves all of them.
    """
    if problem.release.joint_state is not None:
        dq = np.full((len(q), 1), OFF)
        dv = np.full((len(q), 1), OFF_PER_S)
    else:
        least = np.linalg.svd(jacobian(problem.cell.robot, q, problem.cell.tool.X_FT), compute_uv=False)[:, -1:]
        with np.errstate(divide="ignore", invalid="ignore"):
            dq = math.sqrt(2.0) * OFF / least
            change = 6.0 * math.hypot(1.0, float(body_model(problem.cell).tool_lever.max())) * dq
            speed = np.linalg.norm(qd, axis=1, keepdims=True)
            dv = np.where(change < least, (math.sqrt(6.0) * OFF_PER_S + change * speed) / (least - change), np.inf)
    return np.asarray((np.abs(qd) + 0.5 * dv) * dv / problem.limits.qdd_max + dq)


def _names_at(problem: ThrowProblem, joint: int, position: float) -> tuple[str, str]:
    """Returns the two capsules that collide from a joint position on."""
    cell = problem.cell
    of_joint = [each for each in barriers(cell.robot, cell.tool.capsules, cell.surroundings) if each.joint == joint]
    return min(of_joint, key=lambda each: float(np.abs(each.q - position).min())).names
