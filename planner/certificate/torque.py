"""Check of the joint torques, with tool and held object, and its bound between samples."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from planner.arrays import Array, Index
from planner.cell import Cell
from planner.certificate.bounds import Rates, jerk_jumps, kinked_bound, point_bound, prove_above
from planner.certificate.certificate import Check, at_most
from planner.certificate.samples import ArmSamples, MotionSamples
from planner.dynamics import Bodies, bodies, chain_torques, payload_of
from planner.geometry import levers

CELLS_KEPT = 32  # cells whose loads are cached


@dataclass(frozen=True, eq=False)
class Loads:
    """Masses that the joints of a cell move, and bounds on their levers: eight bodies, the links, tool and object.

    Attributes:
        empty: the links with the tool.
        object_kg: mass of the object, at the tool centre point until the release [kg].
        lever: of each body's centre of mass about each joint (8, 6) [m].
        moment_arm: mass times the arm at which its weight can act on each joint (8, 6) [kg m].
        inertia: of everything that each joint turns, at most (6,) [kg m^2].
        mass_matrix: bounds on the torque of each joint per acceleration of each joint (6, 6) [kg m^2].
    """

    empty: Bodies
    object_kg: float
    lever: Array
    moment_arm: Array
    inertia: Array
    mass_matrix: Array


@lru_cache(maxsize=CELLS_KEPT)
def loads_of(cell: Cell) -> Loads:
    """Returns the loads of a cell."""
    robot, tool = cell.robot, payload_of(cell, with_object=False)
    reach, object_kg = float(np.linalg.norm(cell.tool.X_FT[:3, 3])), cell.object.mass_kg
    rows = [
        (link.mass, float(np.linalg.norm(link.com)), i, float(np.trace(link.inertia)))
        for i, link in enumerate(robot.links, start=1)
    ]
    rows += [(tool.mass_kg, 0.5 * reach, 6, 0.0), (object_kg, reach, 6, 0.0)]
    lever = np.array([levers(robot, frame, com) for _, com, frame, _ in rows])
    turned = np.array([np.arange(6) < frame for _, _, frame, _ in rows])
    mass, inertia = np.array([row[0] for row in rows]), np.array([row[3] for row in rows])
    along = np.where(turned, np.abs(robot.d), 0.0)  # offsets along each joint's own axis, which `levers` leaves out
    moment_arm = mass[:, None] * (lever + along)
    both_turned = turned[:, :, None] & turned[:, None, :]
    mass_matrix = moment_arm.T @ lever + np.tensordot(inertia, both_turned, axes=1)
    return Loads(bodies(robot, tool), object_kg, lever, moment_arm, inertia @ turned, mass_matrix)


def joint_torque(motion: MotionSamples) -> Check:
    """Checks that no joint needs more torque than allowed, with the tool and the object while it may be held.

    Within the release window the object may be held or gone: both are checked.
    """
    problem, loads = motion.problem, loads_of(motion.problem.cell)
    limit, p_FT = problem.limits.tau_max, problem.cell.tool.X_FT[:3, 3]
    gravity_W = np.array([0.0, 0.0, -problem.gravity])

    def room(arm: ArmSamples) -> Array:
        empty, per_kilogram = chain_torques(arm.links, loads.empty, gravity_W, p_FT)
        held = np.abs(empty + loads.object_kg * per_kilogram)
        empty = np.abs(empty)
        before, after = arm.t < motion.gone_from_s, arm.t > motion.held_until_s
        tau = np.where(before, held, np.where(after, empty, np.maximum(held, empty)))
        return 1.0 - tau / limit[:, None]

    def evaluate(t: Array, item: Index) -> Array:
        return room(motion.at(t))[item, np.arange(len(t))]

    # The slope of the torque jumps where the jerk does.
    jumps = loads.mass_matrix @ jerk_jumps(motion.trajectory, motion.knots)
    rates = np.stack([_torque_curvature(loads, motion.rates, problem.gravity), jumps]) / limit[:, None]
    proof = prove_above(evaluate, motion.at_knots.t, room(motion.at_knots), rates, 0.0, kinked_bound)
    bound, name = float(limit[proof.item]), problem.cell.robot.joint_names[proof.item]
    value = (1.0 - proof.value) * bound
    return at_most("joint_torque", value, bound, "N m", proof.at_s, name).provided(proof.proven)


def _torque_curvature(loads: Loads, rates: Rates, gravity: float) -> Array:
    """Returns sup |tau''| of every joint between the knots (6, m) [N m/s^2], apart from the ends of ticks.

    tau_j = z_j . sum over links beyond of [r x m (a - g) + d/dt (I w)]; by the product rule, with w1 to w4 bounding the
    derivatives of any direction in the arm:
    |tau''| <= sum m r [A'' + 4 w1 A' + 2 (w2 + w1^2) A] + 2 I [w4 + 4 w1 w3 + 2 (w2 + w1^2) w2].
    """
    w1, w2, w3, w4 = (total[-1] for total in rates.totals)
    twice = 2.0 * (w2 + w1 * w1)
    acceleration, jerk, snap = (point_bound(loads.lever, rates, derivative) for derivative in (2, 3, 4))
    force = snap + 4.0 * w1 * jerk + twice * (acceleration + gravity)
    return loads.moment_arm.T @ force + np.outer(loads.inertia, 2.0 * (w4 + 4.0 * w1 * w3 + twice * w2))
