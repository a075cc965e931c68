"""The motion commands of URScript as generators: one `yield` is one controller cycle.

A move interrupted by a pause (the arm brakes) continues from where the arm stands. A move that starts while the arm
moves first brings it to rest, unless the move before blends into it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from simulator.physics import Transform
from simulator.program.context import ProgramContext
from simulator.program.paths import Arc, JointPath, Path, StraightLine, joint_rates
from simulator.program.progress import PathProgress, SpeedTrapezoid
from simulator.program.threads import SuddenTargetChange, Thread

Vector = Sequence[float]
Waiting = Generator[None, None, bool]

SPEED_MIN = 1e-3
ACCELERATION_MIN = 1e-3  # [rad/s, rad/s^2, m/s, m/s^2] in place of a smaller value: moves end
ACCELERATION_MAX = 40.0  # [rad/s^2] source: ur_rtde's bound on joint acceleration; servoj and stops keep within it
SERVO_GAIN = 300.0  # source: URScript manual, servoj's default gain, at which the lookahead time is the time constant
SERVO_REACH_S = 0.1  # [s] chosen: a target farther than a joint gets in this time, at its limit, is a sudden change
MOVE_TOOL_SETTLE = 8.0  # [rad/s^2] chosen: deceleration of a moving arm before a straight move starts
MOVED = 1e-9  # [rad] a larger distance from the path shows that something else moved the arm
TINY = 1e-12  # in place of 0 in a quotient
CYCLE_SHARE = 1e-6  # [-] of a cycle that a time may miss by rounding


@dataclass(frozen=True)
class Pace:
    """How a move is to be made.

    Attributes:
        speed, acceleration: along the path [rad/s, rad/s^2 or m/s, m/s^2].
        time_s: for the whole move, in place of speed and acceleration [s]; 0: by these.
        blend_m: distance of the tool from the goal at which the next move may begin [m]; 0: at rest.
        speed_share, acceleration_share: of what the joints can do, which is never exceeded [-].
    """

    speed: float
    acceleration: float
    time_s: float = 0.0
    blend_m: float = 0.0
    speed_share: float = 1.0
    acceleration_share: float = 1.0


# -- stops
def stop_joints(c: ProgramContext, deceleration: float) -> Thread:
    """stopj: to rest, the leading axis at `deceleration` [rad/s^2]."""
    c.motion.blended = None
    while not c.arm.ramp((0.0,) * 6, min(max(deceleration, ACCELERATION_MIN), ACCELERATION_MAX)):
        yield
    yield


def stop_tool(c: ProgramContext, deceleration: float) -> Thread:
    """stopl: to rest in the time the tool needs at `deceleration` [m/s^2], every joint in proportion."""
    arm = c.arm
    _, twist = arm.chain.motion(arm.q, arm.qd, c.tcp)
    time = max(math.hypot(*twist[:3]) / max(deceleration, ACCELERATION_MIN), arm.dt)
    leading = max(map(abs, arm.qd))
    yield from stop_joints(c, leading / time)


# -- moves
def move_joints(c: ProgramContext, goal: Vector, pace: Pace) -> Thread:
    """movej: trapezoid of the leading axis, all joints in proportion, to rest at `goal` (6,) [rad]."""
    yield from _settle(c, pace.acceleration)
    yield from _move(c, lambda q: JointPath(q, goal), pace)


def move_tool(c: ProgramContext, goal: Transform, pace: Pace) -> Thread:
    """movel: trapezoid along the straight line to the pose `goal`, the rotation in proportion."""
    yield from _settle(c, MOVE_TOOL_SETTLE)
    tool = c.tcp
    yield from _move(c, lambda q: StraightLine(c.arm, q, goal, tool), pace)


def move_circle(c: ProgramContext, via: Transform, goal: Transform, pace: Pace, fixed: bool) -> Thread:
    """movec: trapezoid along the arc through `via` to `goal`; interrupted, it ends straight at the goal."""
    yield from _settle(c, MOVE_TOOL_SETTLE)
    tool = c.tcp
    arcs: list[Arc] = []

    def path(q: Vector) -> Path:
        if arcs:
            return StraightLine(c.arm, q, arcs[0].pose(1.0), tool)
        arcs.append(Arc(c.arm, q, via, goal, tool, fixed))
        return arcs[0]

    yield from _move(c, path, pace)


def _settle(c: ProgramContext, deceleration: float) -> Thread:
    if any(c.arm.qd) and c.motion.blended is None:
        yield from stop_joints(c, deceleration)


def _move(c: ProgramContext, path_from: Callable[[Vector], Path], pace: Pace) -> Thread:
    """Drives along paths to the goal: one, or one more each time that something else has moved the arm."""
    arm = c.arm
    while True:
        before = c.motion.blended
        path = path_from(arm.q if before is None else before.path.goal)
        if path.length <= MOVED:
            break
        if pace.time_s > 0.0:
            pace = _timed(path.length, pace)
        moving = PathProgress(path, _profile(c, path, pace), arm.dt, c.speed_scaling)
        if (yield from _follow(c, moving, before, pace.blend_m if path.reaches_goal else 0.0)):
            return
    if c.motion.blended is None:
        arm.drive(list(arm.q), [0.0] * 6)
    yield


def _timed(length: float, pace: Pace) -> Pace:
    """Returns the pace of a trapezoid over `length` in the time asked for; a triangle where it is too short."""
    acceleration = max(pace.acceleration, 4.0 * length / pace.time_s**2)
    root = max(acceleration**2 * pace.time_s**2 - 4.0 * acceleration * length, 0.0) ** 0.5
    return Pace((acceleration * pace.time_s - root) / 2.0, acceleration, blend_m=pace.blend_m)


def _profile(c: ProgramContext, path: Path, pace: Pace) -> SpeedTrapezoid:
    """Returns the speed along a path: what is asked for, as far as the joints can follow it.

    Where a path bends the joints, half of their acceleration is left to that.
    """
    speed = max(pace.speed, SPEED_MIN)
    acceleration = max(pace.acceleration, ACCELERATION_MIN)
    speed_max = pace.speed_share * c.robot.qd_max
    acceleration_max = pace.acceleration_share * c.robot.qdd_max
    rates = np.abs(np.array(path.rates))
    steepest = rates.max(axis=0, initial=TINY)
    if len(rates) > 1:
        acceleration_max = 0.5 * acceleration_max
        bend = np.abs(np.diff(path.rates, axis=0)).max(axis=0, initial=TINY) * (len(rates) - 1) / path.length
        speed = min(speed, float(np.sqrt((acceleration_max / bend).min())))
    speed = min(speed, float((speed_max / steepest).min()))
    acceleration = min(acceleration, float((acceleration_max / steepest).min()))
    return SpeedTrapezoid(path.length, speed, acceleration)


def _follow(c: ProgramContext, moving: PathProgress, before: PathProgress | None, blend_m: float) -> Waiting:
    """Drives along a path until its end, or until something else has moved the arm.

    Args:
        c: context of the program.
        moving: the move.
        before: what is left of the one before, which it is added to; None: nothing.
        blend_m: distance from the goal at which the next move may begin [m].

    Returns:
        Whether the rest of the move blends into the next.
    """
    arm = c.arm
    c.motion.blended = None
    while not moving.ended or (before is not None and not before.ended):
        own, qd = moving.step()
        q = own
        if before is not None and not before.ended:
            rest, speeds = before.rest()
            q = [a + b for a, b in zip(q, rest, strict=True)]
            qd = [a + b for a, b in zip(qd, speeds, strict=True)]
        _drive_along(c, moving, q, qd)
        yield
        if max(abs(a - b) for a, b in zip(arm.q, q, strict=True)) > MOVED:
            return False
        merged = before is None or before.ended
        if blend_m > 0.0 and merged and moving.brakes and _left(c, own, moving) < blend_m:
            c.motion.blended = moving
            return True
    return False


def _drive_along(c: ProgramContext, moving: PathProgress, q: list[float], qd: list[float]) -> None:
    """Drives the arm, and notes where the move leads."""
    c.motion.leads_out = not c.limits.allows(moving.path.goal)
    c.arm.drive(q, qd)


def _left(c: ProgramContext, q: Vector, moving: PathProgress) -> float:
    """Returns the distance that the tool at joint positions `q` has from the goal of a move [m]."""
    a, b = (c.arm.chain.forward(x, c.tcp) for x in (q, moving.path.goal))
    return math.dist((a[3], a[7], a[11]), (b[3], b[7], b[11]))


def coast(c: ProgramContext) -> None:
    """Ends a move that was to blend into the next, where none has come in this cycle: at rest at its goal.

    Raises:
        ProgramError: the arm cannot be on the rest of its path.
    """
    blended = c.motion.blended
    if blended is None or c.arm.driven:
        return
    _drive_along(c, blended, *blended.step())
    if blended.ended:
        c.motion.blended = None


# -- streaming
def speed_joints(c: ProgramContext, target: Vector, acceleration: float, time_s: float) -> Thread:
    """speedj: ramps to `target` (6,) [rad/s]; ends after `time_s`, or at the target if that is zero."""
    goal = list(target)

    def ramp(rate: float, change: float) -> bool:
        most = max(acceleration, ACCELERATION_MIN) * rate * rate
        return c.arm.ramp([v * rate for v in goal], max(most, ACCELERATION_MIN), change)

    return _hold(c, ramp, time_s)


def speed_tool(c: ProgramContext, target: Vector, acceleration: float, time_s: float) -> Thread:
    """speedl: ramps the tool's twist to `target` (6,) [m/s, rad/s] at `acceleration` [m/s^2], as far as joints can."""
    arm = c.arm

    def ramp(rate: float, change: float) -> bool:
        J, _ = arm.chain.jacobian(arm.q, c.tcp)
        now = J @ np.array(arm.qd) * change
        missing = np.array(target) * rate - now
        most = max(acceleration * rate * rate, ACCELERATION_MIN) * arm.dt
        largest = float(np.abs(missing).max())
        rates = joint_rates(J, now + missing * min(1.0, most / max(largest, most)))
        return arm.ramp(rates, ACCELERATION_MAX) and largest <= most

    return _hold(c, ramp, time_s)


