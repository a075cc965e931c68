"""Candidates from the releases of neighbouring plans throw to the target, and a search from them is certified."""

from dataclasses import replace

import numpy as np
import pytest

from planner.certificate import certify
from planner.errors import Infeasible
from planner.flight import fly
from planner.geometry import tool_state
from planner.planning import SearchHints, plan
from planner.problem import TargetRelease
from planner.seeds import neighbour_candidates
from tests.planner.problems import cell, joint_problem


def target_problem(x: float, y: float, **changes):
    return joint_problem(release=TargetRelease(np.array([x, y, 0.0])), **changes)


@pytest.fixture(scope="module")
def neighbour():
    found = plan(target_problem(1.2, 0.3)).trajectory
    return found.q[found.release_index].tolist(), found.qd[found.release_index].tolist()


@pytest.mark.parametrize("turn_rad", [0.0, 0.9])  # of the base about z: frames matter
def test_their_flights_end_at_the_new_target(neighbour, turn_rad):
    c = np.cos(turn_rad)
    s = np.sin(turn_rad)
    here = cell()
    X_WB = here.X_WB.copy()
    X_WB[:2, :2] = np.array([[c, -s], [s, c]]) @ X_WB[:2, :2]
    target = np.array([[c, -s], [s, c]]) @ [1.25, 0.35]
    problem = target_problem(*target, cell=replace(here, X_WB=X_WB))
    (found,) = neighbour_candidates(problem, [neighbour])
    np.testing.assert_array_equal(found.q, neighbour[0])
    state = tool_state(problem.cell, found.q, found.qd)
    landed = fly(state.p_WT, state.v_WT, 0.0, problem.gravity)
    np.testing.assert_allclose(landed.landing_point[:2], target, atol=1e-9)


def test_a_search_from_a_neighbour_alone_is_certified(neighbour):
    problem = target_problem(1.25, 0.3)
    found = plan(problem, SearchHints(releases=(neighbour,)))
    assert certify(problem, found.trajectory).valid
    again = plan(problem, SearchHints(releases=(neighbour,)))
    np.testing.assert_array_equal(found.trajectory.q, again.trajectory.q)


def test_neighbours_that_are_too_far_are_refused_and_the_nearest_is_left_out(neighbour):
    with pytest.raises(Infeasible) as refused:
        plan(target_problem(-1.2, -0.3), SearchHints((neighbour,), offers_nearest=False))
    assert refused.value.violations
    assert not any(violation.proven for violation in refused.value.violations)
    assert refused.value.nearest is None
    (attempt,) = refused.value.attempts
    assert attempt["backend"] == "candidates"
    assert attempt["result"].startswith("the only release state found: none ")
