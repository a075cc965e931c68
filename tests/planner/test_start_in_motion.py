"""Starts in motion: joined exactly in position, velocity and acceleration, and refused where a joint cannot stop."""

from dataclasses import replace

import numpy as np
import pytest

from planner.backends import ruckig_otg
from planner.cell import Cell
from planner.certificate import certify
from planner.errors import Infeasible, InvalidProblem
from planner.geometry import tool_state
from planner.passages import Passage
from planner.planning import plan
from planner.problem import JointRelease, ThrowProblem
from planner.request import problem_from_request, request_document
from planner.seeds import Candidate, least_time
from planner.trajectory import Trajectory
from tests.planner.problems import cell, joint_problem, with_boxes

SPEEDS = np.array([0.5, -0.4, 0.3, -0.6, 0.2, 0.7])
ACCELERATIONS = np.array([3.0, -2.0, 4.0, 1.0, -5.0, 2.0])
HALF = np.array([0.05, 0.05, 0.3])  # [m] half of a wall beside the start
POST = np.array([0.06, 0.06, 0.5])  # [m] half of a post on the way
TARGET = {"kind": "target", "position": [1.2, 0.3, 0.0]}
POINT = {"kind": "point", "position": [0.5, 0.2, 0.6], "velocity": [0.8, 0.3, 0.6]}


def moving_start(here: Cell, **changes):
    start = {"positions": here.home.tolist(), "velocities": SPEEDS.tolist(), "accelerations": ACCELERATIONS.tolist()}
    return {**start, **changes}


def in_motion(**changes) -> ThrowProblem:
    return joint_problem(start_qd=SPEEDS, start_qdd=ACCELERATIONS, **changes)


@pytest.mark.parametrize("release", [TARGET, POINT])
@pytest.mark.parametrize("backend", ["auto", "casadi", "ruckig"])
def test_a_motion_joins_the_one_before_exactly(release, backend):
    here = cell()
    problem = problem_from_request({"start": moving_start(here), "release": release, "backend": backend}, here)
    made = plan(problem)
    motion = made.trajectory
    assert np.array_equal(motion.q[0], here.home)
    assert np.array_equal(motion.qd[0], SPEEDS)
    assert np.array_equal(motion.qdd[0], ACCELERATIONS)
    assert made.certificate.check("join").ok
    assert "start" not in {check.name for check in made.certificate.checks}


@pytest.mark.parametrize("variant", ["free", "synchronised", "gentle"])
def test_a_start_near_its_limits_is_no_wrong_problem_to_a_gentler_motion(variant):
    limits = joint_problem().limits
    problem = joint_problem(start_qd=0.9 * limits.qd_max * np.eye(6)[5], start_qdd=0.8 * limits.qdd_max * np.eye(6)[3])
    state = problem.release.joint_state
    made = ruckig_otg.solve(problem, Candidate(*state, 0.0, "state"), variant)
    assert np.array_equal(made.trajectory.qd[0], problem.start_qd)
    leg = ruckig_otg.leg(problem, problem.start_state, (*state, np.zeros(6)), 0.25)
    assert np.array_equal(leg[2][0], problem.start_qdd)


def test_passages_begin_on_a_motion_too():
    problem = in_motion(passages=(Passage("first", joint_problem().release),))
    then = JointRelease(problem.start, np.zeros(6))
    made = plan(replace(problem, end=then))
    assert np.array_equal(made.trajectory.qd[0], SPEEDS)
    assert np.abs(made.trajectory.q[-1] - problem.start).max() < 1e-9


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize(("which", "detail"), [("q", "position"), ("qd", "velocity"), ("qdd", "acceleration")])
def test_a_motion_that_does_not_join_is_not_certified(joint, which, detail):
    problem = in_motion()
    motion = plan(problem).trajectory
    off = 2e-6 * np.eye(6)[joint]
    spoilt = {name: getattr(motion, name).copy() for name in ("q", "qd", "qdd")}
    spoilt[which][0] += off
    check = certify(problem, Trajectory(motion.sample_rate_hz, **spoilt, release_index=motion.release_index))
    assert not check.check("join").ok
    assert check.check("join").detail == detail


def test_the_request_states_its_start_again():
    here = cell()
    asked = problem_from_request({"start": moving_start(here), "release": TARGET}, here)
    again = problem_from_request(request_document(asked, asked.release), here)
    assert all(np.array_equal(a, b) for a, b in zip(asked.start_state, again.start_state, strict=True))
    resting = problem_from_request({"release": TARGET}, here)
    assert set(request_document(resting, resting.release)["start"]) == {"positions"}


@pytest.mark.parametrize(
    ("start", "field"),
    [
        ({"velocities": [0.0] * 6, "current": True}, "start.velocities"),
        ({"accelerations": [0.0] * 6}, "start"),
        ({"execution": "latest"}, "start.at_s"),
        ({"at_s": 0.5, "current": True}, "start.at_s"),
        ({"execution": "latest", "at_s": 0.5}, "start.execution"),
        ({"positions": [0.0] * 6, "current": True}, "start"),
    ],
)
def test_a_start_is_stated_in_one_way(start, field):
    with pytest.raises(InvalidProblem) as refused:
        problem_from_request({"start": start, "release": TARGET}, cell())
    assert field in {error.field for error in refused.value.errors}


