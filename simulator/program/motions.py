"""The motion commands of URScript as generators: one `yield` is one controller cycle.

A move interrupted by a pause (the arm brakes) continues from where the arm stands. A move that starts while the arm
moves first brings it to rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from simulator.physics import Arm, Transform, kinematics
from simulator.program.threads import ProgramError, SuddenTargetChange, Thread

Vector = Sequence[float]
Scale = Callable[[], float]  # returns the present speed scaling, 0 to 1
JointPath = Callable[[float, float], tuple[list[float], list[float]]]  # (distance, speed) -> joint positions, speeds

SPEED_MIN = 1e-3
ACCELERATION_MIN = 1e-3  # [rad/s, rad/s^2, m/s, m/s^2] in place of a smaller value: moves end
ACCELERATION_MAX = 40.0  # [rad/s^2] source: ur_rtde's bound on joint acceleration; servoj and stops keep within it
SERVO_GAIN = 300.0  # source: URScript manual, servoj's default gain, at which the lookahead time is the time constant
ROTATION_LEVER_M = 0.3  # [m/rad] chosen: length that a pure rotation counts along a straight move
SPEED_DAMPING = 1e-6  # chosen: of speedl's inverse, so that a singular arm moves slowly instead of jumping
MOVE_TOOL_SETTLE = 8.0  # [rad/s^2] chosen: deceleration of a moving arm before a straight move starts
MOVED = 1e-9  # [rad] a larger distance from the path shows that something else moved the arm


class SpeedTrapezoid:
    """Rest to rest over `length` [rad or m] with a largest speed and one acceleration; a triangle if it is short."""

    def __init__(self, length: float, speed: float, acceleration: float) -> None:
        self.length = length
        self.acceleration = acceleration
        self.speed = min(speed, math.sqrt(length * acceleration))
        self.ramp_s = self.speed / acceleration
        self.duration_s = length / self.speed + self.ramp_s

    def at(self, t: float) -> tuple[float, float]:
        """Returns distance and speed at `t` [s] after the start."""
        rest = self.duration_s - t
        if rest <= 0.0:
            return self.length, 0.0
        if t < self.ramp_s:
            return 0.5 * self.acceleration * t * t, self.acceleration * t
        if rest < self.ramp_s:
            return self.length - 0.5 * self.acceleration * rest * rest, self.acceleration * rest
        return self.speed * (t - 0.5 * self.ramp_s), self.speed


def stop_joints(arm: Arm, deceleration: float) -> Thread:
    """stopj: to rest, the leading axis at `deceleration` [rad/s^2]."""
    while not arm.ramp((0.0,) * 6, min(max(deceleration, ACCELERATION_MIN), ACCELERATION_MAX)):
        yield
    yield


def stop_tool(arm: Arm, deceleration: float, tool: Transform) -> Thread:
    """stopl: to rest in the time the tool needs at `deceleration` [m/s^2], every joint in proportion."""
    _, twist = arm.chain.motion(arm.q, arm.qd, tool)
    time = max(math.hypot(*twist[:3]) / max(deceleration, ACCELERATION_MIN), arm.dt)
    leading = max(map(abs, arm.qd))
    yield from stop_joints(arm, leading / time)


def move_joints(arm: Arm, goal: Vector, speed: float, acceleration: float, scale: Scale) -> Thread:
    """movej: trapezoid of the leading axis, all joints in proportion, to rest at `goal` (6,) [rad]."""
    yield from _settle(arm, acceleration)
    while max(abs(b - a) for a, b in zip(arm.q, goal, strict=True)) > MOVED:
        start = list(arm.q)
        offset = [b - a for a, b in zip(start, goal, strict=True)]
        length = max(map(abs, offset))
        profile = SpeedTrapezoid(length, max(speed, SPEED_MIN), max(acceleration, ACCELERATION_MIN))
        yield from _follow(arm, profile, scale, _along(start, offset, length))
    arm.drive(list(goal), [0.0] * 6)
    yield


def _settle(arm: Arm, deceleration: float) -> Thread:
    if any(arm.qd):
        yield from stop_joints(arm, deceleration)


def _along(start: list[float], offset: list[float], length: float) -> JointPath:
    def at(s: float, rate: float) -> tuple[list[float], list[float]]:
        return [a + w * s / length for a, w in zip(start, offset, strict=True)], [w * rate / length for w in offset]

    return at


def _follow(arm: Arm, profile: SpeedTrapezoid, scale: Scale, path: JointPath) -> Thread:
    """Drives along a path by a speed profile, until its end or until something else has moved the arm."""
    t = 0.0
    while t < profile.duration_s:
        rate = scale()
        t = min(t + arm.dt * rate, profile.duration_s)
        s, v = profile.at(t)
        q, qd = path(s, v * rate)
        arm.drive(q, qd)
        yield
        if max(abs(a - b) for a, b in zip(arm.q, q, strict=True)) > MOVED:
            return


def move_tool(arm: Arm, goal: Transform, speed: float, acceleration: float, scale: Scale, tool: Transform) -> Thread:
    """movel: trapezoid along the straight line to the pose `goal`, the rotation in proportion."""
    speed = max(speed, SPEED_MIN)
    acceleration = max(acceleration, ACCELERATION_MIN)
    yield from _settle(arm, MOVE_TOOL_SETTLE)
    while True:
        line = _StraightLine(arm, goal, tool)
        if line.length < MOVED:
            break
        yield from _follow(arm, SpeedTrapezoid(line.length, speed, acceleration), scale, line.at)
    arm.drive(list(arm.q), [0.0] * 6)
    yield


class _StraightLine:
    """A straight line of the tool; each point is solved from the joint angles of the one before."""

    def __init__(self, arm: Arm, goal: Transform, tool: Transform) -> None:
        self.arm = arm
        self.tool = tool
        self.start = arm.chain.forward(arm.q, tool)
        self.offset = [goal[i] - self.start[i] for i in (3, 7, 11)]
        self.turn = kinematics.rotation_vector(kinematics.product(goal, kinematics.inverse(self.start)))
        self.length = max(math.hypot(*self.offset), math.hypot(*self.turn) * ROTATION_LEVER_M)

    def at(self, s: float, rate: float) -> tuple[list[float], list[float]]:
        part = s / self.length
        turned = kinematics.product(kinematics.transform([0.0, 0.0, 0.0, *(part * x for x in self.turn)]), self.start)
        x, y, z = (self.start[i] + part * w for i, w in zip((3, 7, 11), self.offset, strict=True))
        goal = (*turned[:3], x, *turned[4:7], y, *turned[8:11], z)
        q = self.arm.chain.solve(goal, self.arm.q, self.tool)
        if q is None:
            raise ProgramError("movel: no inverse kinematics solution")
        J, _ = self.arm.chain.jacobian(q, self.tool)
        twist = np.array([*self.offset, *self.turn]) * (rate / self.length)
        return q, joint_rates(J, twist)


def joint_rates(jacobian: np.ndarray, twist: np.ndarray) -> list[float]:
    """Returns the joint speeds (6,) [rad/s] of a twist (6,) [m/s, rad/s], lightly damped."""
    J = jacobian
    return (J.T @ np.linalg.solve(J @ J.T + SPEED_DAMPING * np.eye(6), twist)).tolist()


def speed_joints(arm: Arm, target: Vector, acceleration: float, time_s: float, scale: Scale) -> Thread:
    """speedj: ramps to `target` (6,) [rad/s]; ends after `time_s`, or at the target if that is zero."""

    def ramp() -> bool:
        rate = scale()
        return arm.ramp([v * rate for v in target], max(acceleration, ACCELERATION_MIN))

    return _hold(ramp, cycles(time_s, arm.dt))


def _hold(ramp: Callable[[], bool], left: int) -> Thread:
    """Ramps in each of `left` cycles, or until the target is reached if that is zero."""
    while True:
        reached = ramp()
        yield
        left -= 1
        if left == 0 or (left < 0 and reached):
            return


def speed_tool(arm: Arm, target: Vector, acceleration: float, time_s: float, scale: Scale, tool: Transform) -> Thread:
    """speedl: ramps the tool's twist to `target` (6,) [m/s, rad/s] at `acceleration` [m/s^2]."""

    def ramp() -> bool:
        J, _ = arm.chain.jacobian(arm.q, tool)
        now = J @ np.array(arm.qd)
        change = np.array(target) * scale() - now
        most = max(acceleration, ACCELERATION_MIN) * arm.dt
        largest = float(np.abs(change).max())
        arm.ramp(joint_rates(J, now + change * min(1.0, most / max(largest, most))), math.inf)
        return largest <= most

    return _hold(ramp, cycles(time_s, arm.dt))


def servo_joints(arm: Arm, goal: Vector, time_s: float, lookahead_s: float, gain: float, speed_limit: Vector) -> Thread:
    """servoj: approaches `goal` (6,) [rad] with the time constant lookahead * 300 / gain, for `time_s`."""
    constant = max(lookahead_s * SERVO_GAIN / max(gain, 1.0), 2.0 * arm.dt)
    for _ in range(max(1, cycles(time_s, arm.dt))):
        wanted = [(b - a) / constant for a, b in zip(arm.q, goal, strict=True)]
        if any(abs(w) > m for w, m in zip(wanted, speed_limit, strict=True)):
            raise SuddenTargetChange("servoj: sudden change in target position")
        arm.ramp(wanted, ACCELERATION_MAX)
        yield


def cycles(time_s: float, dt: float) -> int:
    """Returns the cycles for which a command with the time argument `time_s` [s] blocks its thread; 0 for none."""
    return max(1, math.ceil(time_s / dt - 1e-6)) if time_s > 0.0 else 0
