"""Checks of speeds, of singularities, and of what the motion asks of motors and of the arm's own safety limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from planner.cell import Cell
from verifier.arm import JOINTS, ArmPieces, Mass, empty_masses, object_mass
from verifier.capsules import capsules_of
from verifier.elementary import Array, Mask
from verifier.finding import Finding, Rooms, prove
from verifier.held_objects import TICK_SHARE, HeldObject, ToolLoad, possible_loads
from verifier.joint_checks import SHARE
from verifier.motion_parts import MotionPart
from verifier.pieces import all_pieces
from verifier.plan_document import Demands, SampledMotion
from verifier.request_checks import is_at_rest
from verifier.taylor import TaylorModel, dot

SINGULARITY_WINDOW_S = 0.05  # [s] about the release. source: docs/conventions.md
SINGULARITY_ALLOWED = 1e-7  # [-] of a distance to a singularity: rounding
# source: docs/safety-limits.md: the largest ratios of measured stops to the model's
STOP_TIME = 1.85
STOP_DISTANCE = 1.31


def load_findings(
    cell: Cell, motion: SampledMotion, parts: Sequence[MotionPart], held: Sequence[HeldObject], arm: ArmPieces
) -> Iterator[Finding]:
    """Returns the findings about speeds, loads and singularities."""
    demands = parts[0].demands
    safety = cell.safety
    fastest = cell.limits.tcp_speed_max
    loads = possible_loads(held)
    if safety.tool_speed_m_s is not None:
        yield prove("tool_speed", arm, _speed(6, np.zeros((1, 3)), safety.tool_speed_m_s), ["flange"])
        fastest = min(fastest, safety.tool_speed_m_s)
    names = [f"tool centre point{part.of}" for part in parts]
    yield prove("tcp_speed", arm, _speed(6, np.array([part.p_FT for part in parts]), fastest), names)
    if spans := _at_speed(motion, demands):
        yield _singularity(cell, motion, demands, spans)
    yield prove("joint_torque", arm, _torque(loads, cell), cell.robot.joint_names)
    yield from _safety_findings(cell, parts, loads, arm)
    for each in held:
        if (grip := each.cell.gripper.hold_acceleration_m_s2) is not None:
            of = "" if len(held) == 1 else f"{each.called}, "
            yield prove("grip_acceleration", arm, _grip(each, grip), [of + axis for axis in "xyz"[: len(grip)]])


def _safety_findings(
    cell: Cell, parts: Sequence[MotionPart], loads: Sequence[ToolLoad], arm: ArmPieces
) -> Iterator[Finding]:
    """Returns the findings about the arm's own safety limits, but for the tool's speed."""
    safety = cell.safety
    elbow = next(c for c in capsules_of(cell) if c.name == "elbow")
    names = [load.called for load in loads]
    if safety.elbow_speed_m_s is not None:
        yield prove("elbow_speed", arm, _speed(elbow.frame, elbow.ends, safety.elbow_speed_m_s), ["elbow"] * 2)
    if safety.momentum_kg_m_s is not None:
        yield prove("momentum", arm, _momentum(loads, safety.momentum_kg_m_s), names)
    if safety.power_w is not None:
        yield prove("power", arm, _power(loads, safety.power_w), names)
    stops = [
        f"{joint}, {name}{what}" for name in names for what in ("", ", braking") for joint in cell.robot.joint_names
    ]
    if safety.stopping_time_s is not None:
        inverse = STOP_TIME / (safety.stopping_time_s * (1.0 + SHARE))
        yield prove("stopping_time", arm, _stop(loads, lambda _: inverse), stops)
    if safety.stopping_distance_m is not None:
        half = 0.5 * STOP_DISTANCE / (safety.stopping_distance_m * (1.0 + SHARE))
        tools = [(6, part.p_FT) for part in parts]
        points = [*tools, (6, np.zeros(3)), *((elbow.frame, end) for end in elbow.ends)]

        def inverse_time(arm: ArmPieces) -> Array:
            squares = [_square(arm.velocity(*point)).upper for point in points]
            return half * np.sqrt(np.max(squares, axis=0)) * (1.0 + 1e-12)

        yield prove("stopping_distance", arm, _stop(loads, inverse_time), stops)


def _square(v: TaylorModel) -> TaylorModel:
    return dot(v, v)


def _speed(frame: int, places: Array, limit: float) -> Rooms:
    """Returns the rooms of speeds of points (k, 3) that are fixed in a frame, by their squares."""
    most = (limit * (1.0 + SHARE)) ** 2

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        squares = [_square(arm.velocity(frame, place)) for place in places]
        return most - np.array([x.upper for x in squares]), most - np.array([x.lower for x in squares])

    return rooms


def _sizes(models: list[TaylorModel], applies: list[Mask], most: Array) -> tuple[Array, Array]:
    """Returns the rooms of absolute values (k, n) each, of those models that apply to a piece (n,)."""
    lower = [np.where(at, most - np.maximum(x.upper, -x.lower), np.inf) for x, at in zip(models, applies, strict=True)]
    upper = [
        np.where(at, most - np.maximum(np.maximum(x.lower, -x.upper), 0.0), np.inf)
        for x, at in zip(models, applies, strict=True)
    ]
    return np.concatenate(lower), np.concatenate(upper)


def _least(models: list[TaylorModel], applies: list[Mask], most: Array) -> tuple[Array, Array]:
    """Returns what `_sizes` does of each row, the least of the models."""
    lower, upper = _sizes(models, applies, most)
    shape = (len(models), -1, lower.shape[-1])
    return lower.reshape(shape).min(axis=0), upper.reshape(shape).min(axis=0)


def _torque(loads: Sequence[ToolLoad], cell: Cell) -> Rooms:
    most = cell.limits.tau_max[:, None] * (1.0 + SHARE)

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        return _least(_torques(arm, loads), [load.may_be(arm.pieces) for load in loads], most)

    return rooms


def _torques(arm: ArmPieces, loads: Sequence[ToolLoad]) -> list[TaylorModel]:
    """Returns the torques with each load (6, n)."""
    if "_torques" not in arm.__dict__:
        arm.__dict__["_torques"] = _loaded(arm.cell, loads, arm.torques)
    return arm.__dict__["_torques"]


def _loaded(cell: Cell, loads: Sequence[ToolLoad], model_of: Callable[[list[Mass]], TaylorModel]) -> list[TaylorModel]:
    """Returns what a function of masses, linear in them, is with each load: links and tool, and what is held."""
    empty = model_of(empty_masses(cell))
    objects = {each.name: each for load in loads for each in load.held}
    more = {name: model_of([object_mass(each.cell)]) for name, each in objects.items()}
    found = []
    for load in loads:
        whole = empty
        for each in load.held:
            whole = whole + more[each.name]
        found.append(whole)
    return found


def _momentum(loads: Sequence[ToolLoad], limit: float) -> Rooms:
    most = np.full((1, 1), (limit * (1.0 + SHARE)) ** 2)

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        squares = [_square(whole)[None] for whole in _loaded(arm.cell, loads, arm.momentum)]
        return _sizes(squares, [load.may_be(arm.pieces) for load in loads], most)

    return rooms


def _power(loads: Sequence[ToolLoad], limit: float) -> Rooms:
    most = np.full((1, 1), limit * (1.0 + SHARE))

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        qd = arm.pieces.joints[1]
        powers = [dot_joints(tau, qd)[None] for tau in _torques(arm, loads)]
        return _sizes(powers, [load.may_be(arm.pieces) for load in loads], most)

    return rooms


def dot_joints(tau: TaylorModel, qd: TaylorModel) -> TaylorModel:
    """Returns the sums over the joints (n,) of products (6, n)."""
    product = tau * qd
    found = product[0]
    for i in range(1, len(product.c0)):
        found = found + product[i]
    return found


def _stop(loads: Sequence[ToolLoad], inverse_time: Callable[[ArmPieces], Array | float]) -> Rooms:
    """Returns what braking in a time T leaves of the rated torques: h and h - b / T, see docs/safety-limits.md."""

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        most = arm.cell.robot.tau_max[:, None] * (1.0 + SHARE)
        inverse = inverse_time(arm)
        models: list[TaylorModel] = []
        applies: list[Mask] = []
        drifts = _loaded(arm.cell, loads, arm.at_no_acceleration().torques)
        momenta = _loaded(arm.cell, loads, arm.joint_momenta)
        for load, drift, momentum in zip(loads, drifts, momenta, strict=True):
            models += [drift, drift - momentum * inverse]
            applies += [load.may_be(arm.pieces)] * 2
        return _sizes(models, applies, most)

    return rooms


def _grip(held: HeldObject, limit: Array) -> Rooms:
    """Returns what the grip has left while it may hold the object: |a - g|, or its components in the tool."""
    X_FT = held.cell.tool.X_FT

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        up = np.array([0.0, 0.0, arm.cell.surroundings.gravity_m_s2])[:, None]
        felt = arm.acceleration(JOINTS, X_FT[:3, 3]) + up
        at = held.may_be_held(arm.pieces)
        if len(limit) == 1:
            return _sizes([_square(felt)[None]], [at], (limit[:, None] * (1.0 + SHARE)) ** 2)
        R = arm.axes(X_FT[:3, :3])
        along = R[0] * felt[0] + R[1] * felt[1] + R[2] * felt[2]
        return _sizes([along], [at], limit[:, None] * (1.0 + SHARE))

    return rooms


def _at_speed(motion: SampledMotion, demands: Demands) -> list[tuple[int, int]]:
    """Returns the samples from and to which the arm passes something at speed: a release, or each passage."""
    if not demands.passages:
        return [(motion.release, motion.release)] if demands.throws and motion.release is not None else []
    return [(p.index, p.end_index) for p in demands.passages if p.state is None or not is_at_rest(p.state)]


def _singularity(cell: Cell, motion: SampledMotion, demands: Demands, spans: list[tuple[int, int]]) -> Finding:
    """Returns the finding about wrist, elbow and shoulder around what is passed at speed (docs/conventions.md)."""
    pieces = all_pieces(motion)
    reach = math.ceil(SINGULARITY_WINDOW_S * motion.rate_hz - TICK_SHARE)
    near = np.zeros(len(pieces.tick), bool)
    for first, last in spans:
        near |= (pieces.tick >= first - reach) & (pieces.tick < last + reach)
    robot = cell.robot
    least = demands.singularity_distance_min - SINGULARITY_ALLOWED
    lengths = abs(float(robot.a[1])) + abs(float(robot.a[2]))

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        q = arm.pieces.joints[0]
        s, c = q.sine_cosine()
        both = (q[1] + q[2]).sine_cosine()[1]
        all_three = (q[1] + q[2] + q[3]).sine_cosine()[0]
        aside = c[1] * float(robot.a[1]) + both * float(robot.a[2]) + all_three * float(robot.d[4])
        far = [s[4], s[2], aside * (1.0 / lengths)]
        lower = np.array([np.maximum(np.maximum(x.lower, -x.upper), 0.0) for x in far]) - least
        return lower, np.array([np.maximum(x.upper, -x.lower) for x in far]) - least

    arm = ArmPieces(cell, pieces.chosen(near))
    return prove("singularity_distance", arm, rooms, ["wrist", "elbow", "shoulder"])
