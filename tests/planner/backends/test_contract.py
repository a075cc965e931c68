"""The contract of every back end, over named problems."""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from planner.backends import casadi_nlp, profiles, ruckig_otg, toppra_path
from planner.backends.solution import Solution
from planner.certificate import certify
from planner.errors import BackendUnavailable, Infeasible, SolverFailed
from planner.problem import JointRelease, PointRelease, PoseRelease, TargetRelease, ThrowProblem
from planner.seeds import Candidate, Seed, candidates
from tests.planner.problems import cell, joint_problem, point_problem, pose_problem

Solve = Callable[[ThrowProblem, Candidate], Solution]


def optimal(problem: ThrowProblem, candidate: Candidate) -> Solution:
    """The optimiser from Ruckig's motion, as the planner uses it."""
    seed = Seed(candidate, ruckig_otg.solve(problem, candidate).trajectory)
    return casadi_nlp.solve(problem, seed, casadi_nlp.SolveOptions())


SOLVERS: dict[str, Solve] = {
    "casadi": optimal,
    **{f"ruckig {variant}": partial(ruckig_otg.solve, variant=variant) for variant in ruckig_otg.VARIANTS},
    **{f"toppra {variant}": partial(toppra_path.solve, variant=variant) for variant in toppra_path.VARIANTS},
    **{variant: partial(profiles.solve, variant=variant) for variant in profiles.VARIANTS},
}
OPTIONAL = {
    "casadi": (optimal, "casadi"),
    "ruckig": (ruckig_otg.solve, "ruckig"),
    "toppra": (toppra_path.solve, "toppra"),
}
CANDIDATES = 6  # a motion from one of so many release states must be certified


def tightened() -> ThrowProblem:
    limits = cell().limits
    return joint_problem(limits=replace(limits, qd_max=limits.qd_max / 2, jerk_max=limits.jerk_max / 4))


def pose() -> ThrowProblem:
    release = joint_problem().release
    assert isinstance(release, JointRelease)
    return pose_problem(cell(), release.q, release.qd)


def point() -> ThrowProblem:
    release = joint_problem().release
    assert isinstance(release, JointRelease)
    return point_problem(cell(), release.q, release.qd)


def target() -> ThrowProblem:
    return joint_problem(release=TargetRelease(np.array([-0.9, -0.3, 0.0])))


def at_the_velocity_limit() -> ThrowProblem:
    release = joint_problem().release
    assert isinstance(release, JointRelease)
    limits = replace(cell().limits, qd_max=np.abs(release.qd) + np.array([0.0, 0.3, 0.3, 0.0, 0.5, 0.5]))
    return joint_problem(limits=limits)


THROWS: dict[str, Callable[[], ThrowProblem]] = {
    "UR5e": joint_problem,
    "UR5 at 125 Hz": partial(joint_problem, "ur5-sim"),
    "UR3e": partial(joint_problem, "ur3e-sim"),
    "UR10e": partial(joint_problem, "ur10e-sim"),
    "tightened limits": tightened,
    "at the velocity limit": at_the_velocity_limit,
    "pose": pose,
    "point": point,
    "target": target,
}


def certified(problem: ThrowProblem, solve: Solve) -> tuple[Candidate, Solution]:
    """A release state and the first answer that the certificate accepts."""
    failures = []
    for candidate in candidates(problem)[:CANDIDATES]:
        try:
            solution = solve(problem, candidate)
        except SolverFailed as error:
            failures.append(error.status)
            continue
        certificate = certify(problem, solution.trajectory)
        if certificate.valid:
            return candidate, solution
        failures.append(str([check.name for check in certificate.failures]))
    raise AssertionError(failures)


NOT_OFFERED = {
    # Along a straight line of the tool a joint may have to be faster before the release than in it.
    ("toppra cartesian", "at the velocity limit"),
    # A point's or target's release state is the optimiser's own, not the candidate's: tested with the optimiser.
    ("casadi", "point"),
    ("casadi", "target"),
}
PAIRS = [(solver, throw) for solver in SOLVERS for throw in THROWS if (solver, throw) not in NOT_OFFERED]


@pytest.mark.parametrize(("solver", "throw"), PAIRS)
def test_a_throw_passes_its_release_and_is_certified(solver, throw):
    problem = THROWS[throw]()
    candidate, solution = certified(problem, SOLVERS[solver])
    motion = solution.trajectory
    k = motion.release_index
    np.testing.assert_array_equal(motion.q[0], problem.start)
    np.testing.assert_array_equal(motion.qd[0], 0.0)
    np.testing.assert_array_equal(motion.q[k], candidate.q)
    np.testing.assert_array_equal(motion.qd[k], candidate.qd)
    np.testing.assert_array_equal([motion.qd[-1], motion.qdd[-1]], 0.0)
    assert motion.sample_rate_hz == problem.cell.robot.sample_rate_hz
    assert 0 < k < len(motion.q) - 1
    assert candidate.bound_s <= motion.release_time_s + 1e-9
    assert solution.status


@pytest.mark.parametrize("solver", [solver for solver in SOLVERS if solver != "toppra smooth"])
def test_a_move_ends_at_rest(solver):
    here = cell()
    problem = joint_problem(release=JointRelease(here.home + np.array([0.3, 0.1, -0.2, 0.3, 0.1, 0.4]), np.zeros(6)))
    _, solution = certified(problem, SOLVERS[solver])
    motion = solution.trajectory
    assert motion.release_index == len(motion.q) - 1
    np.testing.assert_array_equal([motion.qd[-1], motion.qdd[-1]], 0.0)


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_same_problem_has_the_same_answer(solver):
    (_, first), (_, second) = (certified(joint_problem(), SOLVERS[solver]) for _ in range(2))
    np.testing.assert_array_equal(first.trajectory.q, second.trajectory.q)
    np.testing.assert_array_equal(first.trajectory.qdd, second.trajectory.qdd)
    assert first.status == second.status


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(
    "release",
    [
        PointRelease(np.array([2.0, 0.2, 0.5]), np.array([0.3, 0.0, 0.2])),
        PoseRelease(np.diag([1.0, -1.0, -1.0, 1.0]) + 3.0 * np.eye(4, k=3), np.full(6, 0.1)),
        JointRelease(cell().home + 0.3, np.array([3.5, 0.0, 0.0, 0.0, 0.0, 0.0])),
        JointRelease(cell().home + np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0]), np.full(6, 0.1)),
    ],
    ids=["too far", "pose too far", "too fast", "outside its range"],
)
def test_what_cannot_be_reached_is_refused(solver, release):
    with pytest.raises((Infeasible, SolverFailed)):
        certified(joint_problem(release=release), SOLVERS[solver])


@pytest.mark.parametrize("name", OPTIONAL)
def test_a_missing_library_is_named_with_its_extra(name, monkeypatch):
    solve, extra = OPTIONAL[name]
    monkeypatch.setitem(sys.modules, name, None)
    problem = joint_problem()
    with pytest.raises(BackendUnavailable, match=rf"fling-robotics\[{extra}\]"):
        solve(problem, candidates(problem)[0])
