"""The limits that a joint state at the release has to keep by itself, one after the other: see `SIEVES`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array, Index, Mask
from planner.dynamics import safety_use
from planner.errors import Infeasible, Violation
from planner.geometry import SELF_CLEARANCE_M, barriers
from planner.kinematics import SINGULARITIES, signed_singularity_distances, singularity_distances
from planner.problem import ThrowProblem
from planner.seeds.flight_filter import flight_obstacles
from planner.seeds.turning_room import lack_of_room, no_room
from planner.seeds.velocity_allocation import largest_share

SPEED_SLACK = 1e-9  # [-] rounding allowed in the comparison with a speed limit
POSITION_SLACK = 1e-9  # [rad] rounding allowed in the comparison with a position limit


@dataclass(frozen=True, eq=False)
class States:
    """Joint states at the release.

    Attributes:
        q: positions (n, 6) [rad].
        qd: velocities (n, 6) [rad/s].
        posture: number of the arm's posture in each (n,). States of one posture differ by full turns of joints alone:
            what follows from posture and velocity is calculated once for all of them. None where all are distinct.
    """

    q: Array
    qd: Array
    posture: Index | None = None

    def at(self, rows: Mask | Index | slice) -> States:
        """Returns the states in these rows."""
        return States(self.q[rows], self.qd[rows], None if self.posture is None else self.posture[rows])

    def of_postures(self, function: Callable[[Array], Array]) -> Array:
        """Returns a function of joint positions (k, 6) for every state (n,), calculated once a posture."""
        if self.posture is None:
            return function(self.q)
        row = np.zeros(self.posture.max() + 1, dtype=np.intp)
        row[self.posture] = np.arange(len(self.posture))
        return function(self.q[row])[self.posture]


def _regular(problem: ThrowProblem, states: States) -> Mask:
    """Returns which states (n,) keep the joints' speed limits and the distance from singularities.

    Raises:
        Infeasible: none does; the violation is that of the state closest to the limits.
    """
    excess = largest_share(states.qd, problem.limits.qd_max)
    distance = states.of_postures(lambda q: singularity_distances(problem.cell.robot, q).minimum)
    singular = (distance < problem.limits.singularity_distance_min) & (not problem.ends_at_rest)
    good = (excess <= 1.0 + SPEED_SLACK) & ~singular
    if not good.any():
        raise Infeasible([_closest_violation(problem, states.q, states.qd, excess, distance)])
    return np.asarray(good)


def _unbarred(problem: ThrowProblem, states: States) -> Mask:
    """Returns which states (n,) lie where no self-collision bars every path from the start.

    Raises:
        Infeasible: none does; the violation is that of the first.
    """
    lower = problem.reachable.q_lower
    upper = problem.reachable.q_upper
    barred = np.any((states.q < lower - POSITION_SLACK) | (states.q > upper + POSITION_SLACK), axis=1)
    if barred.all():
        raise Infeasible([_barrier_violation(problem, states.q[0])])
    return np.asarray(~barred)


def _with_room(problem: ThrowProblem, states: States) -> Mask:
    """Returns which states (n,) leave every joint the room to reach its velocity and to lose it.

    All do where the optimiser moves the release, or turns the hand.

    Raises:
        Infeasible: none does; the violation is that of the state that lacks least.
    """
    if not problem.fixes_joints:
        return np.ones(len(states.q), dtype=bool)
    has_room = (lack_of_room(problem, states.q, states.qd) <= 0.0).all(axis=1)
    if not has_room.any():
        raise Infeasible([no_room(problem, states.q, states.qd)])
    return np.asarray(has_room)


def _safe(problem: ThrowProblem, states: States) -> Mask:
    """Returns which states (n,) keep the limits on tool and elbow speed and momentum by themselves.

    Raises:
        Infeasible: none does; the violations are those of the state closest to the limits.
    """
    used = safety_use(problem.cell, problem.limits.tcp_speed_max, states.q, states.qd)
    share = np.max([each.value / each.limit for each in used], axis=0)
    safe = share <= 1.0 + SPEED_SLACK
    if not safe.any():
        best = int(share.argmin())
        rows = ((each, float(each.value[best])) for each in used)
        raise Infeasible(
            [Violation(u.name, v, u.limit, u.unit, detail="at the release") for u, v in rows if v > u.limit]
        )
    return safe


def _barrier_violation(problem: ThrowProblem, q: Array) -> Violation:
    """Returns the self-collision that every path from the start to the posture `q` (6,) passes through."""
    names = problem.cell.robot.joint_names
    cell = problem.cell
    low = np.minimum(problem.start, q)
    high = np.maximum(problem.start, q)
    for barrier in barriers(cell.robot, cell.tool.capsules, cell.surroundings):
        i = barrier.joint
        between = barrier.q[(barrier.q > low[i]) & (barrier.q < high[i])]
        if len(between):
            first = between[np.abs(between - problem.start[i]).argmin()]
            where = f"every path from the start collides where {names[i]} passes {first:.2f} rad"
            detail = f"{', '.join(barrier.names)}: {where}"
            return Violation("self_collision", barrier.distance_m, SELF_CLEARANCE_M, "m", detail=detail)
    raise AssertionError("no barrier lies between")


def _closest_violation(problem: ThrowProblem, q: Array, qd: Array, excess: Array, distance: Array) -> Violation:
    """Returns the limit broken by the state closest to the limits: a joint's speed or a singularity distance."""
    limits = problem.limits
    names = problem.cell.robot.joint_names
    usable = distance >= limits.singularity_distance_min
    if problem.ends_at_rest or usable.any():
        rows = np.flatnonzero(usable) if usable.any() else np.arange(len(q))
        best = int(rows[excess[rows].argmin()])
        joint = int((np.abs(qd[best]) / limits.qd_max).argmax())
        speed = float(abs(qd[best, joint]))
        limit = float(limits.qd_max[joint])
        obstacles = flight_obstacles(problem)
        throw = f" of the throw clear of {', '.join(obstacles)} that asks least of the joints" if obstacles else ""
        return Violation("joint_velocity", speed, limit, "rad/s", detail=f"{names[joint]} at the release{throw}")
    distances = np.abs(signed_singularity_distances(problem.cell.robot, q[int(distance.argmax())]))
    detail = f"{SINGULARITIES[int(distances.argmin())]} singularity at the release"
    limit = limits.singularity_distance_min
    return Violation("singularity_distance", float(distances.min()), limit, "1", detail=detail)


# What states have to keep, in words after their number, each asked of those that are left; their clearance comes last.
SIEVES: tuple[tuple[str, Callable[[ThrowProblem, States], Mask]], ...] = (
    ("within the limits on joint speed and singularity distance", _regular),
    ("reachable without self-collision", _unbarred),
    ("with room to get up to speed and to stop", _with_room),
    ("within the limits on tool and elbow speed and momentum", _safe),
)
