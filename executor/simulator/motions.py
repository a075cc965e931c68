"""The motion commands of URScript as generators: one `yield` is one controller cycle.

A move that was interrupted (the program was paused and the arm braked) goes on from where the arm stands; one that
starts while the arm moves first brings it to rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from executor.simulator.arm import Arm
from executor.simulator.kinematics import Transform, inverse, product, rotation_vector, transform
from executor.simulator.profile import Trapezoid

Vector = Sequence[float]
Scale = Callable[[], float]  # the speed scaling of now, 0 to 1
Motion = Iterator[None]
Path = Callable[[float, float], tuple[list[float], list[float]]]  # (way, rate) -> joint positions, speeds

SPEED_MIN, ACCELERATION_MIN = 1e-3, 1e-3  # [rad/s, rad/s^2, m/s, m/s^2] what a zero is taken for: moves end
ACCELERATION_MAX = 40.0  # [rad/s^2] source: ur_rtde's bound on joint acceleration; servoj and stops keep within it
SERVO_GAIN = 300.0  # source: URScript manual, servoj's default gain, at which the lookahead time is the time constant
ROTATION_LEVER_M = 0.3  # [m/rad] chosen: how far a pure rotation counts along a straight move
SPEED_DAMPING = 1e-6  # chosen: of speedl's inverse, so that a singular arm moves slowly instead of leaping
MOVE_TOOL_SETTLE = 8.0  # [rad/s^2] chosen: how a straight move brings a moving arm to rest before it starts
MOVED = 1e-9  # [rad] a larger difference from the path says that something else moved the arm


class MotionError(Exception):
    """A motion cannot be carried out; the program stops."""


class SuddenChange(Exception):
    """A target lies so far off that following it would exceed the joint speed limit: a protective stop."""


def stop_joints(arm: Arm, deceleration: float) -> Motion:
    """stopj: to rest, the leading axis at `deceleration` [rad/s^2]."""
    while not arm.ramp((0.0,) * 6, min(max(deceleration, ACCELERATION_MIN), ACCELERATION_MAX)):
        yield
    yield


def stop_tool(arm: Arm, deceleration: float, tool: Transform) -> Motion:
    """stopl: to rest in the time the tool needs at `deceleration` [m/s^2], every joint in proportion."""
    _, twist = arm.chain.motion(arm.q, arm.qd, tool)
    time = max(math.hypot(*twist[:3]) / max(deceleration, ACCELERATION_MIN), arm.dt)
    leading = max(map(abs, arm.qd))
    yield from stop_joints(arm, leading / time)


def move_joints(arm: Arm, goal: Vector, speed: float, acceleration: float, scale: Scale) -> Motion:
    """movej: trapezoid of the leading axis, all joints in proportion, to rest at `goal` (6,) [rad]."""
    yield from _settle(arm, acceleration)
    while max(abs(b - a) for a, b in zip(arm.q, goal, strict=True)) > MOVED:
        start = list(arm.q)
        way = [b - a for a, b in zip(start, goal, strict=True)]
        length = max(map(abs, way))
        profile = Trapezoid(length, max(speed, SPEED_MIN), max(acceleration, ACCELERATION_MIN))
        yield from _follow(arm, profile, scale, _along(start, way, length))
    arm.drive(list(goal), [0.0] * 6)
    yield


def _settle(arm: Arm, deceleration: float) -> Motion:
    if any(arm.qd):
        yield from stop_joints(arm, deceleration)


def _along(start: list[float], way: list[float], length: float) -> Path:
    def at(s: float, rate: float) -> tuple[list[float], list[float]]:
        return [a + w * s / length for a, w in zip(start, way, strict=True)], [w * rate / length for w in way]

    return at


def _follow(arm: Arm, profile: Trapezoid, scale: Scale, at: Path) -> Motion:
    """Drives along a path by a profile, until its end or until something else has moved the arm."""
    t = 0.0
    while t < profile.duration_s:
        rate = scale()
        t = min(t + arm.dt * rate, profile.duration_s)
        s, v = profile.at(t)
        q, qd = at(s, v * rate)
        arm.drive(q, qd)
        yield
        if max(abs(a - b) for a, b in zip(arm.q, q, strict=True)) > MOVED:
            return


def move_tool(arm: Arm, goal: Transform, speed: float, acceleration: float, scale: Scale, tool: Transform) -> Motion:
    """movel: trapezoid along the straight line to the pose `goal`, the rotation in proportion."""
    speed, acceleration = max(speed, SPEED_MIN), max(acceleration, ACCELERATION_MIN)
    yield from _settle(arm, MOVE_TOOL_SETTLE)
    while True:
        line = _Line(arm, goal, tool)
        if line.length < MOVED:
            break
        yield from _follow(arm, Trapezoid(line.length, speed, acceleration), scale, line.at)
    arm.drive(list(arm.q), [0.0] * 6)
    yield


class _Line:
    """A straight line of the tool, solved joint by joint from where the last point was."""

    def __init__(self, arm: Arm, goal: Transform, tool: Transform) -> None:
        self.arm, self.tool = arm, tool
        self.start = arm.chain.forward(arm.q, tool)
        self.way = [goal[i] - self.start[i] for i in (3, 7, 11)]
        self.turn = rotation_vector(product(goal, inverse(self.start)))
        self.length = max(math.hypot(*self.way), math.hypot(*self.turn) * ROTATION_LEVER_M)

    def at(self, s: float, rate: float) -> tuple[list[float], list[float]]:
        part = s / self.length
        turned = product(transform([0.0, 0.0, 0.0, *(part * x for x in self.turn)]), self.start)
        x, y, z = (self.start[i] + part * w for i, w in zip((3, 7, 11), self.way, strict=True))
        goal = (*turned[:3], x, *turned[4:7], y, *turned[8:11], z)
        q = self.arm.chain.solve(goal, self.arm.q, self.tool)
        if q is None:
            raise MotionError("movel: no inverse kinematics solution")
        J, _ = self.arm.chain.jacobian(q, self.tool)
        twist = np.array([*self.way, *self.turn]) * (rate / self.length)
        return q, joint_rates(J, twist)


def joint_rates(jacobian: np.ndarray, twist: np.ndarray) -> list[float]:
    """Returns the joint speeds (6,) of a twist, lightly damped."""
    J = jacobian
    return (J.T @ np.linalg.solve(J @ J.T + SPEED_DAMPING * np.eye(6), twist)).tolist()


def speed_joints(arm: Arm, target: Vector, acceleration: float, time_s: float, scale: Scale) -> Motion:
    """speedj: ramps to `target` (6,) [rad/s]; returns after `time_s`, or once reached where that is zero."""
    left = cycles(time_s, arm.dt)
    while True:
        rate = scale()
        reached = arm.ramp([v * rate for v in target], max(acceleration, ACCELERATION_MIN))
        yield
        left -= 1
        if left == 0 or (left < 0 and reached):
            return


def speed_tool(arm: Arm, target: Vector, acceleration: float, time_s: float, scale: Scale, tool: Transform) -> Motion:
    """speedl: ramps the tool's twist to `target` (6,) [m/s, rad/s] at `acceleration` [m/s^2]."""
    left = cycles(time_s, arm.dt)
    while True:
        J, _ = arm.chain.jacobian(arm.q, tool)
        now = J @ np.array(arm.qd)
        change = np.array(target) * scale() - now
        most = max(acceleration, ACCELERATION_MIN) * arm.dt
        largest = float(np.abs(change).max())
        reached = largest <= most
        arm.ramp(joint_rates(J, now + change * min(1.0, most / max(largest, most))), math.inf)
        yield
        left -= 1
        if left == 0 or (left < 0 and reached):
            return


def servo_joints(arm: Arm, goal: Vector, time_s: float, lookahead_s: float, gain: float, speed_limit: Vector) -> Motion:
    """servoj: approaches `goal` (6,) [rad] with the time constant lookahead * 300 / gain, for `time_s`."""
    constant = max(lookahead_s * SERVO_GAIN / max(gain, 1.0), 2.0 * arm.dt)
    for _ in range(max(1, cycles(time_s, arm.dt))):
        wanted = [(b - a) / constant for a, b in zip(arm.q, goal, strict=True)]
        if any(abs(w) > m for w, m in zip(wanted, speed_limit, strict=True)):
            raise SuddenChange("servoj: sudden change in target position")
        arm.ramp(wanted, ACCELERATION_MAX)
        yield


def cycles(time_s: float, dt: float) -> int:
    """Returns the cycles a command with the time argument `time_s` holds the thread; 0 where it gives no time."""
    return max(1, math.ceil(time_s / dt - 1e-6)) if time_s > 0.0 else 0
