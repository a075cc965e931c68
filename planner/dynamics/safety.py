"""The arm's own safety limits: the quantities that its controller watches, at joint states.

Source of the definitions: Universal Robots, user manuals of the e-Series ("Configurable safety functions") and of CB3
("General limits"); docs/safety-limits.md has them with what is not published.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.cell import Cell
from planner.dynamics.inverse_dynamics import Bodies, bodies, payload_of
from planner.geometry import arm_capsules
from planner.kinematics import LinkMotion, link_poses
from planner.native import loops

CELLS_KEPT = 32  # cells whose bodies are cached


class WatchedPoint(NamedTuple):
    """A point of the arm whose speed the controller watches: name, DH frame it moves with, place in it (3,) [m]."""

    name: str
    frame: int
    place: Array


@lru_cache(maxsize=CELLS_KEPT)
def tool_points(cell: Cell) -> tuple[WatchedPoint, WatchedPoint]:
    """Returns the points of the tool speed: the tool centre point and the flange's centre."""
    return WatchedPoint("tool centre point", 6, cell.tool.X_FT[:3, 3]), WatchedPoint("flange", 6, np.zeros(3))


@lru_cache(maxsize=CELLS_KEPT)
def elbow_points(cell: Cell) -> tuple[WatchedPoint, WatchedPoint]:
    """Returns both ends of the elbow's housing on the elbow joint's axis: no point between them is faster than both.

    Which point of the elbow the controller watches is not published.
    """
    elbow = next(capsule for capsule in arm_capsules(cell.robot) if capsule.name == "elbow")
    return WatchedPoint("elbow", elbow.frame, elbow.p0), WatchedPoint("elbow", elbow.frame, elbow.p1)


@lru_cache(maxsize=CELLS_KEPT)
def empty_bodies(cell: Cell) -> Bodies:
    """Returns the links of a cell's arm with its tool, without the object."""
    return bodies(cell.robot, payload_of(cell, with_object=False))


@lru_cache(maxsize=CELLS_KEPT)
def loaded_bodies(cell: Cell) -> Bodies:
    """Returns the links of a cell's arm with its tool and the held object."""
    return bodies(cell.robot, payload_of(cell, with_object=True))


def point_velocity(chain: LinkMotion, point: WatchedPoint) -> Array:
    """Returns velocities (3, N) [m/s] of a point of the arm: those of the flange if no joint beyond it moved."""
    X = chain.X[:, point.frame, :3]
    moving = np.arange(chain.qd.shape[1]) < point.frame
    place = X[:, :, :3] @ point.place + X[:, :, 3]
    return LinkMotion(chain.X, chain.qd * moving, chain.qdd).velocity(place.T)


def fastest(chain: LinkMotion, points: tuple[WatchedPoint, ...]) -> Array:
    """Returns the speed (N,) [m/s] of the fastest of some points."""
    _, frames, places = zip(*points, strict=True)
    return loops.fastest(chain.X, chain.qd, np.array(frames), np.array(places))


def momentum(chain: LinkMotion, carried: Bodies) -> Array:
    """Returns the linear momentum (3, N) [kg m/s] of the bodies: the sum of mass times velocity."""
    return loops.momentum(chain.X, chain.qd, carried.mass, carried.fixed[0])


class Use(NamedTuple):
    """What n joint states use of a limit: name of the check, values (n,), limit, unit."""

    name: str
    value: Array
    limit: float
    unit: str


def safety_use(cell: Cell, tcp_speed_max: float, q: Array, qd: Array) -> list[Use]:
    """Returns what joint states use of the limits that depend on position and velocity alone.

    They are `tcp_speed`, and where the cell limits them that of the flange, `elbow_speed` and `momentum`, with the
    object held. No motion through a state beyond one of them keeps it.

    Args:
        cell: the robot station.
        tcp_speed_max: limit on the tool's speed [m/s].
        q: joint positions (n, 6) [rad].
        qd: joint velocities (n, 6) [rad/s].
    """
    safety = cell.safety
    chain = LinkMotion(link_poses(cell.robot, q), qd, np.zeros_like(qd))
    tool, flange = tool_points(cell)
    v_T = point_velocity(chain, tool)
    used = [Use("tcp_speed", _norm(v_T), tcp_speed_max, "m/s")]
    if safety.tool_speed_m_s is not None:
        used.append(Use("tcp_speed", fastest(chain, (flange,)), safety.tool_speed_m_s, "m/s"))
    if safety.elbow_speed_m_s is not None:
        used.append(Use("elbow_speed", fastest(chain, elbow_points(cell)), safety.elbow_speed_m_s, "m/s"))
    if safety.momentum_kg_m_s is not None:
        held = momentum(chain, empty_bodies(cell)) + cell.object.mass_kg * v_T
        used.append(Use("momentum", _norm(held), safety.momentum_kg_m_s, "kg m/s"))
    return used


def _norm(v: Array) -> Array:
    """Returns the lengths (N,) of vectors (3, N)."""
    return np.sqrt((v * v).sum(axis=0))