def _hold(c: ProgramContext, ramp: Callable[[float, float], bool], time_s: float) -> Thread:
    """Ramps for a time, which the speed scaling stretches, or until the target is reached if that is zero.

    Args:
        c: context of the program.
        ramp: function of the speed scaling, and of what it has changed by since the cycle before.
        time_s: the time [s].
    """
    c.motion.blended = None
    left = time_s / c.arm.dt  # [cycles] at full speed
    before = 0.0
    while True:
        rate = c.speed_scaling()
        reached = ramp(rate, rate / before if before > 0.0 else 1.0)
        before = rate
        yield
        left -= rate
        if left <= CYCLE_SHARE if time_s > 0.0 else reached:
            return


def servo_joints(c: ProgramContext, goal: Vector, time_s: float, lookahead_s: float, gain: float) -> Thread:
    """servoj: approaches `goal` (6,) [rad] with the time constant lookahead * 300 / gain, for `time_s`.

    Raises:
        SuddenTargetChange: the goal is too far off.
    """
    c.motion.blended = None
    arm = c.arm
    speed_limit = c.limits.qd_max
    constant = max(lookahead_s * SERVO_GAIN / max(gain, 1.0), 2.0 * arm.dt)
    count = max(1, cycles(time_s, arm.dt))
    aims = _goal_speeds(c, goal, count)
    for _ in range(count):
        missing = [b - a for a, b in zip(arm.q, goal, strict=True)]
        if any(abs(e) > m * SERVO_REACH_S for e, m in zip(missing, speed_limit, strict=True)):
            raise SuddenTargetChange("servoj: sudden change in target position")
        c.motion.servoing = True
        wanted = [_approach(c, *each, constant) for each in zip(missing, arm.qd, aims, strict=True)]
        excess = max(abs(w) / m for w, m in zip(wanted, speed_limit, strict=True))
        arm.ramp([w / max(excess, 1.0) for w in wanted], ACCELERATION_MAX)
        yield


