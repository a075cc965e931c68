"""The fastest timing of a path within the limits on velocity, acceleration, torque and tool speed, by TOPP-RA.

On a path q(s) with s(t): qd = q' s' and qdd = q' s'' + q'' s'^2; the torque is linear in (s'', s'^2) in the same way.
So every limit is a pair of straight lines in that plane at every s. TOPP-RA passes over the path backward and forward.
Source: Pham and Pham, A new approach to time-optimal path parameterization based on reachability analysis, IEEE
Transactions on Robotics 34 (2018).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import partial
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from planner.backends.toppra_path.paths import Derivatives, Path, Vector
from planner.cell import Cell, Limits
from planner.dynamics import gravity_in_base, joint_torques, payload_of
from planner.errors import BackendUnavailable, SolverFailed
from planner.kinematics import jacobian

GRID = 100  # intervals of a path with one path acceleration each
LIMIT_SHARE = 0.999  # [-] of the limits on velocity and acceleration; the rest is for the motion between grid points
TORQUE_SHARE = 0.97  # [-] of the torque limits; the rest also covers the averaging, which may raise a torque
SLOWEST = 1e-4  # [-] share of the limits below which a path does not bound the path speed


@dataclass(frozen=True, eq=False)
class PathTiming:
    """Timing of a path, with one path acceleration between neighbouring grid points.

    Attributes:
        path: the timed path.
        s: grid points (N+1,).
        speed: path speeds ds/dt at the grid points (N+1,).
        t: times of the grid points (N+1,) [s].
    """

    path: Path
    s: Vector
    speed: Vector
    t: Vector

    @property
    def duration_s(self) -> float:
        """Time of the last grid point [s]."""
        return float(self.t[-1])

    def velocities(self, t: Vector) -> Vector:
        """Returns joint velocities (k, 6) [rad/s] at times `t` (k,) in [0, duration] [s]."""
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        tau = t - self.t[i]
        slope = (self.speed[i + 1] - self.speed[i]) / (self.t[i + 1] - self.t[i])
        s = np.clip(self.s[i] + tau * (self.speed[i] + tau * slope / 2.0), self.s[0], self.s[-1])
        return self.path.at(s)[1] * (self.speed[i] + tau * slope)[:, None]


def fastest_timing(
    path: Path, cell: Cell, limits: Limits, ends: tuple[float, float], carrying: bool = True
) -> PathTiming:
    """Returns the fastest timing of the whole path with given path speeds at its ends.

    Args:
        path: to be timed.
        cell: gives the arm, and the masses of tool and object.
        limits: on joint velocity, acceleration, torque and tool speed.
        ends: path speed ds/dt at begin and end.
        carrying: whether the gripper holds the object.

    Raises:
        SolverFailed: no timing keeps the limits with these end speeds.
        BackendUnavailable: toppra is not installed.
    """
    toppra = toppra_module()
    s = np.linspace(path.begin, path.end, GRID + 1)
    algorithm = _algorithm(toppra, _constraint(toppra, path.at(s), cell, limits, ends, carrying), s)
    _, speed, _ = algorithm.compute_parameterization(*ends)
    if speed is None or np.isnan(speed).any():
        raise SolverFailed("no timing of the path keeps the limits and has the release's speed at its end")
    with np.errstate(divide="ignore"):
        steps = 2.0 * np.diff(s) / (speed[1:] + speed[:-1])
    if not np.isfinite(steps).all():
        raise SolverFailed("the timing comes to a halt on the path")
    return PathTiming(path, s, speed, np.concatenate([[0.0], np.cumsum(steps)]))


def toppra_module() -> ModuleType:
    """Returns the imported library.

    Raises:
        BackendUnavailable: toppra is not installed.
    """
    try:
        import toppra
        import toppra.algorithm
        import toppra.constraint
        import toppra.solverwrapper.cy_seidel_solverwrapper
    except ImportError as error:
        raise BackendUnavailable("toppra", "toppra") from error
    logger = logging.getLogger("toppra")
    if logger.level != logging.CRITICAL:
        logger.setLevel(logging.CRITICAL)  # every failure it logs is also in its result
    return toppra


def _algorithm(toppra: ModuleType, constraint: Any, s: Vector) -> Any:
    """Returns TOPP-RA ready to run; its own constructor is avoided, which searches for other solvers every time."""
    base = toppra.algorithm.algorithm.ParameterizationAlgorithm
    algorithm = toppra.algorithm.TOPPRA.__new__(toppra.algorithm.TOPPRA)
    interval = SimpleNamespace(dof=6, path_interval=s[[0, -1]])  # the part of a path that TOPP-RA itself reads
    base.__init__(algorithm, [constraint], interval, gridpoints=s)
    wrapper = toppra.solverwrapper.cy_seidel_solverwrapper.seidelWrapper
    algorithm.solver_wrapper = wrapper(algorithm.constraints, algorithm.path, algorithm.gridpoints, solve_lp1d=True)
    return algorithm


def _constraint(
    toppra: ModuleType, along: Derivatives, cell: Cell, limits: Limits, ends: tuple[float, float], carrying: bool
) -> Any:
    """Returns all limits as one TOPP-RA constraint: rows |a u + b x + c| <= 1, and bounds on x = (ds/dt)^2."""
    bound = LIMIT_SHARE * limits.qdd_max
    accelerations = (along[1] / bound, along[2] / bound, np.zeros_like(along[1]))
    a, b, c = np.concatenate([accelerations, _torque_rows(along, cell, limits, carrying)], axis=2)
    bounds = np.stack([np.zeros(len(a)), _squared_speed(along, cell, limits, ends)], axis=1)
    rows = a.shape[1]
    F = np.concatenate([np.eye(rows), -np.eye(rows)])
    g = np.ones(2 * rows)

    class ArmLimits(toppra.constraint.LinearConstraint):
        """The rows above, independent of the path that TOPP-RA passes in."""

        def __init__(self) -> None:
            super().__init__()
            self.identical = True
            self.dof = 6
            self._format_string = ""

        def compute_constraint_params(self, path, gridpoints):
            lines = toppra.constraint.linear_constraint.canlinear_colloc_to_interpolate
            return (*lines(a, b, c, F, g, None, None, gridpoints, identical=True)[:5], None, bounds)

    return ArmLimits()


def _torque_rows(along: Derivatives, cell: Cell, limits: Limits, carrying: bool) -> tuple[Vector, Vector, Vector]:
    q, dq, ddq = along
    bound = TORQUE_SHARE * limits.tau_max
    still = np.zeros_like(q)
    torques = partial(joint_torques, cell.robot, q, gravity_B=gravity_in_base(cell), payload=payload_of(cell, carrying))
    weight = torques(still, still)
    inertia = torques(still, dq) - weight
    curving = torques(dq, ddq) - weight
    return inertia / bound, curving / bound, weight / bound


def _squared_speed(along: Derivatives, cell: Cell, limits: Limits, ends: tuple[float, float]) -> Vector:
    """Returns the largest (ds/dt)^2 (k,) within the limits on joint velocity and tool speed."""
    q, dq, _ = along
    J_v = jacobian(cell.robot, q, cell.tool.X_FT)[:, :3]
    tool = np.linalg.norm(np.einsum("kij,kj->ki", J_v, dq), axis=1) / limits.tcp_speed_max
    used = np.maximum(np.max(np.abs(dq) / limits.qd_max, axis=1), tool)  # share of the limits at ds/dt = 1
    # A release exactly at a limit is allowed, and so is the path before it at the same path speed.
    share = np.clip(used * max(ends), LIMIT_SHARE, 1.0)
    return (share / np.maximum(used, SLOWEST)) ** 2
