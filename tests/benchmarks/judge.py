"""A second judge, built on Pinocchio, coal and MuJoCo: it shares no code with the certificate but the arms' shapes.

A certified plan is called wrong where the dense look of other libraries finds a limit broken by more than the
tolerances below. Kinematics and torques come from the published URDF numbers, not from `planner/robot_data`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import combinations

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from planner.cell import Cell
from planner.geometry import SELF_CLEARANCE_M, body_capsules
from planner.problem import JointRelease, PointRelease, PoseRelease, TargetRelease, ThrowProblem
from planner.trajectory import Trajectory
from tests.benchmarks.simulation import inverse_dynamics, thrown
from tests.planner.published_arms import pinocchio_arm

Vector = NDArray[np.float64]

STEP_S = 0.001  # grid of the joint limits, torques and speeds
SPARSE_S = 0.008  # grid of the distances
LIMIT_SLACK = 1e-5  # [-] share of a limit: a spline through samples and the published rounding of the quarter turns
LENGTH_SLACK_M = 1e-5  # of distances and places
SPEED_SLACK = 1.1e-4  # [m/s] of the release's velocity: the certificate's tolerance and the rounding
LANDING_SLACK_M = 6e-4  # of the landing: the certificate's 0.5 mm and MuJoCo's integration
TORQUE_AGREEMENT = 1e-4  # [-] of the largest torque: Pinocchio against MuJoCo
NEVER_FREE_SAMPLES = 2000  # random postures in which a pair must once be apart to count as one that can be apart


@dataclass(frozen=True, eq=False)
class Dense:
    """The motion looked at by another interpolation: times, positions, velocities, accelerations, jerks.

    The spline sees positions and velocities alone, so that its accelerations and jerks check the given ones.
    """

    t: Vector
    q: Vector
    qd: Vector
    qdd: Vector
    jerk: Vector

    @classmethod
    def of(cls, motion: Trajectory) -> Dense:
        spline = CubicHermiteSpline(motion.t, motion.q, motion.qd)
        t = np.linspace(0.0, motion.duration_s, max(2, round(motion.duration_s / STEP_S) + 1))
        return cls(t, spline(t), spline(t, 1), spline(t, 2), spline(0.5 * (motion.t[1:] + motion.t[:-1]), 3))


def wrongs(problem: ThrowProblem, motion: Trajectory) -> list[str]:
    """Returns what is wrong with a certified motion, in words; nothing where it is right."""
    dense = Dense.of(motion)
    found = [*_limits(problem, motion, dense), *_torques(problem, motion, dense), *_space(problem, motion, dense)]
    return found + _release(problem, motion)


def _limits(problem: ThrowProblem, motion: Trajectory, dense: Dense) -> list[str]:
    limits = problem.limits
    pairs = (
        ("velocity", np.abs(dense.qd).max(axis=0), limits.qd_max),
        ("acceleration", np.abs(dense.qdd).max(axis=0), limits.qdd_max),
        ("jerk", np.abs(dense.jerk).max(axis=0), limits.jerk_max),
        ("upper position", dense.q.max(axis=0), limits.q_upper + 1e-6),
        ("lower position", -dense.q.min(axis=0), -limits.q_lower + 1e-6),
    )
    found = [f"{name} {worst}" for name, worst, limit in pairs if np.any(worst > limit + LIMIT_SLACK * np.abs(limit))]
    if np.abs(motion.qd[-1]).max() > 1e-6 or np.abs(motion.q[0] - problem.start).max() > 1e-6:
        found.append("does not start as asked or end at rest")
    return found


def _torques(problem: ThrowProblem, motion: Trajectory, dense: Dense) -> list[str]:
    found, cell = [], problem.cell
    held = dense.t <= motion.release_time_s
    for rows, with_object in ((held, True), (~held, False)):
        states = [x[rows][::4] for x in (dense.q, dense.qd, dense.qdd)]
        if len(states[0]) == 0:
            continue
        model = arm(cell, with_object)
        data = model.createData()
        tau = np.array([pin.rnea(model, data, *state) for state in zip(*states, strict=True)])
        if np.any(np.abs(tau) > problem.limits.tau_max * (1.0 + LIMIT_SLACK) + 1e-6):
            found.append(f"torque {np.abs(tau).max(axis=0)}")
        other = inverse_dynamics(cell, with_object, model, *(x[::8] for x in states))
        if np.abs(tau[::8] - other).max() > TORQUE_AGREEMENT * max(1.0, np.abs(tau).max()):
            found.append("Pinocchio and MuJoCo disagree on torques")
    return found


def _space(problem: ThrowProblem, motion: Trajectory, dense: Dense) -> list[str]:
    cell, stride = problem.cell, round(SPARSE_S / STEP_S)
    rows = np.arange(0, len(dense.t), stride)
    floor, self_gap, speed, outside = np.inf, np.inf, 0.0, -np.inf
    model = arm(cell, False)
    data = model.createData()
    for i in rows:
        poses, v = _poses(cell, model, data, dense.q[i], dense.qd[i])
        speed = max(speed, float(np.linalg.norm(v)))
        floor = min(floor, _height(cell, poses, dense.t[i] <= motion.release_time_s))
        self_gap = min(self_gap, _self_gap(cell, poses))
        p = poses[6].act(cell.tool.X_FT[:3, 3])
        outside = max([outside, *(float(np.max([b.lower - p, p - b.upper])) for b in cell.surroundings.keep_in)])
    found = []
    if speed > problem.limits.tcp_speed_max * (1.0 + LIMIT_SLACK):
        found.append(f"tool speed {speed}")
    if floor < cell.surroundings.clearance_m - LENGTH_SLACK_M:
        found.append(f"floor {floor}")
    if self_gap < SELF_CLEARANCE_M - LENGTH_SLACK_M:
        found.append(f"self-collision {self_gap}")
    if outside > LENGTH_SLACK_M:
        found.append(f"outside a box by {outside}")
    return found


def _release(problem: ThrowProblem, motion: Trajectory) -> list[str]:
    """The release is what was asked for, and the object flies where it should: MuJoCo throws it."""
    cell, k, release = problem.cell, motion.release_index, problem.release
    model = arm(cell, True)
    poses, v = _poses(cell, model, model.createData(), motion.q[k], motion.qd[k])
    p, found = poses[6].act(cell.tool.X_FT[:3, 3]), []
    if isinstance(release, JointRelease):
        if max(np.abs(motion.q[k] - release.q).max(), np.abs(motion.qd[k] - release.qd).max()) > SPEED_SLACK:
            found.append("another joint state at the release")
        return found
    if isinstance(release, PoseRelease | PointRelease):
        place = release.X_WT[:3, 3] if isinstance(release, PoseRelease) else release.p_WT
        velocity = release.V_WT[:3] if isinstance(release, PoseRelease) else release.v_WT
        if np.linalg.norm(p - place) > 2.0 * LENGTH_SLACK_M or np.linalg.norm(v - velocity) > 2.0 * SPEED_SLACK:
            found.append(f"release off by {np.linalg.norm(p - place)} m, {np.linalg.norm(v - velocity)} m/s")
    if isinstance(release, TargetRelease):
        landed = thrown(p, v, release.p_W[2], problem.gravity)
        if landed is None or np.linalg.norm(landed - release.p_W) > LANDING_SLACK_M:
            found.append(f"lands at {landed}, asked for {release.p_W}")
        found += _window(problem, motion, model)
    return found


def _window(problem: ThrowProblem, motion: Trajectory, model: pin.Model) -> list[str]:
    release, cell = problem.release, problem.cell
    assert isinstance(release, TargetRelease)
    if not problem.is_robust:
        return []
    spline, data = CubicHermiteSpline(motion.t, motion.q, motion.qd), model.createData()
    for delay in np.linspace(-problem.release_window_s, problem.release_window_s, 9):
        t = motion.release_time_s + delay
        poses, v = _poses(cell, model, data, spline(t), spline(t, 1))
        landed = thrown(poses[6].act(cell.tool.X_FT[:3, 3]), v, release.p_W[2], problem.gravity)
        if landed is None or np.linalg.norm(landed - release.p_W) > problem.landing_tolerance_m + LANDING_SLACK_M:
            return [f"released {delay} s late lands at {landed}"]
    return []


@cache
def arm(cell: Cell, with_object: bool) -> pin.Model:
    """Returns the arm in Pinocchio on its base in the world, with tool and object as point masses on the flange."""
    model = pinocchio_arm(cell.robot.name, exact=True).copy()
    base = pin.SE3(cell.X_WB)
    model.jointPlacements[1] = base * model.jointPlacements[1]
    model.gravity.linear = np.array([0.0, 0.0, -cell.surroundings.gravity_m_s2])
    p_FT = cell.tool.X_FT[:3, 3]
    masses = [(cell.tool.mass_kg, 0.5 * p_FT)] + ([(cell.object.mass_kg, p_FT)] if with_object else [])
    for mass, place in masses:
        model.appendBodyToJoint(6, pin.Inertia(mass, place, np.zeros((3, 3))), pin.SE3.Identity())
    return model


def _poses(cell: Cell, model: pin.Model, data: pin.Data, q: Vector, qd: Vector) -> tuple[list[pin.SE3], Vector]:
    """Returns the world poses of base and DH frames, and the tool centre's velocity (3,) [m/s]."""
    pin.forwardKinematics(model, data, q, qd)
    poses = [pin.SE3(cell.X_WB), *(data.oMi[i] * _dh_in_urdf(cell.robot.name)[i - 1] for i in range(1, 7))]
    flange = pin.getVelocity(model, data, 6, pin.LOCAL_WORLD_ALIGNED)
    arm_W = data.oMi[6].rotation @ cell.tool.X_FT[:3, 3]
    return poses, flange.linear + np.cross(flange.angular, arm_W)


