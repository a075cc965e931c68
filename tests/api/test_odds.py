"""Plans with a least hit probability: counted over drawn releases, apart from the forecast that the planner uses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.learning.plans import benchmark_cell
from jobs.planning import odds
from jobs.planning.odds import plan_for_odds
from learning import CellKnowledge, ReleasePosterior
from learning.joint_speeds import JointSpeeds
from learning.streamed_arm import StreamedArm
from planner.cell import Cell
from planner.certificate import release_flight, window_landing_points
from planner.errors import Infeasible, SolverFailed
from planner.planning import Plan, plan
from planner.problem import TIME_LIMIT_S, ThrowProblem
from planner.request import problem_from_request
from tests.api.conftest import RunningService
from tests.api.test_bad_input import problem_of

TARGET = [-0.9, 0.9, 0.0]
RADIUS_M = 0.05
JITTER_S = 0.004


def jittery_cell() -> Cell:
    cell = benchmark_cell()
    return replace(cell, gripper=replace(cell.gripper, jitter_s=JITTER_S))


def known_but_for(jitter_s: float = JITTER_S, scatter_rad_s: float = 1e-6) -> CellKnowledge:
    """Everything of the cell is known, but for what varies from throw to throw."""
    cell = benchmark_cell()
    mean = np.array([[cell.gripper.delay_s + cell.timing.lag_s, 1.0, 0.0, 0.0, 0.0, 0.0]])
    certain = np.diag([1e-12, 1e-12, 1e-12, 1e-12, 1e-12, 1e-12])[None]
    release = ReleasePosterior(np.ones(1), mean, certain, np.array([jitter_s]), np.array([scatter_rad_s]), 1e-9, 1.0)
    speeds = JointSpeeds(np.zeros(6), np.zeros(6), 1e6, 1e-6)
    return CellKnowledge(StreamedArm(cell.timing.lag_s, np.ones(6)), release, speeds)


def problem(**changes: Any) -> ThrowProblem:
    request = {"release": {"kind": "target", "position": TARGET}, "landing_tolerance_m": RADIUS_M}
    return problem_from_request({**request, "release_window_s": 0.0, **changes}, jittery_cell())


def counted_odds(found: Plan) -> float:
    """Returns the share of 4,000 releases, early and late by the jitter, that land within the radius."""
    late = JITTER_S * np.random.default_rng(1).standard_normal(4000)
    points = window_landing_points(
        found.problem, found.trajectory, np.clip(late, -found.trajectory.release_time_s, 1.0)
    )
    return float((np.linalg.norm(points[:, :2] - TARGET[:2], axis=1) < RADIUS_M).mean())


@pytest.fixture(scope="module")
def soonest() -> Plan:
    return plan(problem())


def test_the_soonest_plan_is_kept_where_it_reaches_the_odds(soonest: Plan):
    found = plan_for_odds(problem(), 0.3, known_but_for(), is_learnt=False)
    assert counted_odds(soonest) > 0.3
    np.testing.assert_array_equal(found.trajectory.q, soonest.trajectory.q)


def test_release_time_is_traded_for_odds(soonest: Plan):
    assert counted_odds(soonest) < 0.9
    found = plan_for_odds(problem(), 0.95, known_but_for(), is_learnt=False)
    assert counted_odds(found) > 0.93
    assert soonest.trajectory.release_time_s < found.trajectory.release_time_s < 0.3
    assert found.problem.release_window_s in (pytest.approx(k * JITTER_S, rel=1e-3) for k in (1, 2, 3, 5))


def test_a_slower_throw_is_tried_where_no_window_helps(soonest: Plan):
    """Joint speeds that scatter: a window does not protect against them, a slower throw does."""
    shaky = known_but_for(jitter_s=0.001, scatter_rad_s=0.10)
    longest = replace(soonest.problem, release_window_s=0.005, landing_tolerance_m=RADIUS_M)
    robust = plan(longest)
    with_window = shaky.predicted(robust.problem, robust.trajectory).hit_probability(np.array(TARGET[:2]), RADIUS_M)
    found = plan_for_odds(problem(), with_window + 0.05, shaky, is_learnt=False)
    speeds = [release_flight(made.problem, made.trajectory).speed_m_s for made in (robust, found)]
    assert speeds[1] < 0.95 * speeds[0]


def test_odds_that_no_plan_reaches_are_refused_with_the_best():
    with pytest.raises(Infeasible) as refusal:
        plan_for_odds(problem(), 1.0, known_but_for(scatter_rad_s=0.3), is_learnt=False)
    (violation,) = refusal.value.violations
    assert (violation.constraint, violation.limit, violation.proven) == ("hit_probability", 1.0, False)
    assert 0.1 < violation.value < 1.0
    nearest = refusal.value.nearest
    assert nearest is not None
    assert nearest["min_hit_probability"] == pytest.approx(violation.value, abs=1.1e-3)
    again = problem_from_request(nearest, jittery_cell())
    found = plan_for_odds(again, nearest["min_hit_probability"], known_but_for(scatter_rad_s=0.3), is_learnt=False)
    assert found.problem.release_window_s == again.release_window_s  # its first plan reaches them


def test_another_back_end_plans_as_asked_for():
    asked = problem(backend="ruckig")
    with pytest.raises(Infeasible, match="hit_probability"):
        plan_for_odds(asked, 0.999, known_but_for(), is_learnt=False)
    found = plan_for_odds(asked, 0.05, known_but_for(), is_learnt=False)
    np.testing.assert_array_equal(found.trajectory.q, plan(asked).trajectory.q)


def test_the_time_limit_ends_the_search_with_what_was_found(soonest: Plan):
    with pytest.raises(SolverFailed) as refusal:
        plan_for_odds(
            problem(time_limit_s=soonest.solve_time_s), 1.0, known_but_for(scatter_rad_s=0.3), is_learnt=False
        )
    assert refusal.value.status == "time_limit"


def test_a_plan_below_the_odds_whose_search_was_cut_short_is_no_proof_that_none_reaches_them(
    monkeypatch, soonest: Plan
):
    monkeypatch.setattr(odds, "plan_aimed", lambda *_asked: replace(soonest, was_cut_short=True))
    with pytest.raises(SolverFailed) as refusal:
        plan_for_odds(problem(backend="ruckig", time_limit_s=9.0), 0.999, known_but_for(), is_learnt=False)
    assert [violation.constraint for violation in refusal.value.violations] == ["hit_probability"]
    assert refusal.value.nearest["time_limit_s"] == TIME_LIMIT_S


def test_the_service_answers_with_the_odds_or_refuses(service: RunningService):
    request = {"release": {"kind": "target", "position": TARGET}, "landing_tolerance_m": 0.1}
    made = service.client.post("/plan", json={**request, "min_hit_probability": 0.4})
    assert made.status_code == 201, made.text
    assert made.json()["hit_probability"]["value"] >= 0.4
    assert made.json()["request"]["min_hit_probability"] == 0.4
    asked = {**request, "backend": "ruckig", "min_hit_probability": 0.999}
    refused = problem_of(service.client.post("/plan", json=asked), 422, "infeasible")
    (violation,) = refused["violations"]
    assert violation["constraint"] == "hit_probability"
    assert refused["nearest"]["min_hit_probability"] == pytest.approx(violation["value"], abs=1.1e-3)
