"""Masses that the joints move, and bounds on torque, momentum and power between samples that follow from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.cell import Cell, ThrownBody
from planner.certificate.bounds import Rates
from planner.dynamics import WatchedPoint, elbow_points, payload_of, tool_points
from planner.geometry import levers
from planner.native import loops

CELLS_KEPT = 32  # cells whose loads are cached; bounds are kept for the checks of one motion


@dataclass(frozen=True, eq=False)
class Loads:
    """Masses that the joints of a cell move, and bounds on their levers: eight bodies, the links, tool and object.

    Attributes:
        mass: of each body (8,) [kg]; the object's is the last.
        inertia: bound on the moments of inertia of each body about its centre of mass (8,) [kg m^2].
        lever: of each body's centre of mass about each joint (8, 6) [m].
        moment_arm: mass times the arm at which its weight can act on each joint (8, 6) [kg m].
        turned_inertia: of everything that each joint turns, at most (6,) [kg m^2].
        mass_matrix: bounds on the torque of each joint per acceleration of each joint (6, 6) [kg m^2].
    """

    mass: Array
    inertia: Array
    lever: Array
    moment_arm: Array
    turned_inertia: Array
    mass_matrix: Array


@lru_cache(maxsize=CELLS_KEPT)
def loads_of(cell: Cell) -> Loads:
    """Returns the loads of a cell."""
    robot = cell.robot
    tool = payload_of(cell, with_object=False)
    reach = float(np.linalg.norm(cell.tool.X_FT[:3, 3]))
    object_kg = cell.object.mass_kg
    turned_kg_m2 = float(cell.object.inertia_kg_m2.sum()) if isinstance(cell.object, ThrownBody) else 0.0
    hand = 0.5 * float(np.linalg.norm(cell.tool.end_F))
    rows = [
        (link.mass, float(np.linalg.norm(link.com)), i, float(np.trace(link.inertia)))
        for i, link in enumerate(robot.links, start=1)
    ]
    whole = (tool.mass_kg, float(np.linalg.norm(tool.com_F)), 6, float(np.trace(tool.inertia_F)))
    rows += [whole if cell.carried else (tool.mass_kg, hand, 6, 0.0)]
    rows += [(object_kg, reach, 6, turned_kg_m2)]
    lever = np.array([levers(robot, frame, com) for _, com, frame, _ in rows])
    turned = np.array([np.arange(6) < frame for _, _, frame, _ in rows])
    mass = np.array([row[0] for row in rows])
    inertia = np.array([row[3] for row in rows])
    along = np.where(turned, np.abs(robot.d), 0.0)  # offsets along each joint's own axis, which `levers` leaves out
    moment_arm = mass[:, None] * (lever + along)
    both_turned = turned[:, :, None] & turned[:, None, :]
    mass_matrix = moment_arm.T @ lever + np.tensordot(inertia, both_turned, axes=1)
    return Loads(mass, inertia, lever, moment_arm, inertia @ turned, mass_matrix)


class WatchedLevers(NamedTuple):
    """Levers of the points whose speed the controller watches, about each joint (6,) [m]; the elbow's is the longer."""

    tool: Array
    flange: Array
    elbow: Array


@lru_cache(maxsize=CELLS_KEPT)
def watched_levers(cell: Cell) -> WatchedLevers:
    """Returns the levers of a cell's watched points."""

    def lever(point: WatchedPoint) -> Array:
        return levers(cell.robot, point.frame, float(np.linalg.norm(point.place)))

    tool, flange = tool_points(cell)
    return WatchedLevers(lever(tool), lever(flange), np.max([lever(point) for point in elbow_points(cell)], axis=0))


class LoadBounds(NamedTuple):
    """Bounds between the knots on what moves the loads.

    Attributes:
        torque: on the second derivatives of the torques (6, m) [N m/s^2].
        torque_jumps: on the jumps of their slopes inside the intervals (6, m) [N m/s].
        joint_momentum: on M qd with the mass matrix M, on its first and its second derivative (3, 6, m) [N m s, N m,
            N m/s].
        momentum: on the second derivative of the linear momentum (m,) [kg m/s^3].
        power: on the power of all joints, as `kinked_bound` takes them (2, m).
    """

    torque: Array
    torque_jumps: Array
    joint_momentum: Array
    momentum: Array
    power: Array


@lru_cache(maxsize=1)
def load_bounds(loads: Loads, rates: Rates, gravity: float) -> LoadBounds:
    """Returns the bounds on what moves the loads between the knots of `rates`.

    With w1 to w4 bounding the derivatives of any direction in the arm, and V, A, A', A'' those of each centre of mass:

    Torques: tau_j = z_j . sum over links beyond of [r x m (a - g) + d/dt (I w)], so by the product rule
    |tau''| <= sum m r [A'' + 4 w1 A' + 2 (w2 + w1^2) A] + 2 I [w4 + 4 w1 w3 + 2 (w2 + w1^2) w2]. Without joint
    accelerations every term is smaller: the bound holds for gravity and velocity terms alone, too.

    Joint momentum: (M qd)_j = z_j . sum over links beyond of [r x m v + I w], the angular momentum about the axis of
    joint j, so |.|'' <= sum m r [V'' + 4 w1 V' + 2 (w2 + w1^2) V] + I [w3 + 3 w1 w2].

    Power: P = sum of m v . (a - g) + w . I dw/dt over the bodies, the rate of their energy, so
    |P''| <= sum m [A' (A + g) + 2 A A' + V A''] + I [3 w2 w3 + w1 w4]. P' jumps with the jerk by qd . M (jump).

    Args:
        loads: of the cell.
        rates: of the joints over m intervals.
        gravity: [m/s^2].
    """
    bodies = loads.lever, loads.moment_arm, loads.mass, loads.turned_inertia, loads.mass_matrix
    rows = loops.load_bounds((rates.rows, rates.bounds), bodies, float(loads.inertia.sum()), gravity)
    return LoadBounds(rows[:6], rows[6:12], rows[12:30].reshape(3, 6, -1), rows[30], rows[31:])
