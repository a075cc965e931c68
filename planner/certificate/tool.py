"""Checks of the tool's speed, the distance to singularities near the release, and the joint torques."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.certificate.bounds import (
    Rates,
    curvature_bound,
    jerk_jumps,
    joint_rates,
    kinked_bound,
    point_acceleration,
    point_jerk,
    point_snap,
    prove_above,
)
from planner.certificate.check import Check, at_least, at_most
from planner.certificate.loads import Loads, loads_of
from planner.certificate.motion import Look, Motion
from planner.certificate.shapes import shapes_of
from planner.dynamics import Payload, chain_torques
from planner.kinematics import SINGULARITIES, signed_singularity_distances
from planner.robots import Robot

Vector = NDArray[np.float64]
Index = NDArray[np.intp]

SINGULARITY_WINDOW_S = 0.05  # [s] around the release, in which Cartesian motion must stay controllable


def tcp_speed(motion: Motion) -> Check:
    """The tool centre point never exceeds the cell's speed."""
    limit = motion.problem.limits.tcp_speed_max

    def room(look: Look) -> Vector:
        v = look.v_WT
        return limit - np.sqrt((v * v).sum(axis=0))

    def evaluate(t: Vector, item: Index) -> Vector:
        return room(motion.look_at(t))

    rates = point_jerk(shapes_of(motion.problem.cell).tool_lever, motion.rates)
    # |v| lies below the chord of the vectors' ends plus their deviation from it, so the curvature bound of v serves.
    proof = prove_above(evaluate, motion.look.t, room(motion.look)[None], rates, -limit * 1e-7, curvature_bound)
    check = at_most("tcp_speed", limit - proof.value, limit, "m/s", proof.at_s)
    return check if proof.proven else replace(check, ok=False)


def singularity_distance(motion: Motion) -> Check | None:
    """Around the release the arm keeps its distance to all three singularities; None for a move that ends at rest."""
    problem, trajectory = motion.problem, motion.trajectory
    if problem.ends_at_rest:
        return None
    required, robot = problem.limits.singularity_distance_min, problem.cell.robot
    reach = round(SINGULARITY_WINDOW_S * trajectory.sample_rate_hz)
    first, last = max(0, trajectory.release_index - reach), min(len(trajectory.q) - 1, trajectory.release_index + reach)
    rows = motion.knots[(motion.knots > first) & (motion.knots < last)]
    rows = np.concatenate([[first], rows, [last]])

    def distances(q: Vector) -> Vector:
        return np.abs(signed_singularity_distances(robot, q)).T

    def evaluate(t: Vector, item: Index) -> Vector:
        return distances(trajectory.at(t)[0])[item, np.arange(len(t))]

    rates = _singularity_rates(robot, joint_rates(trajectory, rows))
    proof = prove_above(evaluate, trajectory.t[rows], distances(trajectory.q[rows]), rates, required, curvature_bound)
    check = at_least("singularity_distance", proof.value, required, "1", proof.at_s, SINGULARITIES[proof.item])
    return check if proof.proven else replace(check, ok=False)


def _singularity_rates(robot: Robot, rates: Rates) -> Vector:
    """Returns sup |f''| of the three distances (3, m): two sines, and a horizontal offset over the arm's length."""
    length = abs(robot.a[1]) + abs(robot.a[2])
    sines = rates.qd[[4, 2]] ** 2 + rates.qdd[[4, 2]]
    speed, acceleration = rates.sums[:2, 1:4] - rates.sums[:2, :1]  # of upper arm, forearm, wrist in the arm's plane
    shoulder = np.abs([robot.a[1], robot.a[2], robot.d[4]]) / length @ (speed**2 + acceleration)
    return np.concatenate([sines, shoulder[None]])


def joint_torque(motion: Motion) -> Check:
    """No joint needs more torque than allowed, with tool and, until the release, the object."""
    problem, loads = motion.problem, loads_of(motion.problem.cell)
    limit, p_FT = problem.limits.tau_max, problem.cell.tool.X_FT[:3, 3]
    down = np.array([0.0, 0.0, -problem.gravity])

    def room(look: Look) -> Vector:
        empty, one_kilogram = chain_torques(look.links, loads.empty, down, p_FT)
        held = np.abs(empty + loads.thing_kg * one_kilogram)
        empty = np.abs(empty)
        tau = np.where(
            look.t < motion.released_s, held, np.where(look.t > motion.released_s, empty, np.maximum(held, empty))
        )
        return 1.0 - tau / limit[:, None]

    def evaluate(t: Vector, item: Index) -> Vector:
        return room(motion.look_at(t))[item, np.arange(len(t))]

    # The torque's slope jumps where the jerk does.
    jumps = loads.mass_matrix @ jerk_jumps(motion.trajectory, motion.knots)
    rates = np.stack([_torque_curvature(loads, motion.rates, problem.gravity), jumps]) / limit[:, None]
    proof = prove_above(evaluate, motion.look.t, room(motion.look), rates, 0.0, kinked_bound)
    worst, name = float(limit[proof.item]), problem.cell.robot.joint_names[proof.item]
    check = at_most("joint_torque", (1.0 - proof.value) * worst, worst, "N m", proof.at_s, name)
    return check if proof.proven else replace(check, ok=False)


def payload_of(motion: Motion, with_object: bool) -> Payload:
    """Returns tool (its mass half way to the tool centre point) and, where asked, the object at that point."""
    cell = motion.problem.cell
    p_FT = cell.tool.X_FT[:3, 3]
    thing = cell.object.mass_kg if with_object else 0.0
    mass = cell.tool.mass_kg + thing
    com = (0.5 * cell.tool.mass_kg + thing) / mass * p_FT if mass > 0.0 else np.zeros(3)
    apart = cell.tool.mass_kg * thing / mass * 0.25 if mass > 0.0 else 0.0
    inertia = apart * (p_FT @ p_FT * np.eye(3) - np.outer(p_FT, p_FT))
    return Payload(mass_kg=mass, com_F=com, inertia_F=inertia)


def _torque_curvature(loads: Loads, rates: Rates, gravity: float) -> Vector:
    """Returns sup |tau''| of every joint between the knots (6, m) [N m/s^2], the ticks' ends aside.

    tau_j = z_j . sum over links beyond of [r x m (a - g) + d/dt (I w)]; by the product rule, with w1 to w4 bounding the
    derivatives of any turning direction:
    |tau''| <= sum m r [A'' + 4 w1 A' + 2 (w2 + w1^2) A] + 2 I [w4 + 4 w1 w3 + 2 (w2 + w1^2) w2].
    """
    w1, w2, w3, w4 = rates.turning
    twice = 2.0 * (w2 + w1 * w1)
    a = point_acceleration(loads.lever, rates) + gravity
    force = point_snap(loads.lever, rates) + 4.0 * w1 * point_jerk(loads.lever, rates) + twice * a
    return loads.moment_arm.T @ force + np.outer(loads.inertia, 2.0 * (w4 + 4.0 * w1 * w3 + twice * w2))
