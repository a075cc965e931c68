"""Checks of speeds, of singularities, and of what the motion asks of motors and of the arm's own safety limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from planner.cell import Cell
from verifier.arm import ArmPieces, empty_masses, object_mass
from verifier.capsules import capsules_of
from verifier.elementary import Array
from verifier.finding import Finding, Rooms, prove
from verifier.joint_checks import SHARE
from verifier.pieces import Pieces, all_pieces
from verifier.plan_document import Demands, SampledMotion, is_at_rest
from verifier.taylor import TaylorModel, dot

TICK_SHARE = 1e-6  # [-] of a tick, 2 ns: a spread that is longer by it is not a tick longer
SINGULARITY_WINDOW_S = 0.05  # [s] about the release. source: docs/conventions.md
SINGULARITY_ALLOWED = 1e-7  # [-] of a distance to a singularity: rounding
# source: docs/safety-limits.md: the largest ratios of measured stops to the model's
STOP_TIME = 1.85
STOP_DISTANCE = 1.31


class HeldObject:
    """From when the object may have left and until when it may be held, in ticks; rounded outwards."""

    def __init__(self, motion: SampledMotion, demands: Demands) -> None:
        """Takes what a plan demands: the object leaves at the release, up to the spread early or late."""
        last = len(motion.q) - 1
        self.gone_from: float = math.inf
        self.held_until: float = math.inf
        if demands.throws and motion.release is not None:
            ticks = math.ceil(demands.spread_s * motion.rate_hz - TICK_SHARE)
            self.gone_from = max(motion.release - ticks, 0)
            self.held_until = min(motion.release + ticks, last)

    def may_be_held(self, pieces: Pieces) -> NDArray[np.bool_]:
        """Returns in which pieces (n,) the object may be held."""
        return pieces.tick + pieces.begin <= self.held_until

    def may_be_gone(self, pieces: Pieces) -> NDArray[np.bool_]:
        """Returns in which pieces (n,) it may be gone."""
        return pieces.tick + pieces.end >= self.gone_from


def load_findings(cell: Cell, motion: SampledMotion, demands: Demands, arm: ArmPieces) -> Iterator[Finding]:
    """Returns the findings about speeds, loads and singularities."""
    held = HeldObject(motion, demands)
    safety = cell.safety
    fastest = cell.limits.tcp_speed_max
    if safety.tool_speed_m_s is not None:
        yield prove("tool_speed", arm, _speed(6, np.zeros((1, 3)), safety.tool_speed_m_s), ["flange"])
        fastest = min(fastest, safety.tool_speed_m_s)
    yield prove("tcp_speed", arm, _speed(6, cell.tool.X_FT[None, :3, 3], fastest), ["tool centre point"])
    if spans := _at_speed(motion, demands):
        yield _singularity(cell, motion, demands, spans)
    yield prove("joint_torque", arm, _torque(held, cell), cell.robot.joint_names)
    yield from _safety_findings(cell, held, arm)
    if (grip := cell.gripper.hold_acceleration_m_s2) is not None and demands.throws:
        yield prove("grip_acceleration", arm, _grip(held, grip), ["x", "y", "z"][: len(grip)])


def _safety_findings(cell: Cell, held: HeldObject, arm: ArmPieces) -> Iterator[Finding]:
    """Returns the findings about the arm's own safety limits, but for the tool's speed."""
    safety = cell.safety
    elbow = next(c for c in capsules_of(cell) if c.name == "elbow")
    if safety.elbow_speed_m_s is not None:
        yield prove("elbow_speed", arm, _speed(elbow.frame, elbow.ends, safety.elbow_speed_m_s), ["elbow"] * 2)
    if safety.momentum_kg_m_s is not None:
        yield prove("momentum", arm, _momentum(held, safety.momentum_kg_m_s), ["held", "empty"])
    if safety.power_w is not None:
        yield prove("power", arm, _power(held, safety.power_w), ["held", "empty"])
    if safety.stopping_time_s is not None:
        inverse = STOP_TIME / (safety.stopping_time_s * (1.0 + SHARE))
        yield prove("stopping_time", arm, _stop(held, lambda _: inverse), _stop_names(cell))
    if safety.stopping_distance_m is not None:
        half = 0.5 * STOP_DISTANCE / (safety.stopping_distance_m * (1.0 + SHARE))
        points = [(6, cell.tool.X_FT[:3, 3]), (6, np.zeros(3)), *((elbow.frame, end) for end in elbow.ends)]

        def inverse_time(arm: ArmPieces) -> Array:
            squares = [_square(arm.velocity(*point)).upper for point in points]
            return half * np.sqrt(np.max(squares, axis=0)) * (1.0 + 1e-12)

        yield prove("stopping_distance", arm, _stop(held, inverse_time), _stop_names(cell))


def _square(v: TaylorModel) -> TaylorModel:
    return dot(v, v)


def _speed(frame: int, places: Array, limit: float) -> Rooms:
    """Returns the rooms of speeds of points (k, 3) that are fixed in a frame, by their squares."""
    most = (limit * (1.0 + SHARE)) ** 2

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        squares = [_square(arm.velocity(frame, place)) for place in places]
        return most - np.array([x.upper for x in squares]), most - np.array([x.lower for x in squares])

    return rooms


def _sizes(models: list[TaylorModel], applies: list[NDArray[np.bool_]], most: Array) -> tuple[Array, Array]:
    """Returns the rooms of absolute values (k, n) each, of those models that apply to a piece (n,)."""
    lower = [np.where(at, most - np.maximum(x.upper, -x.lower), np.inf) for x, at in zip(models, applies, strict=True)]
    upper = [
        np.where(at, most - np.maximum(np.maximum(x.lower, -x.upper), 0.0), np.inf)
        for x, at in zip(models, applies, strict=True)
    ]
    return np.concatenate(lower), np.concatenate(upper)


def _least(models: list[TaylorModel], applies: list[NDArray[np.bool_]], most: Array) -> tuple[Array, Array]:
    """Returns what `_sizes` does of each row, the least of the models."""
    lower, upper = _sizes(models, applies, most)
    shape = (len(models), -1, lower.shape[-1])
    return lower.reshape(shape).min(axis=0), upper.reshape(shape).min(axis=0)


def _torque(held: HeldObject, cell: Cell) -> Rooms:
    most = cell.limits.tau_max[:, None] * (1.0 + SHARE)

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        empty, loaded = _torques(arm)
        return _least([loaded, empty], [held.may_be_held(arm.pieces), held.may_be_gone(arm.pieces)], most)

    return rooms


def _torques(arm: ArmPieces) -> tuple[TaylorModel, TaylorModel]:
    """Returns the torques without the object and with it (6, n)."""
    if "_torques" not in arm.__dict__:
        empty = arm.torques(empty_masses(arm.cell))
        arm.__dict__["_torques"] = empty, empty + arm.torques([object_mass(arm.cell)])
    return arm.__dict__["_torques"]


def _momentum(held: HeldObject, limit: float) -> Rooms:
    most = (limit * (1.0 + SHARE)) ** 2

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        empty = arm.momentum(empty_masses(arm.cell))
        loaded = empty + arm.momentum([object_mass(arm.cell)])
        applies = [held.may_be_held(arm.pieces), held.may_be_gone(arm.pieces)]
        squares = [_square(loaded)[None], _square(empty)[None]]
        return _sizes(squares, applies, np.full((1, 1), most))

    return rooms


def _power(held: HeldObject, limit: float) -> Rooms:
    most = np.full((1, 1), limit * (1.0 + SHARE))

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        qd = arm.pieces.joints[1]
        empty, loaded = (dot_joints(tau, qd)[None] for tau in _torques(arm))
        return _sizes([loaded, empty], [held.may_be_held(arm.pieces), held.may_be_gone(arm.pieces)], most)

    return rooms


def dot_joints(tau: TaylorModel, qd: TaylorModel) -> TaylorModel:
    """Returns the sums over the joints (n,) of products (6, n)."""
    product = tau * qd
    found = product[0]
    for i in range(1, len(product.c0)):
        found = found + product[i]
    return found


def _stop_names(cell: Cell) -> list[str]:
    return [
        f"{joint}, {what}"
        for what in ("held", "held, braking", "empty", "empty, braking")
        for joint in cell.robot.joint_names
    ]


def _stop(held: HeldObject, inverse_time: Callable[[ArmPieces], Array | float]) -> Rooms:
    """Returns what braking in a time T leaves of the rated torques: h and h - b / T, see docs/safety-limits.md."""

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        most = arm.cell.robot.tau_max[:, None] * (1.0 + SHARE)
        coasting = arm.at_no_acceleration()
        inverse = inverse_time(arm)
        models: list[TaylorModel] = []
        applies: list[NDArray[np.bool_]] = []
        empty, thing = empty_masses(arm.cell), [object_mass(arm.cell)]
        h, b = coasting.torques(empty), arm.joint_momenta(empty)
        loaded = h + coasting.torques(thing), b + arm.joint_momenta(thing)
        for (drift, momenta), at in ((loaded, held.may_be_held), ((h, b), held.may_be_gone)):
            models += [drift, drift - momenta * inverse]
            applies += [at(arm.pieces)] * 2
        return _sizes(models, applies, most)

    return rooms


def _grip(held: HeldObject, limit: Array) -> Rooms:
    """Returns what the grip has left while it may hold the object: |a - g|, or its components in the tool."""

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        up = np.array([0.0, 0.0, arm.cell.surroundings.gravity_m_s2])[:, None]
        felt = arm.a_WT + up
        at = held.may_be_held(arm.pieces)
        if len(limit) == 1:
            return _sizes([_square(felt)[None]], [at], (limit[:, None] * (1.0 + SHARE)) ** 2)
        R = arm.R_WT
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
