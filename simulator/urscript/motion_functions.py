"""The functions of URScript that move or stop the arm, or wait.

Source of parameters and defaults: Universal Robots, "The URScript Programming Language".
"""

from __future__ import annotations

from typing import Any

from simulator.physics import kinematics
from simulator.program import ProgramContext, ProgramError, SuddenTargetChange, Thread, motions
from simulator.urscript.signatures import Signature, signature
from simulator.urscript.values import ScriptPose, number, six


def _joints(c: ProgramContext, target: Any) -> list[float]:
    """Returns the joint positions of a target: joints as they are, a pose solved.

    Raises:
        ProgramError: the pose cannot be reached.
    """
    if not isinstance(target, ScriptPose):
        return six(target)
    q = c.solve(target)
    if q is None:
        raise ProgramError("get_inverse_kin: unable to find an inverse kinematics solution")
    return q


def _move_joints(c: ProgramContext, q: Any, a: float, v: float, t: float, r: float) -> Thread:
    goal = _joints(c, q)
    if number(t) > 0.0:  # the time replaces the speed: the leading axis needs t with acceleration a
        length = max(abs(x - y) for x, y in zip(c.arm.q, goal, strict=True))
        v, a = _timed(length, a, t)
    return motions.move_joints(c.arm, goal, number(v), number(a), c.speed_scaling)


def _timed(length: float, acceleration: float, time_s: float) -> tuple[float, float]:
    """Returns speed and acceleration of a trapezoid over `length` in a time; a triangle where it is too short."""
    acceleration = max(acceleration, 4.0 * length / time_s**2)
    root = max(acceleration**2 * time_s**2 - 4.0 * acceleration * length, 0.0) ** 0.5
    return (acceleration * time_s - root) / 2.0, acceleration


def _move_tool(c: ProgramContext, pose: Any, a: float, v: float, t: float, r: float) -> Thread:
    goal = pose if isinstance(pose, ScriptPose) else kinematics.pose_of(c.arm.chain.forward(six(pose), c.tcp))
    if c.solve(goal) is None:
        raise SuddenTargetChange("movel: the target cannot be reached")
    transform = kinematics.transform(goal)
    return motions.move_tool(c.arm, transform, number(v), number(a), c.speed_scaling, c.tcp)


def _speed_joints(c: ProgramContext, qd: Any, a: float, t: float) -> Thread:
    return motions.speed_joints(c.arm, six(qd), number(a), number(t), c.speed_scaling)


def _speed_tool(c: ProgramContext, xd: Any, a: float, t: float, aRot: float) -> Thread:
    return motions.speed_tool(c.arm, six(xd), number(a), number(t), c.speed_scaling, c.tcp)


def _servo_joints(c: ProgramContext, q: Any, a: float, v: float, t: float, lookahead: float, gain: float) -> Thread:
    return motions.servo_joints(c.arm, six(q), number(t), number(lookahead), number(gain), c.limits.qd_max)


def _sleep(c: ProgramContext, t: float) -> Thread:
    for _ in range(motions.cycles(number(t), c.arm.dt)):
        yield


def _sync(c: ProgramContext) -> Thread:
    yield


MOTION_FUNCTIONS: dict[str, Signature] = {
    "movej": signature("q a=1.4 v=1.05 t=0 r=0", _move_joints),
    "movel": signature("pose a=1.2 v=0.25 t=0 r=0", _move_tool),
    "movep": signature("pose a=1.2 v=0.25 r=0", lambda c, pose, a, v, r: _move_tool(c, pose, a, v, 0.0, r)),
    "speedj": signature("qd a=1.4 t=0", _speed_joints),
    "speedl": signature("xd a=1.2 t=0 aRot=0", _speed_tool),
    "servoj": signature("q a=0 v=0 t=0.002 lookahead_time=0.1 gain=300", _servo_joints),
    "stopj": signature("a", lambda c, a: motions.stop_joints(c.arm, number(a))),
    "stopl": signature("a aRot=0", lambda c, a, aRot: motions.stop_tool(c.arm, number(a), c.tcp)),
    "sleep": signature("t", _sleep),
    "sync": signature("", _sync),
    "get_steptime": signature("", lambda c: c.arm.dt),
    "get_inverse_kin": signature("pose", lambda c, pose: _joints(c, ScriptPose(pose))),
}
