"""Each profile has the shape that its name states, outside the ticks that averaging rounds off."""

from dataclasses import replace

import numpy as np
import pytest

from planner.backends import profiles, ruckig_otg
from planner.certificate import certify
from planner.errors import SolverFailed
from planner.problem import JointRelease
from planner.seeds import Candidate, candidates
from tests.planner.problems import cell, feasible_states, joint_problem

STATES = 12


@pytest.mark.parametrize("variant", profiles.VARIANTS)
def test_most_random_releases_are_certified_and_no_sooner_than_ruckig(variant):
    valid = 0
    longer = []
    for problem, best in feasible_states(cell(), STATES, seed=17):
        motion = profiles.solve(problem, candidates(problem)[0], variant).trajectory
        if certify(problem, motion).valid:
            valid += 1
            longer.append(motion.release_time_s / best.release_time_s)
    assert valid >= 0.7 * STATES  # the others meet the floor or themselves on another way than Ruckig's
    assert np.median(longer) >= 0.99


def test_the_brake_follows_through_straight_along_the_velocity():
    problem = joint_problem()
    candidate = candidates(problem)[0]
    for variant in profiles.VARIANTS:
        motion = profiles.solve(problem, candidate, variant).trajectory
        along = candidate.qd / np.linalg.norm(candidate.qd)
        after = motion.q[motion.release_index :] - candidate.q
        np.testing.assert_allclose(after, np.outer(after @ along, along), atol=1e-5)


def test_the_ramp_accelerates_evenly_and_straight_into_the_release():
    slow = replace(cell().limits, qdd_max=cell().limits.qdd_max / 5)  # so that the ramp is long against the window
    problem = joint_problem(limits=slow)
    candidate = candidates(problem)[0]
    motion = profiles.solve(problem, candidate, "ramp").trajectory
    before = slice(motion.release_index - 100, motion.release_index - 20)
    along = candidate.qd / np.linalg.norm(candidate.qd)
    speed = motion.qd[before]
    np.testing.assert_allclose(speed, np.outer(speed @ along, along), atol=1e-3)
    steady = motion.qdd[before] @ along
    np.testing.assert_allclose(steady, steady.mean(), rtol=1e-3)
    assert np.abs(motion.qdd[before]).max() == pytest.approx(slow.qdd_max[0], rel=0.02)


def test_the_trapezoid_is_as_soon_as_ruckig_where_one_joint_decides():
    """Both are the double S of the slowest joint then; an independent solver confirms the averaging's width."""
    here = cell()
    release = JointRelease(here.home + np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0]), np.array([1.5, 0, 0, 0, 0, 0.0]))
    problem = joint_problem(release=release)
    candidate = candidates(problem)[0]
    ours, theirs = (solve(problem, candidate).trajectory for solve in (profiles.solve, ruckig_otg.solve))
    assert ours.release_time_s == pytest.approx(theirs.release_time_s, abs=4 * problem.dt)


def test_a_run_up_outside_the_range_is_refused_by_name():
    here = cell()
    near = here.home.copy()
    near[5] = here.limits.q_upper[5] - 0.05
    release = JointRelease(near, np.array([0.0, 0.0, 0.0, 0.0, 0.0, -2.5]))
    state = Candidate(release.q, release.qd, 0.0, "refused before any back end sees it")
    with pytest.raises(SolverFailed, match="wrist_3_joint"):
        profiles.solve(joint_problem(release=release), state, "ramp")


def test_the_status_reports_the_smoothing():
    problem = joint_problem()
    for variant, words in profiles.DESCRIPTIONS.items():
        status = profiles.solve(problem, candidates(problem)[0], variant).status
        assert words in status
        assert "without regard to jerk" in status
        assert "averaged over" in status


def test_a_lower_jerk_limit_takes_a_wider_window():
    here = cell()
    calm = replace(here.limits, jerk_max=here.limits.jerk_max / 5)
    problem = joint_problem(limits=calm)
    motion = profiles.solve(problem, candidates(problem)[0]).trajectory
    assert np.abs(motion.jerk).max() <= calm.jerk_max[0] * (1 + 1e-7)
    assert motion.release_time_s > profiles.solve(joint_problem(), candidates(problem)[0]).trajectory.release_time_s
