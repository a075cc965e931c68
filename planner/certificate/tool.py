"""Checks of the tool's speed, the distance to singularities near the release, and the joint torques."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.certificate.bounds import (
    Rates,
    curvature_bound,
    levers,
    point_acceleration,
    point_jerk,
    point_snap,
    prove_above,
)
from planner.certificate.check import Check, at_least, at_most
from planner.certificate.motion import Motion
from planner.dynamics import Payload, joint_torques
from planner.kinematics import SINGULARITIES, signed_singularity_distances

Vector = NDArray[np.float64]
Index = NDArray[np.intp]

SINGULARITY_WINDOW_S = 0.05  # [s] around the release, in which Cartesian motion must stay controllable


def tcp_speed(motion: Motion) -> Check:
    """The tool centre point never exceeds the cell's speed."""
    problem, trajectory = motion.problem, motion.trajectory
    cell, limit = problem.cell, problem.limits.tcp_speed_max

    def room(X_WL: Vector, qd: Vector) -> Vector:
        p_WT = X_WL[:, 6, :3, :3] @ cell.tool.X_FT[:3, 3] + X_WL[:, 6, :3, 3]
        turns = np.cross(X_WL[:, :6, :3, 2], p_WT[:, None] - X_WL[:, :6, :3, 3])
        return limit - np.linalg.norm((turns * qd[..., None]).sum(axis=1), axis=-1)

    def evaluate(t: Vector, item: Index) -> Vector:
        return room(motion.poses_at(t), trajectory.at(t)[1])

    lever = levers(cell.robot, 6, float(np.linalg.norm(cell.tool.X_FT[:3, 3])))
    rates = point_jerk(lever, motion.rates)[:, None]
    values = room(motion.X_WL, trajectory.qd[motion.knots])[:, None]
    # |v| lies below the chord of the vectors' ends plus their deviation from it, so the curvature bound of v serves.
    proof = prove_above(evaluate, motion.t, values, rates, -limit * 1e-7, curvature_bound)
    check = at_most("tcp_speed", limit - proof.value, limit, "m/s", proof.at_s)
    return check if proof.proven else Check(**{**check.__dict__, "ok": False})


def singularity_distance(motion: Motion) -> Check | None:
    """Around the release the arm keeps its distance to all three singularities; None for a move that ends at rest."""
    problem, trajectory = motion.problem, motion.trajectory
    if problem.ends_at_rest:
        return None
    required = problem.limits.singularity_distance_min
    reach = round(SINGULARITY_WINDOW_S * trajectory.sample_rate_hz)
    first, last = max(0, trajectory.release_index - reach), min(len(trajectory.q) - 1, trajectory.release_index + reach)
    rows = motion.knots[(motion.knots >= first) & (motion.knots <= last)]
    rows = np.unique(np.concatenate([[first], rows, [last]]))

    def distances(q: Vector) -> Vector:
        return np.abs(signed_singularity_distances(problem.cell.robot, q))

    def evaluate(t: Vector, item: Index) -> Vector:
        return distances(trajectory.at(t)[0])[np.arange(len(t)), item]

    rates = _singularity_rates(motion, motion.tick_rates.between(rows))
    proof = prove_above(evaluate, trajectory.t[rows], distances(trajectory.q[rows]), rates, required, curvature_bound)
    check = at_least("singularity_distance", proof.value, required, "1", proof.at_s, SINGULARITIES[proof.item])
    return check if proof.proven else Check(**{**check.__dict__, "ok": False})


def _singularity_rates(motion: Motion, rates: Rates) -> Vector:
    """Returns sup |f''| of the three distances (k, 3): two sines, and a horizontal offset over the arm's length."""
    robot, qd, qdd = motion.problem.cell.robot, rates.qd, rates.qdd
    length = abs(robot.a[1]) + abs(robot.a[2])
    turn = [np.cumsum(x[:, 1:4], axis=1) for x in (qd, qdd)]  # of upper arm, forearm, wrist in the arm's plane
    parts = np.abs([robot.a[1], robot.a[2], robot.d[4]]) / length
    shoulder = (turn[0] ** 2 + turn[1]) @ parts
    return np.stack([qd[:, 4] ** 2 + qdd[:, 4], qd[:, 2] ** 2 + qdd[:, 2], shoulder], axis=-1)


