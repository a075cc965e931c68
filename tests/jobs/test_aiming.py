"""Aims for a learnt cell: where the whole correction has no plan, the smaller one is tried."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.learning.plans import benchmark_cell
from jobs.planning.aiming import place_of_target, plan_aimed
from learning import CellKnowledge
from planner.answer import aimed_problem
from planner.errors import Infeasible
from planner.planning import Plan, plan
from planner.problem import ThrowProblem
from planner.request import problem_from_request
from tests.api.test_odds import known_but_for

LEAVES_AT = 0.96  # [-] of the tool's speed, as the cell is known: throws fall short
BIN = {"radius_m": 0.15, "rim_height_m": 0.2}


def problem(most_m_s: float) -> ThrowProblem:
    """Returns a throw into a bin from a given place, at a given speed at most."""
    release: dict[str, Any] = {"kind": "target", "position": [1.1, 0.3, 0.0], "opening": BIN}
    release |= {"release_position": [0.7, 0.2, 0.6], "max_release_speed_m_s": most_m_s}
    request = {"release": release, "landing_tolerance_m": 0.13, "release_window_s": 0.0}
    return problem_from_request(request, benchmark_cell())


def known() -> CellKnowledge:
    certain = known_but_for(jitter_s=1e-4)
    mean = certain.release.mean.copy()
    mean[0, 1] = LEAVES_AT
    return replace(certain, release=replace(certain.release, mean=mean))


def missed(asked: ThrowProblem, found: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Returns where a plan aims (2,) [m], and where its landing is, from the target."""
    guess = known().predicted(found.problem, found.trajectory)
    place = place_of_target(asked, found)[:2]
    return guess.aimed - place, guess.center - place


def test_a_throw_that_may_be_faster_is_brought_to_the_middle_between_rim_and_landing() -> None:
    asked = problem(1.4)
    aimed, _ = missed(asked, plan_aimed(asked, known()))
    assert np.linalg.norm(aimed) < 2e-3


def test_where_that_has_no_plan_the_landing_is_brought_onto_the_target() -> None:
    asked = problem(1.2)
    first = plan(asked)
    aimed, center = missed(asked, first)
    with pytest.raises(Infeasible):
        plan(aimed_problem(asked, -np.append(aimed, 0.0)))
    found = plan_aimed(asked, known())
    shift = found.problem.release.p_W - asked.release.p_W
    np.testing.assert_allclose(shift, -np.append(center, 0.0), atol=1e-9)
    assert np.linalg.norm(missed(asked, found)[0]) < np.linalg.norm(aimed) - 0.005
    assert np.linalg.norm(missed(asked, found)[1]) < 2e-3


def test_each_correction_moves_the_throw_in_hand_and_all_are_told() -> None:
    asked = problem_from_request({"release": {"kind": "target", "position": [1.1, 0.3, 0.0]}}, benchmark_cell())
    first = plan(asked)
    found = plan_aimed(asked, known())
    results = [each.result for each in found.attempts]
    of_first = [each.result for each in first.attempts]
    assert results[: len(of_first)] == of_first
    assert set(results[len(of_first) :]) == {"moved throw: certified"}
    assert found.solve_time_s > sum(each.duration_s for each in found.attempts)


def test_a_correction_is_made_at_the_landing_that_the_plan_meets() -> None:
    moves = {"velocity": [0.0, 0.4, 0.0], "observed_at_s": 100.0}
    release = {"kind": "target", "position": [1.1, -0.5, 0.0], **moves}
    asked = problem_from_request({"release": release, "starts_not_before_s": 100.5}, benchmark_cell())
    first = plan(asked)
    found = plan_aimed(asked, known())
    assert first.problem.moving is not None
    assert found.problem.moving is not None
    assert found.problem.moving.at_s == pytest.approx(first.problem.moving.at_s, abs=0.06)
    assert found.attempts[-1].result == "moved throw: certified"
    assert np.linalg.norm(missed(asked, found)[0]) < 2e-3
