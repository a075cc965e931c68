"""Curvature bounds of torques, singularity distances and landing points against dense differences; distances against
dense samples by the plain functions."""

from dataclasses import replace

import numpy as np
import pytest

from planner.cell import Box
from planner.certificate import certify
from planner.certificate.bounds import joint_rates
from planner.certificate.exits import Cone
from planner.certificate.loads import load_bounds, loads_of
from planner.certificate.release import _landing_curvature
from planner.certificate.samples import MotionSamples
from planner.certificate.tool import _singularity_curvature
from planner.dynamics import joint_torques, payload_of
from planner.flight import landing_points
from planner.geometry import body_capsules, capsule_endpoints, segment_shape_distance, tool_state
from planner.kinematics import signed_singularity_distances
from planner.native import loops
from planner.problem import TargetRelease
from planner.trajectory import Trajectory, integrate
from tests.planner.certificate.test_certificate import random_trajectories
from tests.planner.problems import joint_problem

DOWN = np.array([0.0, 0.0, -9.81])


def second_differences(function, trajectory):
    """Second derivative of f(q, qd, qdd) (n, k) in the middle of every tick, and the steps' noise allowed."""
    h = trajectory.dt / 40.0
    middles = (trajectory.t[:-1] + trajectory.dt / 2.0)[:, None] + h * np.arange(-1, 2)
    f = function(*trajectory.at(middles))
    return (f[:, 2] - 2.0 * f[:, 1] + f[:, 0]) / h**2


def test_the_curvature_of_torques_is_within_its_bound():
    for problem, trajectory in random_trajectories(3, seed=15):
        robot = problem.cell.robot
        held = payload_of(problem.cell, with_object=True)
        curvature = second_differences(lambda *s: joint_torques(robot, *s, DOWN, held), trajectory)  # noqa: B023
        bound = load_bounds(loads_of(problem.cell), joint_rates(trajectory), problem.gravity).torque
        assert np.all(np.abs(curvature) <= bound.T + 1e-2)


def test_a_torque_peak_between_samples_is_found():
    """Between two samples the acceleration is a spike: its torque has a kink that no curvature bound covers."""
    problem = joint_problem()
    jerk = np.zeros((20, 6))
    jerk[2:18, 1] = 400.0 * np.repeat([1.0, -1.0, -1.0, 1.0], 4)
    q, qd, qdd = integrate(problem.start, np.zeros(6), np.zeros(6), jerk, problem.dt)
    spike = Trajectory(500.0, q, qd, qdd, release_index=20)
    motion = MotionSamples(problem, spike)
    held = payload_of(problem.cell, with_object=True)
    t = np.linspace(0.0, spike.duration_s, 2001)
    tau = np.abs(joint_torques(problem.cell.robot, *spike.at(t), DOWN, held)).max(axis=0)
    rows = motion.knots
    sampled = joint_torques(problem.cell.robot, q[rows], qd[rows], qdd[rows], DOWN, held)
    assert np.abs(sampled).max(axis=0)[1] < 0.99 * tau[1]
    between = (np.abs(sampled).max(axis=0)[1] + tau[1]) / 2.0
    for limit, ok in ((between, False), (1.01 * tau[1], True)):
        tau_max = np.where(np.arange(6) == 1, limit, problem.limits.tau_max)
        limited = replace(problem, limits=replace(problem.limits, tau_max=tau_max))
        assert certify(limited, spike).check("joint_torque").ok == ok


def test_the_mass_matrix_is_within_its_bound():
    rng = np.random.default_rng(4)
    still = np.zeros(6)
    for name in ("ur5e-sim", "ur10e-sim"):
        problem = joint_problem(name)
        robot = problem.cell.robot
        held = payload_of(problem.cell, with_object=True)
        for q in rng.uniform(-np.pi, np.pi, (200, 6)):
            weight = joint_torques(robot, q, still, still, DOWN, held)
            mass_matrix = joint_torques(robot, np.tile(q, (6, 1)), still, np.eye(6), DOWN, held) - weight
            assert np.all(np.abs(mass_matrix.T) <= loads_of(problem.cell).mass_matrix + 1e-9)


