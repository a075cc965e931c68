"""Ruckig's launches: the free one is as soon as the slowest joint alone, by closed forms and by brute force."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.launch_bound import state_bound
from planner.backends import ruckig_otg
from planner.backends.ruckig_otg import library
from planner.certificate import certify
from planner.planning import plan
from planner.problem import JointRelease
from planner.seeds import Candidate
from tests.planner.problems import cell, feasible_states, joint_problem, pose_problem

STATES = 20


def arrival(problem, q, qd):
    return ruckig_otg.arrival(problem, Candidate(q, qd, 0.0, "test"))


def test_a_joint_that_only_speeds_up_arrives_at_full_jerk():
    """Constant jerk j from rest: after T the acceleration is j T, the velocity j T^2 / 2, the distance j T^3 / 6."""
    problem = joint_problem()
    jerk = problem.limits.jerk_max[1]
    T = 0.02
    q = problem.start.copy()
    qd = np.zeros(6)
    q[1] += jerk * T**3 / 6.0
    qd[1] = jerk * T**2 / 2.0
    found = arrival(problem, q, qd)
    assert found.time_s == pytest.approx(T, rel=1e-2)  # of the sections, and what the tick grid needs
    np.testing.assert_allclose(found.qdd, [0.0, jerk * T, 0.0, 0.0, 0.0, 0.0], rtol=2e-2, atol=1e-9)


def test_no_final_acceleration_of_any_joint_is_sooner():
    for problem, best in feasible_states(cell(), STATES, seed=5):
        q = problem.release.q
        qd = problem.release.qd
        found = arrival(problem, q, qd)
        bound = state_bound(problem, q, qd)
        # The velocity limit holds beyond the release too, which the bound leaves out.
        assert bound * (1.0 - 1e-6) <= found.time_s <= max(1.02 * bound, bound + problem.dt)
        assert found.time_s <= best.release_time_s + 1e-9
        assert np.all(np.abs(found.qdd) <= problem.limits.qdd_max)


def test_the_free_launch_releases_exactly_there_at_the_tick_of_the_slowest_joint():
    sooner = 0
    for problem, best in feasible_states(cell(), STATES, seed=6):
        candidate = Candidate(problem.release.q, problem.release.qd, 0.0, "test")
        motion = ruckig_otg.solve(problem, candidate, "free").trajectory
        np.testing.assert_allclose(motion.q[motion.release_index], candidate.q, atol=1e-12)
        np.testing.assert_allclose(motion.qd[motion.release_index], candidate.qd, atol=1e-12)
        slowest = arrival(problem, candidate.q, candidate.qd).time_s
        assert slowest - 1e-9 <= motion.release_time_s <= slowest + 1.5 * problem.dt
        sooner += motion.release_time_s < best.release_time_s - 1e-9
        joint_checks = [c for c in certify(problem, motion).checks if c.name.startswith("joint_")]
        assert all(check.ok or check.name == "joint_torque" for check in joint_checks)
    assert sooner > STATES / 2


def test_a_velocity_near_its_limit_is_not_exceeded_beyond_the_release():
    problem = joint_problem()
    limits = problem.limits
    q = problem.start.copy()
    qd = np.zeros(6)
    q[0] = q[0] + 0.4
    qd[0] = 0.99 * limits.qd_max[0]
    problem = replace(problem, release=JointRelease(q, qd))
    found = arrival(problem, q, qd)
    assert abs(qd[0]) + found.qdd[0] ** 2 / (2.0 * limits.jerk_max[0]) <= limits.qd_max[0]
    motion = ruckig_otg.solve(problem, Candidate(q, qd, 0.0, "test"), "free").trajectory
    assert np.abs(motion.qd[:, 0]).max() <= limits.qd_max[0] * (1.0 + 1e-6)


def test_a_move_that_ends_at_rest_arrives_without_acceleration():
    here = cell()
    problem = joint_problem(release=JointRelease(here.home + 0.3, np.zeros(6)))
    assert not arrival(problem, problem.release.q, np.zeros(6)).qdd.any()


def test_auto_optimises_only_where_the_slowest_joint_alone_is_sooner():
    """Poses far from everything: Ruckig's free launch is the answer, and at the joint-wise bound."""
    here = cell()
    at_bound = 0
    for problem, _ in feasible_states(here, 8, seed=7, spread=0.5):
        answer = plan(pose_problem(here, problem.release.q, problem.release.qd))
        if len(answer.attempts) == 1:
            at_bound += 1
            assert answer.backend == "ruckig"
            bound = state_bound(answer.problem, *_released(answer.trajectory))
            assert answer.trajectory.release_time_s <= bound + 1.5 * answer.problem.dt
        else:
            assert any(attempt.backend == "casadi" for attempt in answer.attempts)
    assert at_bound >= 4


def _released(trajectory):
    return trajectory.q[trajectory.release_index], trajectory.qd[trajectory.release_index]


@pytest.mark.parametrize("share", [0.0, 0.9, 1.1])
def test_accelerations_are_those_that_ruckig_gives_tick_by_tick(share):
    """A state outside its limits makes Ruckig brake before its seven phases."""
    for problem, _ in feasible_states(cell(), STATES, seed=8):
        limits = problem.limits
        dt = problem.dt
        signs = np.where(np.arange(6) % 2, 1.0, -1.0)
        start = (problem.start, np.zeros(6), share * signs * limits.qdd_max)
        end = (problem.release.q, problem.release.qd, -0.5 * signs * limits.qdd_max)
        for motion in (library.fastest_motion(start, end, limits, dt), library.fastest_motion(end, None, limits, dt)):
            found = library.accelerations(motion, dt)
            np.testing.assert_allclose(found, [motion.at_time(i * dt)[2] for i in range(len(found))], atol=1e-9)
