"""Back ends requested by name: their own certified motion, and their own nearest request."""

import numpy as np
import pytest

from planner.certificate import certify
from planner.errors import Infeasible
from planner.planning import plan
from planner.problem import JointRelease
from planner.request import problem_from_request
from planner.search import VARIANTS_BY_BACKEND
from tests.planner.problems import cell, joint_problem, pose_problem


@pytest.mark.parametrize("backend", VARIANTS_BY_BACKEND)
def test_a_back_end_requested_by_name_answers_itself(backend):
    known = joint_problem().release
    assert isinstance(known, JointRelease)
    asked = pose_problem(cell(), known.q, known.qd)
    problem = joint_problem(release=asked.release, backend=backend)
    answer = plan(problem)
    assert answer.backend == backend
    assert [attempt.backend for attempt in answer.attempts] == [backend]
    assert certify(problem, answer.trajectory).valid


@pytest.mark.parametrize("backend", VARIANTS_BY_BACKEND)
def test_its_nearest_request_is_feasible_for_it(backend):
    too_fast = JointRelease(cell().home + 0.3, np.array([3.5, 0.0, 0.0, 0.0, 0.0, 0.0]))
    problem = joint_problem(release=too_fast, backend=backend)
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    nearest = refusal.value.nearest
    assert nearest is not None
    assert nearest["backend"] == backend
    assert plan(problem_from_request(nearest, problem.cell)).certificate.valid
