"""Aspects: the eight parts into which the arm's singularities divide its joint space.

Wrist, elbow and shoulder are each on one side of their singularity, and near the release they may not change it. So a
solver that moves a release state stays in its aspect; from nearly every state of one it comes to the same motion. The
word is Borrel and Liégeois's (IEEE ICRA 1986, doi 10.1109/ROBOT.1986.1087562).
"""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, Index
from planner.cell import Limits
from planner.kinematics import signed_singularity_distances
from planner.problem import ThrowProblem
from planner.robots import Robot

ASPECTS = 8
BITS = np.array([4, 2, 1])  # of the aspect's number, for the positive sides of wrist, elbow and shoulder
TIMES_S = np.linspace(0.0, 2.0, 201)  # [s] times at which it is asked which sides the arm can have reached


def aspects(robot: Robot, q: Array) -> Index:
    """Returns the numbers (n,) of the aspects in which joint positions `q` (n, 6) lie, 0 to `ASPECTS` - 1."""
    positive = signed_singularity_distances(robot, q) > 0.0
    return np.asarray(positive.astype(np.intp) @ BITS)


def first_rows(aspect: Index) -> Index:
    """Returns the first row of every aspect that occurs in `aspect` (n,), ascending."""
    return np.sort(np.unique(aspect, return_index=True)[1])


def least_times_to_aspects(problem: ThrowProblem) -> Array:
    """Returns a lower bound (8,) [s] on the time from the start to a release in each aspect.

    In a time t every joint alone gets no farther than `farthest`; one that is in motion at the start no farther than
    with the largest acceleration at once. The signed distances are sums of cosines of angles that are sums of joint
    positions, so their largest values within those ranges follow in closed form.
    """
    robot = problem.cell.robot
    start = problem.start
    limits = problem.limits
    d = farthest(TIMES_S, limits).T
    if not problem.starts_at_rest:
        gained = np.outer(abs(problem.start_qd), TIMES_S) + np.outer(limits.qdd_max, TIMES_S**2) / 2.0
        d = np.minimum(np.outer(limits.qd_max, TIMES_S), gained)
    lift, elbow, turn = np.cumsum(start[1:4])
    links = np.array([robot.a[1], robot.a[2], robot.d[4]])
    angles = np.array([lift, elbow, turn - np.pi / 2.0])
    ranges = np.cumsum(d[1:4], axis=0)
    scale = abs(robot.a[1]) + abs(robot.a[2])
    bound = np.zeros(ASPECTS)
    for side in (-1.0, 1.0):
        wrist, elbow = (_largest(side * start[i] - np.pi / 2.0, d[i]) for i in (4, 2))
        phases = np.where(side * links > 0.0, 0.0, np.pi)
        shoulder = sum(
            abs(length) * _largest(angle + phase, reach)
            for length, angle, phase, reach in zip(links, angles, phases, ranges, strict=True)
        )
        for largest, bit in zip((wrist, elbow, shoulder / scale), BITS, strict=True):
            there = (np.arange(ASPECTS) & bit > 0) == (side > 0.0)
            bound[there] = np.maximum(bound[there], _not_before(largest, limits.singularity_distance_min))
    return bound


def farthest(t: Array, limits: Limits) -> Array:
    """Returns bounds (n, 6) [rad] on the way of every joint from rest in the times `t` (n,) [s].

    Full jerk until the limit on acceleration is reached, that until the limit on velocity is, and that.
    """
    v = limits.qd_max
    a = limits.qdd_max
    j = limits.jerk_max
    rise = np.minimum(a / j, np.sqrt(2.0 * v / j))
    top = np.minimum(a, j * rise)
    cruise = np.maximum(rise + (v - j * rise**2 / 2.0) / top, rise)
    first, second, third = (np.clip(t[:, None] - begin, 0.0, None) for begin in (0.0, rise, cruise))
    first = np.minimum(first, rise)
    second = np.minimum(second, cruise - rise)
    return j * first**3 / 6.0 + j * rise**2 / 2.0 * second + top * second**2 / 2.0 + v * third


def _largest(angle: float, half: Array) -> Array:
    """Returns the largest cosine (n,) of angles no farther than `half` (n,) from `angle` [rad]."""
    away = abs((angle + np.pi) % (2.0 * np.pi) - np.pi)
    return np.cos(np.maximum(away - half, 0.0))


def _not_before(largest: Array, least: float) -> float:
    """Returns the last of `TIMES_S` at which a distance's largest values (n,) are below `least`; 0 if none is."""
    below = np.flatnonzero(largest < least)
    return float(TIMES_S[below[-1]]) if len(below) else 0.0
