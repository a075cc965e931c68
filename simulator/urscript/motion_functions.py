"""The functions of URScript that move or stop the arm, or wait.

Source of parameters and defaults: Universal Robots, "The URScript Programming Language".
"""

from __future__ import annotations

import math
from typing import Any

from simulator.physics import Transform, kinematics
from simulator.program import ProgramContext, ProgramError, SuddenTargetChange, Thread, motions
from simulator.program.motions import Pace
from simulator.urscript.signatures import Signature, signature
from simulator.urscript.values import ScriptPose, number, six

FIXED = 1  # mode of movec in which the tool keeps its orientation to the tangent; source: URScript manual
SHARE_MIN = 1e-3  # [-] of optimovej and optimovel, in place of a smaller one: moves end


def solved(c: ProgramContext, pose: Any, near: Any = 0.0) -> list[float]:
    """Returns joint positions (6,) [rad] of a pose, nearest to `near`, or to the commanded ones where that is no list.

    Raises:
        ProgramError: the pose cannot be reached.
    """
    q = c.solve(ScriptPose(pose), six(near) if isinstance(near, list) else None)
    if q is None:
        raise ProgramError("get_inverse_kin: unable to find an inverse kinematics solution")
    return q


def _joints(c: ProgramContext, target: Any) -> list[float]:
    """Returns the joint positions of a target: joints as they are, a pose solved."""
    return solved(c, target) if isinstance(target, ScriptPose) else six(target)


def _transform(c: ProgramContext, target: Any) -> Transform:
    """Returns the pose of a target: a pose as it is, that of the tool at joint positions.

    Raises:
        SuddenTargetChange: it cannot be reached.
    """
    if not isinstance(target, ScriptPose):
        return c.arm.chain.forward(six(target), c.tcp)
    if c.solve(target) is None:
        raise SuddenTargetChange("the target of the move cannot be reached")
    return kinematics.transform(target)


def _pace(a: Any, v: Any, t: Any = 0.0, r: Any = 0.0) -> Pace:
    return Pace(number(v), number(a), number(t), number(r))


def _move_joints(c: ProgramContext, q: Any, a: Any, v: Any, t: Any, r: Any) -> Thread:
    return motions.move_joints(c, _joints(c, q), _pace(a, v, t, r))


def _move_tool(c: ProgramContext, pose: Any, a: Any, v: Any, t: Any, r: Any) -> Thread:
    return motions.move_tool(c, _transform(c, pose), _pace(a, v, t, r))


def _move_circle(c: ProgramContext, via: Any, to: Any, a: Any, v: Any, r: Any, mode: Any) -> Thread:
    fixed = number(mode) == FIXED
    return motions.move_circle(c, _transform(c, via), _transform(c, to), _pace(a, v, 0.0, r), fixed)


def _optimal_joints(c: ProgramContext, q: Any, a: Any, v: Any, r: Any) -> Thread:
    return motions.move_joints(c, _joints(c, q), _optimal_pace(a, v, r))


def _optimal_tool(c: ProgramContext, pose: Any, a: Any, v: Any, r: Any) -> Thread:
    return motions.move_tool(c, _transform(c, pose), _optimal_pace(a, v, r))


def _optimal_pace(a: Any, v: Any, r: Any) -> Pace:
    """Returns the pace at which the joints do a share of what they can, which alone limits it."""
    return Pace(math.inf, math.inf, 0.0, number(r), _share(v), _share(a))


def _share(value: Any) -> float:
    share = number(value)
    if share > 1.0:
        raise ValueError("a and v are shares of what is possible, from 0 to 1")
    return max(share, SHARE_MIN)


def _speed_joints(c: ProgramContext, qd: Any, a: Any, t: Any) -> Thread:
    return motions.speed_joints(c, six(qd), number(a), number(t))


def _speed_tool(c: ProgramContext, xd: Any, a: Any, t: Any, aRot: Any) -> Thread:
    return motions.speed_tool(c, six(xd), number(a), number(t))


def _servo_joints(c: ProgramContext, q: Any, a: Any, v: Any, t: Any, lookahead: Any, gain: Any) -> Thread:
    return motions.servo_joints(c, six(q), number(t), number(lookahead), number(gain))


def _torque_joints(c: ProgramContext, torque: Any, *friction: Any) -> Thread:
    """The joints here have no friction to compensate."""
    return motions.torque_joints(c, six(torque))


def _sleep(c: ProgramContext, t: float) -> Thread:
    for _ in range(motions.cycles(number(t), c.arm.dt)):
        yield


def _sync(c: ProgramContext) -> Thread:
    yield


MOTION_FUNCTIONS: dict[str, Signature] = {
    "movej": signature("q a=1.4 v=1.05 t=0 r=0", _move_joints, waits=True),
    "movel": signature("pose a=1.2 v=0.25 t=0 r=0", _move_tool, waits=True),
    "movep": signature("pose a=1.2 v=0.25 r=0", lambda c, pose, a, v, r: _move_tool(c, pose, a, v, 0.0, r), waits=True),
    "movec": signature("pose_via pose_to a=1.2 v=0.25 r=0 mode=0", _move_circle, waits=True),
    "optimovej": signature("q a=0.3 v=0.3 r=0", _optimal_joints, waits=True),
    "optimovel": signature("pose a=0.3 v=0.3 r=0", _optimal_tool, waits=True),
    "speedj": signature("qd a=1.4 t=0", _speed_joints, waits=True),
    "speedl": signature("xd a=1.2 t=0 aRot=0", _speed_tool, waits=True),
    "servoj": signature("q a=0 v=0 t=0.002 lookahead_time=0.1 gain=300", _servo_joints, waits=True),
    "direct_torque": signature("torque friction_comp=1 viscous_scale=0 coulomb_scale=0", _torque_joints, waits=True),
    "stopj": signature("a", lambda c, a: motions.stop_joints(c, number(a)), waits=True),
    "stopl": signature("a aRot=0", lambda c, a, aRot: motions.stop_tool(c, number(a)), waits=True),
    "sleep": signature("t", _sleep, waits=True),
    "sync": signature("", _sync, waits=True),
}
