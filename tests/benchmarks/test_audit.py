"""The independent audit of the benchmark accepts a certified plan and names every planted fault."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.audit import find_faults
from benchmarks.problem_sets import build, varied_tasks
from planner.cell import Box
from planner.planning import plan
from tests.planner.problems import cell


@pytest.fixture(scope="module")
def good():
    task = build("target", 4, 0)[0]
    problem = replace(task.problem, backend="ruckig")
    return problem, plan(problem).trajectory


def shifted(motion, joint, offset):
    q = np.array(motion.q)
    q[:, joint] += offset
    return replace(motion, q=q)


def limited(problem, **changes):
    return replace(problem, limits=replace(problem.limits, **changes))


def around(problem, **changes):
    return replace(problem, cell=replace(problem.cell, surroundings=replace(problem.cell.surroundings, **changes)))


def all_space(half):
    return (Box(np.full(3, -half), np.full(3, half)),)


SPOILT = {
    "lands at": lambda p, t: (p, shifted(t, 0, 0.01)),
    "velocity": lambda p, t: (limited(p, qd_max=0.9 * np.abs(t.qd).max(axis=0)), t),
    "acceleration": lambda p, t: (limited(p, qdd_max=0.9 * np.abs(t.qdd).max(axis=0)), t),
    "jerk": lambda p, t: (limited(p, jerk_max=0.9 * np.abs(t.jerk).max(axis=0)), t),
    "upper position": lambda p, t: (p, shifted(t, 5, 7.0)),
    "torque": lambda p, t: (limited(p, tau_max=0.1 * p.limits.tau_max), t),
    "tool speed": lambda p, t: (limited(p, tcp_speed_max=0.5), t),
    "floor": lambda p, t: (around(p, floor_z_m=0.6), t),
    "forbidden box": lambda p, t: (around(p, keep_out=all_space(5.0)), t),
    "outside a box": lambda p, t: (around(p, keep_in=all_space(0.1)), t),
    "self-collision": lambda p, t: (p, shifted(t, 2, 1.3)),
    "singularity": lambda p, t: (p, shifted(t, 4, -t.q[t.release_index, 4])),
    "does not start": lambda p, t: (p, shifted(t, 5, 1e-3)),
}


@pytest.mark.parametrize("fault", SPOILT)
def test_what_is_spoilt_is_named(good, fault):
    problem, motion = SPOILT[fault](*good)
    assert any(fault in text for text in find_faults(problem, motion))


def test_certified_plans_are_right(good):
    assert find_faults(*good) == []


def test_varied_problems_are_of_every_kind_and_their_plans_right():
    tasks = varied_tasks(cell(), 0, 18, 5)
    assert {type(task.problem.release).__name__ for task in tasks} == {
        "JointRelease",
        "PoseRelease",
        "PointRelease",
        "TargetRelease",
    }
    assert any(task.problem.is_robust for task in tasks)
    assert any(task.problem.ends_at_rest for task in tasks)
    rest = next(task.problem for task in tasks if task.problem.ends_at_rest)
    assert find_faults(rest, plan(rest).trajectory) == []