@cache
def _dh_in_urdf(name: str) -> list[pin.SE3]:
    """Returns the constant poses of the DH frames in the URDF's link frames, seen at the zero posture.

    The shapes are given in DH frames; both sets of frames move with the same links.
    """
    from planner.kinematics import link_poses
    from planner.robots import robot

    model = pinocchio_arm(name, exact=True)
    data = model.createData()
    pin.forwardKinematics(model, data, np.zeros(6))
    return [data.oMi[i].inverse() * pin.SE3(link_poses(robot(name), np.zeros(6))[i]) for i in range(1, 7)]


@cache
def _shapes(cell: Cell) -> list[tuple[int, pin.SE3, coal.Capsule, float, NDArray[np.float64]]]:
    """Returns frame, placement, coal's capsule, radius and end points (2, 3) of every body."""
    rows = []
    for c in body_capsules(cell.robot, cell.tool.capsules):
        along = c.p1 - c.p0
        length = float(np.linalg.norm(along))
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along / length if length else np.eye(3)[2])
        placement = pin.SE3(turn.matrix(), 0.5 * (c.p0 + c.p1))
        rows.append((c.frame, placement, coal.Capsule(c.radius_m, length), c.radius_m, np.array([c.p0, c.p1])))
    return rows


@cache
def _pairs(cell: Cell) -> list[tuple[int, int]]:
    """Returns the pairs of bodies that some random posture shows apart: all but neighbours on one joint."""
    rng, robot = np.random.default_rng(0), cell.robot
    model = arm(cell, False)
    data, seen = model.createData(), {}
    for _ in range(NEVER_FREE_SAMPLES):
        poses, _ = _poses(cell, model, data, rng.uniform(robot.q_lower, robot.q_upper), np.zeros(6))
        for i, j in combinations(range(len(_shapes(cell))), 2):
            if not seen.get((i, j)):
                seen[i, j] = _distance(cell, poses, i, j) >= SELF_CLEARANCE_M
    return [pair for pair, apart in seen.items() if apart]


def _self_gap(cell: Cell, poses: list[pin.SE3]) -> float:
    return min(_distance(cell, poses, i, j) for i, j in _pairs(cell))


def _distance(cell: Cell, poses: list[pin.SE3], i: int, j: int) -> float:
    shapes = _shapes(cell)
    places = [poses[shapes[k][0]] * shapes[k][1] for k in (i, j)]
    at = [coal.Transform3s(X.rotation, X.translation) for X in places]
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return float(coal.distance(shapes[i][2], at[0], shapes[j][2], at[1], request, result))


def _height(cell: Cell, poses: list[pin.SE3], held: bool) -> float:
    lowest = np.inf
    for frame, _, _, radius, ends in _shapes(cell):
        if frame > 0:
            lowest = min(lowest, *(float(poses[frame].act(end)[2]) - radius for end in ends))
    if held:
        lowest = min(lowest, float(poses[6].act(cell.tool.X_FT[:3, 3])[2]) - cell.object.radius_m)
    return lowest - cell.surroundings.floor_z_m
