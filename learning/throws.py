"""Where a planned throw lands if it is released late, faster, from another base, with another drag.

A plan, or what was recorded of it, becomes a table over the release time about the planned one. A landing is then a few
products: the flight without drag has a closed form, and drag counts to first order (0.2 mm off for a sphere of c_d 0.5
at these speeds).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from planner.arrays import Array, Index
from planner.certificate import landing_height, release_flight
from planner.flight import drag_constant, landing_points
from planner.geometry import tool_pose
from planner.kinematics import jacobian
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

STEP_S = 0.001  # [s] of the table: read linearly, 1e-6 m off at 10 m/s^2
REACH_S = 0.14  # [s] release times about the planned one; further off a release is at the table's end
DRAG_STEP = 0.5  # [-] drag coefficient of the secant by which drag counts: about a sphere's
# Rows of the table between two flights with drag, which are integrated: their effect is read linearly between them,
# 0.05 mm off for a sphere at most, a quarter of what counting drag to first order costs.
DRAG_ROWS = 5


@dataclass(frozen=True, eq=False)
class ThrowTable:
    """One throw over m release times, `STEP_S` apart and centred on the planned one.

    Attributes:
        p_WT: positions of the object (m, 3) [m].
        qd: joint velocities (m, 6) [rad/s].
        J: Jacobian of the object's position in the world (m, 3, 6) [m/rad].
        by_drag: change of the landing point by the drag coefficient (m, 2) [m].
        plane_z: height of the landing plane [m].
        gravity: [m/s^2].
        p_WB: base of the arm, about which a base that is turned turns the landing (2,) [m].
        carried: velocity of a target that moves, beside which the landing counts (2,) [m/s].
        flight_s: planned time of flight [s].
    """

    p_WT: Array
    qd: Array
    J: Array
    by_drag: Array
    plane_z: float
    gravity: float
    p_WB: Array
    carried: Array = field(default_factory=lambda: np.zeros(2))
    flight_s: float = 0.0

    def deviated(self, qd: Array) -> ThrowTable:
        """Returns the table of an arm whose speeds are off by `qd` (6,) or (m, 6) [rad/s]."""
        return replace(self, qd=self.qd + qd)

    @property
    def planned(self) -> int:
        """Row of the planned release."""
        return len(self.qd) // 2


def table_times(release_time_s: float) -> Array:
    """Returns the times of a table's rows (m,) [s] on the clock of the release."""
    n = round(REACH_S / STEP_S)
    return np.asarray(release_time_s + STEP_S * np.arange(-n, n + 1), float)


def throw_table(
    problem: ThrowProblem,
    trajectory: Trajectory,
    off: tuple[Array, Array] | None = None,
    beside_target: bool = False,
) -> ThrowTable:
    """Returns the table of a plan; before the motion's start and after its end the arm stands.

    Args:
        problem: of the plan.
        trajectory: of the plan.
        off: by how much the recorded arm differs: positions (m, 6) [rad] and speeds (m, 6) [rad/s] at `table_times`.
        beside_target: whether landings count as a target that moves carries them.
    """
    cell = problem.cell
    q, qd, _ = trajectory.at(table_times(trajectory.release_time_s))
    if off is not None:
        q = q + off[0]
        qd = qd + off[1]
    p = tool_pose(cell, q)[:, :3, 3]
    J = cell.X_WB[:3, :3] @ jacobian(cell.robot, q, cell.tool.X_FT)[:, :3]
    v = (J @ qd[..., None])[..., 0]
    height = landing_height(problem, trajectory)
    by_drag = _effect_of_drag(problem, p, problem.release_speed_factor * v, height)
    table = ThrowTable(p, qd, J, by_drag, height, problem.gravity, cell.X_WB[:2, 3])
    if problem.moving is None or not beside_target:
        return table
    flight = release_flight(problem, trajectory)
    if flight is None:
        return table
    return replace(table, carried=problem.moving.v_W[:2], flight_s=flight.time_of_flight_s)


@dataclass(frozen=True, eq=False)
class BinRim:
    """Where throws pass the rim of their target's bin.

    Attributes:
        table: of the throws to the height of the rim.
        lost_m: by how much less room the rim leaves than the bottom to an object that comes in on a slant [m].
    """

    table: ThrowTable
    lost_m: float


def bin_rim(problem: ThrowProblem, table: ThrowTable) -> BinRim | None:
    """Returns where throws of a table pass the rim of their problem's bin; None without one.

    An object of radius r that falls at an angle a to the plane of the rim keeps clear of it where its centre passes
    r / sin a from it.
    """
    target = problem.target
    if target is None or target.opening is None:
        return None
    height = float(target.p_W[2]) + target.opening.rim_height_m
    v = problem.release_speed_factor * (table.J @ table.qd[..., None])[..., 0]
    table = replace(table, plane_z=height, by_drag=_effect_of_drag(problem, table.p_WT, v, height))
    v_x, v_y, v_z = (v[table.planned] - np.append(table.carried, 0.0)).tolist()
    falls = math.sqrt(max(v_z**2 + 2.0 * problem.gravity * (float(table.p_WT[table.planned, 2]) - height), 0.0))
    slant = math.hypot(v_x, v_y, falls) / max(falls, 1e-9)
    return BinRim(table, problem.cell.object.radius_m * (slant - 1.0))


