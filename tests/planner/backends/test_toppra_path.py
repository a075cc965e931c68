"""TOPP-RA: timings against closed forms, torque limits that bind, tool lines that are straight."""

from dataclasses import replace

import numpy as np
import pinocchio
import pytest

from planner.backends import toppra_path
from planner.backends.toppra_path.parameterization import fastest_timing
from planner.backends.toppra_path.paths import JointLine, ProfilePath, ToolLine
from planner.certificate import certify
from planner.errors import SolverFailed
from planner.kinematics import forward
from planner.problem import JointRelease
from planner.seeds import candidates
from planner.timing import shortest_cubic, shortest_trapezoid
from tests.planner.problems import cell, feasible_states, joint_problem

STATES = 6
UNBOUND = {"tau_max": np.full(6, 1e6), "tcp_speed_max": 1e3}


def free_limits(**changes):
    return replace(cell().limits, **{**UNBOUND, **changes})


@pytest.mark.parametrize("path", ["joint", "smooth"])
def test_random_releases_are_certified(path):
    """A path drawn by a feasible motion always has a timing; what may fail is collision, as for any back end."""
    valid = 0
    for problem, _ in feasible_states(cell(), STATES, seed=23):
        motion = toppra_path.solve(problem, candidates(problem)[0], path).trajectory
        certificate = certify(problem, motion)
        valid += certificate.valid
        assert {c.name for c in certificate.failures} <= {"floor", "self_collision", "joint_position"}
    assert valid >= 0.8 * STATES


@pytest.mark.parametrize("distance", [1.5, 0.3], ids=["with a cruise", "without one"])
def test_a_straight_move_takes_the_textbook_time(distance):
    limits = free_limits()
    v = limits.qd_max[0]
    a = limits.qdd_max[0]
    known = distance / v + v / a if distance > v**2 / a else 2 * np.sqrt(distance / a)
    move = fastest_timing(JointLine(cell().home, np.eye(6)[0] * distance, 0.0, 1.0), cell(), limits, (0.0, 0.0))
    assert known <= move.duration_s == pytest.approx(known, rel=0.02)


def test_a_drawn_path_is_run_at_least_as_fast_as_it_was_drawn():
    for problem, _ in feasible_states(cell(), 5, seed=3):
        candidate = candidates(problem)[0]
        drawn = shortest_cubic(candidate.q - problem.start, candidate.qd, problem.limits, problem.dt)
        timing = fastest_timing(
            ProfilePath(problem.start, drawn), cell(), free_limits(qdd_max=problem.limits.qdd_max * 1.01), (0.0, 1.0)
        )
        assert timing.duration_s <= drawn.duration_s
        np.testing.assert_allclose(timing.velocities(timing.t[-1:])[0], candidate.qd, atol=1e-12)


def test_velocity_and_acceleration_limits_hold_along_the_timing():
    problem = joint_problem()
    candidate = candidates(problem)[0]
    limits = free_limits()
    drawn = shortest_trapezoid(
        candidate.q - problem.start, candidate.qd, replace(limits, qdd_max=0.98 * limits.qdd_max), problem.dt
    )
    timing = fastest_timing(ProfilePath(problem.start, drawn), cell(), limits, (0.0, 1.0))
    t = np.linspace(0.0, timing.duration_s, 2000)
    qd = timing.velocities(t)
    assert np.all(np.abs(qd) <= limits.qd_max)
    qdd = np.diff(qd, axis=0) / np.diff(t)[:, None]
    assert np.mean(np.abs(qdd) <= 1.01 * limits.qdd_max) > 0.99  # between grid points they may stray for an instant


def pinocchio_torques(problem_cell, q, qd, qdd):
    """Another library's torques for the arm built from its data, the tool and object as point masses on the flange."""
    robot = problem_cell.robot
    model = pinocchio.Model()
    parent = 0
    for i, link in enumerate(robot.links):
        before = robot_placement(robot, i - 1) if i else pinocchio.SE3.Identity()
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), before, f"j{i}")
        own = robot_placement(robot, i)
        inertia = pinocchio.Inertia(link.mass, link.com, link.inertia)
        model.appendBodyToJoint(parent, inertia, own)
    p_FT = problem_cell.tool.X_FT[:3, 3]
    flange = robot_placement(robot, 5)
    for mass, place in ((problem_cell.tool.mass_kg, p_FT / 2), (problem_cell.object.mass_kg, p_FT)):
        model.appendBodyToJoint(parent, pinocchio.Inertia(mass, place, np.zeros((3, 3))), flange)
    data = model.createData()
    return np.array([pinocchio.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)])


def robot_placement(robot, i):
    """What follows the turn of joint i in its Denavit-Hartenberg step: d, a, alpha."""
    c = np.cos(robot.alpha[i])
    s = np.sin(robot.alpha[i])
    return pinocchio.SE3(np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), np.array([robot.a[i], 0.0, robot.d[i]]))