def test_the_curvature_of_singularity_distances_is_within_its_bound():
    for problem, trajectory in random_trajectories(3, seed=16):
        robot = problem.cell.robot
        curvature = second_differences(lambda q, qd, qdd: signed_singularity_distances(robot, q), trajectory)  # noqa: B023
        assert np.all(np.abs(curvature) <= _singularity_curvature(robot, joint_rates(trajectory)).T + 1e-4)


def test_the_curvature_of_the_landing_point_is_within_its_bound():
    for problem, trajectory in random_trajectories(6, seed=17):
        thrown = replace(problem, release=TargetRelease(np.zeros(3)), release_window_s=0.01, landing_tolerance_m=0.01)
        delays = np.linspace(-0.01, 0.01, 201)
        q, qd, _ = trajectory.at(trajectory.release_time_s + delays)
        X_WT, V_WT = tool_state(thrown.cell, q, qd)
        landed = landing_points(X_WT[:, :3, 3], V_WT[:, :3], 0.0, 9.81)
        if not np.isfinite(landed).all():
            continue
        motion = MotionSamples(thrown, trajectory)
        bound = _landing_curvature(motion, motion.at(trajectory.release_time_s + delays))
        curvature = np.diff(landed, n=2, axis=0) / (delays[1] - delays[0]) ** 2
        assert np.linalg.norm(curvature, axis=1).max() <= bound * (1.0 + 1e-6) + 1e-2


@pytest.mark.parametrize("half_rad", [0.8, np.pi / 2, 2.0, 3.0])
def test_a_cell_in_a_cone_is_as_deep_as_claimed(half_rad):
    """Against the angles of dense points of the cell; what is outside a wide cone is the complement."""
    rng = np.random.default_rng(19)
    cone = Cone(np.array([0.0, 0.6, 0.8]), half_rad, 0.0, 0.01)
    share = rng.dirichlet(np.ones(4), 400)
    for _ in range(200):
        corner = rng.uniform(-1.0, 1.0, 3) + rng.uniform(0.0, 1.0) * rng.uniform(-1.0, 1.0, (4, 3))
        claimed = loops.exit_cells(corner.T, np.zeros(4), np.arange(4)[:, None], np.zeros(1), cone)[5, 0]
        w = share @ corner
        size = np.linalg.norm(w, axis=1)
        angle = np.arccos(np.clip(w @ cone.direction / size, -1.0, 1.0))
        depth = size * np.sin(np.clip(half_rad - angle, -np.pi / 2, np.pi / 2))
        assert claimed <= depth.min() + 1e-12


def test_distances_from_boxes_are_those_of_dense_samples():
    boxes = (
        Box(np.array([-0.9, 0.35, 0.0]), np.array([0.9, 0.9, 1.2])),
        Box(np.array([0.15, -0.6, 0.5]), np.array([0.5, 0.2, 0.9])),
    )
    for problem, trajectory in random_trajectories(6, seed=18):
        around = replace(problem.cell.surroundings, keep_out=boxes, clearance_m=0.001)
        boxed = replace(problem, cell=replace(problem.cell, surroundings=around))
        capsules = [c for c in body_capsules(boxed.cell.robot, boxed.cell.tool.capsules) if c.frame > 0]
        t = np.linspace(0.0, trajectory.duration_s, 4 * len(trajectory.q))
        ends = capsule_endpoints(boxed.cell.robot, capsules, trajectory.at(t)[0], boxed.cell.X_WB)
        gaps = [segment_shape_distance(ends[..., 0, :], ends[..., 1, :], b) for b in boxes]
        least = float((np.min(gaps, axis=0) - [c.radius_m for c in capsules]).min())
        check = certify(boxed, trajectory).check("keep_out")
        if least < 0.001:
            assert not check.ok
        else:
            assert check.value == pytest.approx(least, abs=0.01)
            assert check.value >= least - 1e-3 or not check.ok