def _effect_of_drag(problem: ThrowProblem, p: Array, v: Array, height: float) -> Array:
    """Returns the change of the landing point by the drag coefficient (m, 2) [m] of flights from p, v (m, 3).

    Args:
        problem, p, v: as given.
        height: at which they land [m].
    """
    rows = np.arange(len(p))
    thing = problem.cell.object
    flown = rows[::DRAG_ROWS]
    air = (0.0, drag_constant(thing.mass_kg, thing.drag_radius_m, DRAG_STEP))
    without, braked = (landing_points(p[flown], v[flown], height, problem.gravity, k)[:, :2] for k in air)
    effect = np.nan_to_num((braked - without) / DRAG_STEP)
    return np.column_stack([np.interp(rows, flown, axis) for axis in effect.T])


@dataclass(frozen=True, eq=False)
class Circumstances:
    """What differs from the plan, as arrays that broadcast with one another (…, throws).

    Attributes:
        late_s: release after the planned one [s].
        factor: release speed over the tool's [-].
        offset: shift of the base, and with it of every landing (…, throws, 2) [m].
        drag: drag coefficient [-].
        turn: rotation of the base about its vertical [rad].
    """

    late_s: Array
    factor: Array
    offset: Array
    drag: Array
    turn: Array


class Throws:
    """Tables of n throws, side by side."""

    def __init__(self, tables: Sequence[ThrowTable]) -> None:
        self.p = np.stack([table.p_WT for table in tables])
        self.v = np.stack([(table.J @ table.qd[..., None])[..., 0] for table in tables])
        self.by_drag = np.stack([table.by_drag for table in tables])
        self.height = np.array([table.plane_z for table in tables])
        self.gravity = np.array([table.gravity for table in tables])
        self.p_WB = np.stack([table.p_WB for table in tables])
        self.J = np.stack([table.J for table in tables])
        self.carried = np.stack([table.carried for table in tables])
        self.flight_s = np.array([table.flight_s for table in tables])

    def __len__(self) -> int:
        return len(self.p)

    def landings(self, c: Circumstances, dv: Array | float = 0.0) -> Array:
        """Returns the landing points (…, n, 2) [m]; `dv` (…, n, 3) [m/s] is added to the tool's velocity.

        Beside a target that moves they are as it carries them: less its way since the planned landing.

        An object that is thrown so that it never rises to the plane lands below its release.
        """
        i, share = self._rows(c.late_s)
        at = np.arange(len(self))
        p = _between(self.p[at, i], self.p[at, i + 1], share)
        v = np.asarray(c.factor)[..., None] * (_between(self.v[at, i], self.v[at, i + 1], share) + dv)
        height = p[..., 2] - self.height
        t = (v[..., 2] + np.sqrt(np.maximum(v[..., 2] ** 2 + 2.0 * self.gravity * height, 0.0))) / self.gravity
        flat = p[..., :2] + v[..., :2] * np.maximum(t, 0.0)[..., None]
        flat = flat + np.asarray(c.drag)[..., None] * self.by_drag_at(c.late_s)
        flat = self.p_WB + _turned(flat - self.p_WB, c.turn) + c.offset
        if not self.carried.any():
            return flat
        return flat - self.carried * (np.asarray(c.late_s) + t - self.flight_s)[..., None]

    def by_joint_speed(self, late_s: Array, factor: Array) -> Array:
        """Returns the landing's derivatives by the joint velocities (…, n, 2, 6) [m s] at a release time."""
        i, share = self._rows(late_s)
        i = np.where(share > 0.5, i + 1, i)
        at = np.arange(len(self))
        v = np.asarray(factor)[..., None] * self.v[at, i]
        J = np.asarray(factor)[..., None, None] * self.J[at, i]
        height = self.p[at, i][..., 2] - self.height
        root = np.sqrt(np.maximum(v[..., 2] ** 2 + 2.0 * self.gravity * height, 1e-6))
        t = (v[..., 2] + root) / self.gravity
        by_v_z = t / root  # of the flight time
        flat = v[..., :2] - self.carried
        return t[..., None, None] * J[..., :2, :] + (flat * by_v_z[..., None])[..., None] * J[..., 2:, :]

    def by_drag_at(self, late_s: Array) -> Array:
        """Returns the landing's change by the drag coefficient (…, n, 2) [m] at a release time."""
        i, share = self._rows(late_s)
        at = np.arange(len(self))
        return _between(self.by_drag[at, i], self.by_drag[at, i + 1], share)

    def _rows(self, late_s: Array) -> tuple[Index, Array]:
        last = self.p.shape[1] - 1
        at = np.clip(np.asarray(late_s) / STEP_S + last // 2, 0.0, last)
        i = np.minimum(at.astype(np.intp), last - 1)
        return i, at - i


def _between(a: Array, b: Array, share: Array) -> Array:
    return a + share[..., None] * (b - a)


def _turned(flat: Array, angle: Array) -> Array:
    """Returns vectors (…, 2) turned by angles (…) [rad]."""
    c = np.cos(angle)
    s = np.sin(angle)
    x = flat[..., 0]
    y = flat[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)