def test_a_torque_limit_binds_and_holds():
    here = cell()
    d = np.array([0.3, 0.9, -0.8, 0.2, 0.1, 0.2])
    limits = free_limits(tau_max=here.limits.tau_max * 0.6)
    free = fastest_timing(JointLine(here.home, d, 0.0, 1.0), here, free_limits(), (0.0, 0.0))
    timing = fastest_timing(JointLine(here.home, d, 0.0, 1.0), here, limits, (0.0, 0.0))
    assert timing.duration_s > 1.02 * free.duration_s
    slope = np.diff(timing.speed**2) / (2 * np.diff(timing.s))
    middle = (timing.s[1:] + timing.s[:-1]) / 2
    speed = np.sqrt((timing.speed[1:] ** 2 + timing.speed[:-1] ** 2) / 2)
    tau = pinocchio_torques(here, here.home + np.outer(middle, d), np.outer(speed, d), np.outer(slope, d))
    used = np.abs(tau / limits.tau_max).max()
    assert 0.95 < used < 1.0


def test_the_tool_speed_limit_binds():
    here = cell()
    d = np.array([1.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    timing = fastest_timing(JointLine(here.home, d, 0.0, 1.0), here, free_limits(tcp_speed_max=0.5), (0.0, 0.0))
    t = np.linspace(0.0, timing.duration_s, 400)
    radius = np.linalg.norm(forward(here.robot, here.home, here.tool.X_FT)[:2, 3])
    fastest_tool = np.abs(timing.velocities(t)[:, 0]).max() * radius
    assert 0.49 < fastest_tool <= 0.5


def test_a_tool_line_is_straight_and_even_and_its_derivatives_right():
    problem = joint_problem()
    candidate = candidates(problem)[0]
    line = ToolLine(cell(), candidate.q, candidate.qd, -0.2, 0.1)
    s = np.linspace(-0.19, 0.09, 15)
    h = 1e-5
    q, dq, ddq = line.at(s)
    X = forward(cell().robot, q, cell().tool.X_FT)
    steps = np.diff(X[:, :3, 3], axis=0)
    np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=1e-9)
    turns = [X[i + 1, :3, :3] @ X[i, :3, :3].T for i in range(len(X) - 1)]
    np.testing.assert_allclose(turns, np.broadcast_to(turns[0], (len(turns), 3, 3)), atol=1e-9)
    (early, *_), (late, *_) = line.at(s - h), line.at(s + h)
    np.testing.assert_allclose((late - early) / (2 * h), dq, atol=1e-6)
    np.testing.assert_allclose((late - 2 * q + early) / h**2, ddq, atol=1e-3)
    at_release = line.at(np.zeros(1))
    np.testing.assert_allclose(at_release[0][0], candidate.q, atol=1e-9)
    np.testing.assert_allclose(at_release[1][0], candidate.qd, atol=1e-9)


def test_the_cartesian_launch_runs_straight_through_the_release():
    """The tool keeps its line around the release, and to first order its speed."""
    problem = joint_problem()
    candidate = candidates(problem)[0]
    motion = toppra_path.solve(problem, candidate, "cartesian").trajectory
    k = motion.release_index
    near = slice(k - 6, k + 7)
    p = forward(cell().robot, motion.q[near], cell().tool.X_FT)[:, :3, 3]
    v = np.gradient(p, problem.dt, axis=0)[1:-1]
    speed = np.linalg.norm(v, axis=1)
    assert speed.argmax() in (4, 5, 6)
    np.testing.assert_allclose(speed, speed[5], rtol=0.02)
    along = v[5] / speed[5]
    off = p - p[6] - np.outer((p - p[6]) @ along, along)
    assert np.linalg.norm(off, axis=1).max() < 2e-4


def test_a_line_out_of_reach_is_refused():
    here = cell()
    q = here.home + np.array([0.0, 0.9, 0.1 - here.home[2], 0.3, 0.0, 0.0])  # nearly stretched, and moving outwards
    problem = joint_problem(release=JointRelease(q, np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0])))
    with pytest.raises(SolverFailed):
        toppra_path.solve(problem, candidates(problem)[0], "cartesian")


def test_a_move_that_ends_at_rest_can_follow_the_tools_line():
    here = cell()
    q = here.home + np.array([0.3, 0.1, -0.2, 0.3, 0.1, 0.4])
    problem = joint_problem(release=JointRelease(q, np.zeros(6)))
    motion = toppra_path.solve(problem, candidates(problem)[0], "cartesian").trajectory
    p = forward(here.robot, motion.q, here.tool.X_FT)[:, :3, 3]
    along = (p[-1] - p[0]) / np.linalg.norm(p[-1] - p[0])
    off = p - p[0] - np.outer((p - p[0]) @ along, along)
    assert np.linalg.norm(off, axis=1).max() < 2e-3
    np.testing.assert_array_equal(motion.q[-1], q)


def test_the_status_reports_the_smoothing():
    problem = joint_problem()
    status = toppra_path.solve(problem, candidates(problem)[0]).status
    assert "time-optimal along the joint path" in status
    assert "without regard to jerk" in status
    assert "averaged over" in status