def joint_torque(motion: Motion) -> Check:
    """No joint needs more torque than allowed, with tool and, until the release, the object."""
    problem, trajectory = motion.problem, motion.trajectory
    limit = problem.limits.tau_max
    held = payload_of(motion, with_object=True)
    empty = payload_of(motion, with_object=False)
    released_s = np.inf if problem.ends_at_rest else trajectory.release_time_s

    def room(t: Vector, state: tuple[Vector, Vector, Vector]) -> Vector:
        gravity_B = problem.cell.X_WB[:3, :3].T @ np.array([0.0, 0.0, -problem.gravity])
        before, after = t <= released_s, t >= released_s
        tau = np.zeros((len(t), 6))
        for rows, payload in ((before, held), (after, empty)):
            q, qd, qdd = (x[rows] for x in state)
            tau[rows] = np.maximum(tau[rows], np.abs(joint_torques(problem.cell.robot, q, qd, qdd, gravity_B, payload)))
        return 1.0 - tau / limit

    def evaluate(t: Vector, item: Index) -> Vector:
        return room(t, trajectory.at(t))[np.arange(len(t)), item]

    rows = motion.knots
    values = room(motion.t, (trajectory.q[rows], trajectory.qd[rows], trajectory.qdd[rows]))
    rates = _torque_curvature(motion, held) / limit
    proof = prove_above(evaluate, motion.t, values, rates, 0.0, curvature_bound)
    worst, name = float(limit[proof.item]), problem.cell.robot.joint_names[proof.item]
    check = at_most("joint_torque", (1.0 - proof.value) * worst, worst, "N m", proof.at_s, name)
    return check if proof.proven else Check(**{**check.__dict__, "ok": False})


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


def _torque_curvature(motion: Motion, payload: Payload) -> Vector:
    """Returns sup |tau''| of every joint between the knots (m-1, 6) [N m/s^2].

    tau_j = z_j . sum over links beyond of [r x m (a - g) + d/dt (I w)]; by the product rule, with S1, S2, S3 the sums
    of |qd|, |qdd|, |jerk| and w1 = S1, w2 = S2 + S1^2 bounding the first two derivatives of any turning direction:
    |tau''| <= sum m r [A'' + 4 w1 A' + 2 (w2 + w1^2) A] + 2 I [w4 + 4 w1 w3 + 2 (w2 + w1^2) w2].
    """
    robot, rates = motion.problem.cell.robot, motion.rates
    w1, w2, w3, w4 = _turning(rates)
    total = np.zeros((len(w1), 6))
    for mass, com, frame, inertia in _masses(motion, payload):
        lever = levers(robot, frame, com)
        a = point_acceleration(lever, rates) + motion.problem.gravity
        force = point_snap(lever, rates) + 4.0 * w1 * point_jerk(lever, rates) + 2.0 * (w2 + w1**2) * a
        spin = 2.0 * inertia * (w4 + 4.0 * w1 * w3 + 2.0 * (w2 + w1**2) * w2)
        reaches = np.arange(6) < frame
        total += mass * force[:, None] * (lever + _along_axis(robot.d, frame)) + spin[:, None] * reaches
    return total


def _along_axis(d: Vector, frame: int) -> Vector:
    """Returns the offsets (6,) along each joint's own axis that `levers` leaves out; a moment arm counts them."""
    return np.where(np.arange(6) < frame, np.abs(d), 0.0)


def _turning(rates: Rates) -> tuple[Vector, Vector, Vector, Vector]:
    s1, s2, s3 = rates.totals
    return s1, s2 + s1**2, s3 + 3 * s1 * s2 + s1**3, 4 * s1 * s3 + 3 * s2**2 + 6 * s1**2 * s2 + s1**4


def _masses(motion: Motion, payload: Payload) -> list[tuple[float, float, int, float]]:
    """Returns mass [kg], its centre's distance from its frame [m], DH frame, largest inertia [kg m^2] of every body."""
    bodies = [
        (link.mass, float(np.linalg.norm(link.com)), i, float(np.trace(link.inertia)))
        for i, link in enumerate(motion.problem.cell.robot.links, start=1)
    ]
    load = (payload.mass_kg, float(np.linalg.norm(payload.com_F)), 6, float(np.trace(payload.inertia_F)))
    return [*bodies, load]
