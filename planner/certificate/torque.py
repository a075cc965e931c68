"""Check of the joint torques, with tool and held object."""

from __future__ import annotations

import numpy as np

from planner.arrays import Array
from planner.certificate.bounds import kinked_bound
from planner.certificate.certificate import Check, NotChecked, at_most
from planner.certificate.samples import ArmSamples, MotionSamples
from planner.certificate.shown import Curve, ShownMotion


def joint_torque(motion: MotionSamples) -> Check:
    """Checks that no joint needs more torque than allowed, with the tool and the object while it may be held.

    While the gripper may open the object may be held or gone: both are checked.
    """
    problem = motion.problem
    limit = motion.limits.tau_max

    def room(arm: ArmSamples) -> Array:
        return 1.0 - torque_sizes(motion, arm) / limit[:, None]

    bounds = motion.load_bounds
    rates = np.array([bounds.torque, bounds.torque_jumps]) / limit[:, None]  # its slope jumps where the jerk does
    proof = motion.prove(room, rates, 0.0, kinked_bound, motion.share_accuracy)
    bound = float(limit[proof.item])
    name = problem.cell.robot.joint_names[proof.item]
    value = (1.0 - proof.value) * bound
    return at_most("joint_torque", value, bound, "N m", proof.at_s, name).provided(proof.proven)


def payload(motion: MotionSamples) -> NotChecked | None:
    """Says that no rated payload of the arm is known; None where it is, and the cell keeps it."""
    return NotChecked("payload") if motion.problem.cell.robot.payload_kg is None else None


def torque_sizes(motion: MotionSamples, arm: ArmSamples) -> Array:
    """Returns the sizes of the joint torques (6, k) [N m]; the larger one where the object may be held or gone."""
    return motion.worse_of(arm.t, np.abs(arm.loaded_torques.whole), np.abs(arm.torques.whole[0]))


def curves(shown: ShownMotion) -> list[Curve]:
    """Returns the curve of the torques."""
    limit = shown.motion.limits.tau_max
    sizes = torque_sizes(shown.motion, shown.arm)
    return [shown.of_joints("joint_torque", "N m", sizes.T, 0.0 * limit, limit)]
