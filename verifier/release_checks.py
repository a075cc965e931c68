"""Checks of the state in which the object leaves."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from planner.cell import Cell
from verifier.arm import ArmPieces
from verifier.elementary import Array
from verifier.finding import Finding, judged
from verifier.pieces import instant
from verifier.plan_document import Demands, SampledMotion
from verifier.request_checks import quaternion
from verifier.taylor import TaylorModel, dot

CHECKS = ("release_position", "release_velocity")
PLACE = 2e-5  # [m, rad] of a release; an arm of UR repeats its places to 3e-5 m. source: Universal Robots, data sheets
SPEED = 2e-4  # [m/s, rad/s] of a release: a fifth of a millimetre in a flight of a second
SHARE = 1e-6  # [-] of a limit


def release_findings(cell: Cell, motion: SampledMotion, demands: Demands) -> Iterator[Finding]:
    """Returns the findings about the state at the release."""
    if motion.release is None or not demands.kind:
        return
    yield from state_findings(cell, motion, demands, demands.release, motion.release, CHECKS)


def state_findings(
    cell: Cell,
    motion: SampledMotion,
    demands: Demands,
    asked: Mapping[str, Any],
    index: int,
    names: tuple[str, str],
    of: str = "",
) -> Iterator[Finding]:
    """Returns the findings about a state that is asked for at a sample.

    Args:
        cell: the cell.
        motion: the motion.
        demands: of its request.
        asked: the state, as the request has it.
        index: of the sample.
        names: of the checks of its place and of its velocity.
        of: begin of the details.
    """
    for name, off, allowed, detail in _deviations(cell, motion, demands, asked, index, names):
        least = allowed - float(np.max(off.upper if isinstance(off, TaylorModel) else off))
        most = allowed - float(np.max(off.lower if isinstance(off, TaylorModel) else off))
        yield judged(name, least, most, index / motion.rate_hz, of + detail)


def _deviations(
    cell: Cell, motion: SampledMotion, demands: Demands, asked: Mapping[str, Any], k: int, names: tuple[str, str]
) -> Iterator[tuple[str, TaylorModel | Array, float, str]]:
    """Returns check, deviation, what is allowed of it, and what it is of; squares of lengths."""
    arm = ArmPieces(cell, instant(motion, k))
    place, velocity = names
    kind = asked["kind"]
    if kind == "joint":
        yield place, np.abs(motion.q[k] - np.asarray(asked["positions"])), PLACE, "a joint's position"
        yield velocity, np.abs(motion.qd[k] - np.asarray(asked["velocities"])), SPEED, "a joint's velocity"
    elif kind == "point":
        yield place, _square(arm.p_WT - demands.place(asked["position"])[:, None]), PLACE**2, "squared, in m"
        yield velocity, _square(arm.v_WT - demands.direction(asked["velocity"])[:, None]), SPEED**2, "squared, in m/s"
    elif kind == "pose":
        X, V = asked["pose"], asked["twist"]
        R = demands.R_WR @ orientation(X)
        apart = arm.R_WT - R[:, :, None]
        turn = dot(apart[:, 0], apart[:, 0]) + dot(apart[:, 1], apart[:, 1]) + dot(apart[:, 2], apart[:, 2])
        w = arm.turning[6][0] - demands.direction(V["angular"])[:, None]
        yield place, _square(arm.p_WT - demands.place(X["position"])[:, None]), PLACE**2, "squared, in m"
        # Turned by an angle, a matrix is 2 sqrt(2) sin(angle / 2) away in the sum of squares.
        yield place, turn, 2.0 * PLACE**2, "orientation: twice the squared angle"
        yield velocity, _square(arm.v_WT - demands.direction(V["linear"])[:, None]), SPEED**2, "squared, in m/s"
        yield velocity, _square(w), SPEED**2, "squared, in rad/s"
    else:
        yield from _of_target(arm, demands)


def _of_target(arm: ArmPieces, demands: Demands) -> Iterator[tuple[str, TaylorModel | Array, float, str]]:
    """Returns the deviations from what a target says of the release itself."""
    asked = demands.release
    assert demands.aim is not None
    place, velocity = CHECKS
    if (given := asked.get("release_position")) is not None:
        yield place, _square(arm.p_WT - demands.place(given)[:, None]), PLACE**2, "squared, in m"
    elif (least := float(asked.get("min_horizontal_distance_m") or 0.0)) > 0.0:
        apart = (arm.p_WT - demands.aim.p_W[:, None])[:2]
        off = apart[0] * apart[0] + apart[1] * apart[1]
        yield place, -off, -((least * (1.0 - SHARE)) ** 2), "squared horizontal distance to the target, in m"
    v = arm.v_WT
    if (most := asked.get("max_release_speed_m_s")) is not None:
        yield velocity, _square(v), (float(most) + SPEED) ** 2, "squared speed, in m/s"
    level = (v[0] * v[0] + v[1] * v[1]).square_root()
    for key, sign in (("min_elevation_rad", -1.0), ("max_elevation_rad", 1.0)):
        limit = asked.get(key)
        if limit is not None and sign * float(limit) < math.pi / 2:  # beyond that every throw is allowed
            # Above the line of that elevation v_z cos - |v_xy| sin is positive; over the speed it is the angle's sine.
            above = v[2] * math.cos(float(limit)) - level * math.sin(float(limit))
            speed = float(np.sqrt(_square(v).upper.max()))
            yield velocity, above * sign, SPEED * speed, "across the elevation asked for, in m/s"


def _square(x: TaylorModel) -> TaylorModel:
    return dot(x, x)


def orientation(pose: Any) -> Array:
    """Returns the rotation (3, 3) of a pose, by its quaternion or by its rotation vector."""
    x, y, z, w = quaternion(pose)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
