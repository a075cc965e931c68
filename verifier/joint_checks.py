"""Checks of the joints' motion, and of how it begins and ends."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from planner.cell import Cell
from verifier.arm import ArmPieces
from verifier.elementary import Array
from verifier.finding import Finding, judged, not_covered, prove
from verifier.pieces import jerks, misses
from verifier.plan_document import Demands, SampledMotion
from verifier.taylor import COEFFICIENT

# Limits are told in few digits: nobody means them to a millionth, and what the planner rounds is far below that.
SHARE = 1e-6  # [-] of a limit by which it may be exceeded
ANGLE_RAD = 2e-6  # [rad, rad/s, rad/s^2] of a start and of a rest: a hundredth of what an encoder of the arms tells
# [rad, rad/s] by which ticks may miss the next sample: in 500 Hz a speed of 5e-5 rad/s, below an encoder's noise. What
# they miss counts in speed, acceleration and jerk.
CONTINUITY = 1e-7


def joint_findings(cell: Cell, motion: SampledMotion, demands: Demands, arm: ArmPieces) -> Iterator[Finding]:
    """Returns the findings about the joints."""
    yield _start(motion, demands)
    yield _end(motion)
    yield _continuity(cell, motion)
    names = cell.robot.joint_names

    def position(arm: ArmPieces) -> tuple[Array, Array]:
        q = arm.pieces.joints[0]
        low, high = cell.limits.q_lower[:, None] - ANGLE_RAD, cell.limits.q_upper[:, None] + ANGLE_RAD
        return np.minimum(q.lower - low, high - q.upper), np.minimum(q.upper - low, high - q.lower)

    def sizes(derivative: int, limit: Array) -> Finding:
        most = limit[:, None] * (1.0 + SHARE)

        def rooms(arm: ArmPieces) -> tuple[Array, Array]:
            x = arm.pieces.joints[derivative]
            return most - np.maximum(x.upper, -x.lower), most - np.maximum(np.maximum(x.lower, -x.upper), 0.0)

        return prove(("joint_position", "joint_velocity", "joint_acceleration")[derivative], arm, rooms, names)

    yield prove("joint_position", arm, position, names)
    yield sizes(1, demands.qd_max)
    yield sizes(2, demands.qdd_max)
    yield _jerk(motion, demands.jerk_max, names)


def _start(motion: SampledMotion, demands: Demands) -> Finding:
    if demands.start is None:
        return not_covered("start", "a start that the plan's request does not state")
    begins = np.array([motion.q[0], motion.qd[0], motion.qdd[0]])
    off = float(np.abs(begins - demands.start).max())
    return judged("start", ANGLE_RAD - off, ANGLE_RAD - off, 0.0, "off the start asked for")


def _end(motion: SampledMotion) -> Finding:
    off = float(max(np.abs(motion.qd[-1]).max(), np.abs(motion.qdd[-1]).max()))
    at_s = (len(motion.q) - 1) / motion.rate_hz
    return judged("end_at_rest", ANGLE_RAD - off, ANGLE_RAD - off, at_s, "speed or acceleration at the end")


def _continuity(cell: Cell, motion: SampledMotion) -> Finding:
    if motion.rate_hz != cell.robot.sample_rate_hz:
        return judged("continuity", -1.0, -1.0, None, f"{motion.rate_hz} Hz is not the controller's rate")
    off = misses(motion)[:2].max(axis=(0, 2))
    tick = int(off.argmax())
    room = CONTINUITY - float(off[tick])
    return judged("continuity", room, room, (tick + 1) / motion.rate_hz, "samples that are not one motion")


def _jerk(motion: SampledMotion, limit: Array, names: tuple[str, ...]) -> Finding:
    """Returns the finding about the jerk, which is constant in a tick."""
    sizes = (np.abs(motion.qdd[1:]) + np.abs(motion.qdd[:-1])) * motion.rate_hz
    jerk = np.abs(jerks(motion))
    room = limit * (1.0 + SHARE) - jerk
    unsure = COEFFICIENT * sizes
    tick, joint = np.unravel_index(int((room - unsure).argmin()), room.shape)
    least = float(room[tick, joint] - unsure[tick, joint])
    most = float(room[tick, joint] + unsure[tick, joint])
    return judged("joint_jerk", least, most, float(tick) / motion.rate_hz, names[joint])
