"""The judge: is this trajectory an answer to that problem? Written from the problem alone, without knowing any solver.

Every bound holds at every instant, between samples too: joint bounds by closed forms on the cubic pieces, bounds in
space by bisection with proven bounds on how far a function strays (`bounds`). The executor judges again.
"""

from __future__ import annotations

from planner.certificate import joints, space, throw, tool
from planner.certificate.check import Certificate, Check, at_least, at_most
from planner.certificate.motion import Motion
from planner.certificate.throw import landing_errors, release_flight
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

__all__ = [
    "Certificate",
    "Check",
    "at_least",
    "at_most",
    "certify",
    "landing_errors",
    "release_flight",
]

JOINT_CHECKS = (
    joints.start,
    joints.joint_position,
    joints.joint_velocity,
    joints.joint_acceleration,
    joints.joint_jerk,
    joints.end_at_rest,
    joints.continuity,
)
MOTION_CHECKS = (
    tool.tcp_speed,
    space.floor,
    space.keep_in,
    space.keep_out,
    space.self_collision,
    tool.singularity_distance,
    tool.joint_torque,
    throw.landing_window,
    throw.release_position,
    throw.release_velocity,
    throw.landing,
)


def certify(problem: ThrowProblem, trajectory: Trajectory) -> Certificate:
    """Returns the judgement of `trajectory` as an answer to `problem`: every check that applies, with its margin.

    A trajectory that is not a continuous motion with the controller's sample rate and finite numbers is judged by its
    joint checks alone: the bounds in space rest on them.
    """
    checks = [check(problem, trajectory) for check in JOINT_CHECKS]
    checks.append(_sample_rate(problem, trajectory))
    if not (checks[-1].ok and checks[-2].ok):
        return Certificate(tuple(checks[:-1] if checks[-1].ok else checks))
    checks.pop()
    motion = Motion(problem, trajectory)
    found = [check(motion) for check in MOTION_CHECKS]
    checks += [check for check in found if check is not None]
    return Certificate(tuple(checks))


def _sample_rate(problem: ThrowProblem, trajectory: Trajectory) -> Check:
    """The samples are ticks of the cell's controller (reported as `continuity` where they are not)."""
    off = abs(trajectory.sample_rate_hz - problem.cell.robot.sample_rate_hz)
    return at_most("continuity", off, 0.0, "Hz", None, "sample rate against the controller's")
