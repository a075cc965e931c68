"""Aspects: their numbers, and the bound on the time to reach one against motions that do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.kinematics import forward, inverse_branches
from planner.problem import PointRelease, TargetRelease
from planner.seeds import ASPECTS, aspects, candidates, least_times_to_aspects
from planner.seeds.aspects import farthest
from tests.planner.problems import cell, joint_problem


def random_motions(problem, rng, count, steps, dt):
    """Returns joint positions (steps + 1, count, 6) of random motions from rest within the joint limits, by Euler."""
    limits = problem.limits
    q, qd, qdd = (np.tile(x, (count, 1)) for x in (problem.start, np.zeros(6), np.zeros(6)))
    favoured = rng.choice([-1.0, 1.0], (count, 6))
    path = [q]
    for _ in range(steps):
        jerk = limits.jerk_max * np.where(rng.uniform(size=(count, 6)) < 0.9, favoured, -favoured)
        qdd = np.clip(qdd + jerk * dt, -limits.qdd_max, limits.qdd_max)
        qd = np.clip(qd + qdd * dt, -limits.qd_max, limits.qd_max)
        q = q + qd * dt
        path.append(q)
    return np.array(path)


@pytest.mark.parametrize("name", ["ur5e-sim", "ur3e-sim", "ur10e-sim"])
def test_no_motion_reaches_an_aspect_before_its_bound(name):
    rng = np.random.default_rng(3)
    dt = 0.004
    reached = 0
    for _ in range(6):
        start = cell(name).home + rng.uniform(-0.8, 0.8, 6)
        problem = joint_problem(name, start=start)
        bound = least_times_to_aspects(problem)
        path = random_motions(problem, rng, 400, 200, dt)
        distances = np.abs(_signed(problem, path)).min(axis=-1)
        numbers = aspects(problem.cell.robot, path.reshape(-1, 6)).reshape(distances.shape)
        there = distances >= problem.limits.singularity_distance_min
        for aspect in range(ASPECTS):
            steps = np.flatnonzero((there & (numbers == aspect)).any(axis=1))
            if len(steps):
                reached += bound[aspect] > 0.0
                assert steps[0] * dt >= bound[aspect] - 2.0 * dt  # Euler's steps are ahead by one or two
    assert reached >= 6


def _signed(problem, q):
    """Returns wrist, elbow and shoulder distance (..., 3), written from the arm's geometry once more."""
    robot = problem.cell.robot
    lift, elbow, turn = (q[..., 1:n].sum(axis=-1) for n in (2, 3, 4))
    radius = robot.a[1] * np.cos(lift) + robot.a[2] * np.cos(elbow) + robot.d[4] * np.sin(turn)
    return np.stack([np.sin(q[..., 4]), np.sin(q[..., 2]), radius / np.abs(robot.a[1:3]).sum()], axis=-1)


def test_the_start_is_in_the_aspect_that_takes_no_time_to_reach():
    problem = joint_problem()
    own = int(aspects(problem.cell.robot, problem.start[None])[0])
    bound = least_times_to_aspects(problem)
    assert bound[own] == 0.0
    assert (np.delete(bound, own) > 0.1).all()


def test_the_farthest_way_is_that_of_full_jerk():
    problem = joint_problem()
    for factor in (1.0, 100.0, 0.01):
        limits = replace(problem.limits, jerk_max=factor * problem.limits.jerk_max)
        t = np.linspace(0.0, 1.5, 150_001)
        qdd = np.minimum(limits.jerk_max * t[:, None], limits.qdd_max)
        qd = np.minimum(np.cumsum(qdd, axis=0) * t[1], limits.qd_max)
        way = np.cumsum(qd, axis=0) * t[1]
        np.testing.assert_allclose(farthest(t[::5000], limits), way[::5000], atol=2e-3)


def test_the_branches_of_a_pose_lie_in_different_aspects():
    here = cell()
    q = here.home + np.array([0.3, -0.2, 0.4, 0.1, 0.2, 0.5])
    branches, _ = inverse_branches(here.robot, forward(here.robot, q, here.tool.X_FT)[None], here.tool.X_FT)
    branches = branches[0]
    branches = branches[np.isfinite(branches).all(axis=-1)]
    assert len(branches) == ASPECTS
    assert len(set(aspects(here.robot, branches).tolist())) == ASPECTS


@pytest.mark.parametrize(
    "release",
    [
        PointRelease(np.array([0.45, 0.25, 0.55]), np.array([0.5, 0.3, 0.6])),
        TargetRelease(np.array([1.0, 0.3, 0.0])),
    ],
)
def test_candidates_are_in_every_aspect_that_has_a_slow_enough_throw(release):
    problem = joint_problem(release=release)
    found = candidates(problem)
    numbers = aspects(problem.cell.robot, np.array([candidate.q for candidate in found]))
    assert len(set(numbers.tolist())) >= 4
    assert [candidate.bound_s for candidate in found] == sorted(candidate.bound_s for candidate in found)