@pytest.mark.parametrize("name", ["velocities", "accelerations"])
def test_a_start_beyond_a_limit_is_refused_by_its_joint(name):
    here = cell()
    own = {"velocities": here.limits.qd_max, "accelerations": here.limits.qdd_max}[name]
    start = moving_start(here, **{name: (1.01 * own * np.eye(6)[4]).tolist()})
    with pytest.raises(InvalidProblem) as refused:
        problem_from_request({"start": start, "release": TARGET}, here)
    assert [error.field for error in refused.value.errors] == [f"start.{name}[4]"]


def test_a_back_end_that_starts_at_rest_is_refused():
    with pytest.raises(InvalidProblem, match="start in motion"):
        in_motion(backend="toppra")


def at_the_edge(room: float) -> ThrowProblem:
    """A start from which joint 1 turns at its upper position limit, `room` times the least way before it."""
    here = cell()
    limits = here.limits
    q = here.home.copy()
    qd = np.zeros(6)
    qd[0] = 2.0
    jerk = limits.jerk_max[0]
    most = limits.qdd_max[0]
    fades = most / jerk
    left = qd[0] - jerk * fades**2 / 2.0
    way = qd[0] * fades - jerk * fades**3 / 6.0 + left**2 / (2.0 * most)
    upper = limits.q_upper.copy()
    upper[0] = q[0] + room * way
    return joint_problem(limits=replace(limits, q_upper=upper), start_qd=qd, release=JointRelease(q, np.zeros(6)))


def test_a_start_that_cannot_stop_before_a_joint_limit_is_refused_as_proven():
    with pytest.raises(Infeasible) as refused:
        plan(at_the_edge(0.999))
    (found,) = refused.value.violations
    assert found.proven
    assert found.constraint == "joint_position"
    assert "cannot stop" in found.detail
    assert plan(at_the_edge(1.01)).certificate.valid


def with_rising_speed(short: float) -> ThrowProblem:
    """A start at full acceleration of joint 3, `short` times what fading it gains below the joint's speed limit."""
    limits = cell().limits
    qdd = limits.qdd_max * np.eye(6)[2]
    gained = limits.qdd_max[2] ** 2 / (2.0 * limits.jerk_max[2])
    return joint_problem(start_qd=(limits.qd_max[2] - short * gained) * np.eye(6)[2], start_qdd=qdd)


def test_an_acceleration_that_cannot_fade_in_time_is_refused_as_proven():
    with pytest.raises(Infeasible) as refused:
        plan(with_rising_speed(0.99))
    assert [(each.constraint, each.proven) for each in refused.value.violations] == [("joint_velocity", True)]
    assert plan(with_rising_speed(1.2)).certificate.valid


def test_a_refusal_tells_what_the_fastest_brake_meets():
    here = cell()
    qd = 1.7 * np.eye(6)[0]
    moving = tool_state(here, here.home, qd)
    p = moving.p_WT + 0.16 * moving.v_WT / np.linalg.norm(moving.v_WT)
    wall = with_boxes(here, (p - HALF, p + HALF))
    with pytest.raises(Infeasible) as refused:
        plan(joint_problem(cell=wall, start_qd=qd, release=JointRelease(here.home - 0.3 * qd, np.zeros(6))))
    assert any("on the fastest brake from the start" in each.detail for each in refused.value.violations)
    assert "on the fastest brake from the start" in str(refused.value)


def test_a_brake_comes_first_where_nothing_else_leads_there():
    """A wall between start and release, which the straight way meets: the arm brakes, and goes around it."""
    here = cell()
    release = JointRelease(here.home + 1.6 * np.eye(6)[0], np.zeros(6))
    middle = tool_state(here, here.home + 0.8 * np.eye(6)[0], np.zeros(6)).p_WT
    wall = with_boxes(here, (middle - POST, middle + POST))
    made = plan(joint_problem(cell=wall, start_qd=0.5 * np.eye(6)[0], release=release))
    assert made.status.startswith("after a brake")
    assert made.trajectory.qd[0, 0] == 0.5


def test_the_lower_bound_holds_for_ruckigs_motions():
    rng = np.random.default_rng(7)
    problem = joint_problem()
    limits = problem.limits
    for _ in range(200):
        qd0, qd1 = rng.uniform(-1.0, 1.0, (2, 6)) * limits.qd_max
        q1 = problem.start + rng.normal(0.0, 0.5, 6)
        zero = np.zeros(6)
        taken_s = ruckig_otg.least_leg_time(problem, (problem.start, qd0, zero), (q1, qd1, zero))
        assert least_time(q1 - problem.start, qd1, limits, qd0) <= taken_s + 1e-9