def _goal_speeds(c: ProgramContext, goal: Vector, count: int) -> list[float]:
    """Returns the speeds (6,) [rad/s] at which a streamed goal moves, by the one before; keeps this one."""
    before = c.motion.servo_goal or goal
    c.motion.servo_goal = list(goal)
    return [(b - a) / (count * c.arm.dt) for a, b in zip(before, goal, strict=True)]


def _approach(c: ProgramContext, missing: float, speed: float, aim: float, constant: float) -> float:
    """Returns the speed towards a goal [rad/s]: no more than the joint can lose on the way to it.

    Args:
        c: context of the program.
        missing: what is left of the way [rad].
        speed: of the joint [rad/s].
        aim: of the goal [rad/s].
        constant: time in which the joint would be there [s].
    """
    wanted = missing / constant
    sign = math.copysign(1.0, wanted)
    change = 0.5 * ACCELERATION_MAX * c.arm.dt  # half of this cycle is made at the present speed
    left = abs(missing) - 0.5 * max(sign * speed, 0.0) * c.arm.dt
    most = math.sqrt(change**2 + 2.0 * ACCELERATION_MAX * max(left, 0.0)) - change
    return sign * min(abs(wanted), most + max(sign * aim, 0.0))


def torque_joints(c: ProgramContext, torque: Vector) -> Thread:
    """direct_torque: for one cycle the joints have these torques (6,) [Nm] beyond what holds the arm up."""
    arm = c.arm
    acceleration = np.linalg.solve(c.inertia(), np.array(torque) - c.coriolis())
    qd = (np.array(arm.qd) + arm.dt * acceleration).tolist()
    c.motion.blended = None
    arm.drive([q + 0.5 * arm.dt * (a + b) for q, a, b in zip(arm.q, arm.qd, qd, strict=True)], qd)
    yield


def cycles(time_s: float, dt: float) -> int:
    """Returns the cycles for which a command with the time argument `time_s` [s] blocks its thread; 0 for none."""
    return max(1, math.ceil(time_s / dt - CYCLE_SHARE)) if time_s > 0.0 else 0
