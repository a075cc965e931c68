"""The list of checks, and the function that makes a certificate of them.

To add a check, write a function `(motion: MotionSamples) -> Check | NotChecked | None` in the module of its family and
add it to `MOTION_CHECKS`. None means that the check does not apply to the problem; `NotChecked`, that the cell gives no
limit for it, or that the model cannot tell.
"""

from __future__ import annotations

from collections.abc import Callable

from planner.certificate import clearance, grip, joints, release, safety_limits, stopping, tool, torque
from planner.certificate.certificate import Certificate, Check, NotChecked
from planner.certificate.flight import flight_clearance
from planner.certificate.samples import MotionSamples
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

CheckFunction = Callable[[MotionSamples], Check | NotChecked | None]

# Checks of the joints alone, which hold for any samples.
JOINT_CHECKS: tuple[CheckFunction, ...] = (
    joints.start,
    joints.joint_position,
    joints.joint_velocity,
    joints.joint_acceleration,
    joints.joint_jerk,
    joints.end_at_rest,
    joints.continuity,
    joints.sample_rate,
)
# Checks that rest on a continuous motion.
MOTION_CHECKS: tuple[CheckFunction, ...] = (
    tool.tcp_speed,
    clearance.floor,
    clearance.keep_in,
    clearance.keep_out,
    clearance.self_collision,
    tool.singularity_distance,
    torque.joint_torque,
    safety_limits.elbow_speed,
    safety_limits.linear_momentum,
    safety_limits.power,
    stopping.stopping_time,
    stopping.stopping_distance,
    release.landing_window,
    release.release_position,
    release.release_velocity,
    release.landing,
    flight_clearance,
    grip.grip_acceleration,
    grip.opening_direction,
)


def certify(problem: ThrowProblem, trajectory: Trajectory) -> Certificate:
    """Returns the certificate of `trajectory` as a solution of `problem`: every check that applies, with its margin.

    If the samples are not one continuous motion at the controller's sample rate, the certificate has the joint checks
    only: the bounds of the others rest on that.
    """
    motion = MotionSamples(problem, trajectory)
    found = [check(motion) for check in JOINT_CHECKS]
    if all(check.ok for check in found if isinstance(check, Check) and check.name == "continuity"):
        found += [check(motion) for check in MOTION_CHECKS]
    return Certificate(
        tuple(check for check in found if isinstance(check, Check)),
        tuple(check.name for check in found if isinstance(check, NotChecked)),
    )
