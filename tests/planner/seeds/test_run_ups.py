"""Run-ups against what defines them, and against the throws that were drawn before there were any."""

from dataclasses import replace

import numpy as np
import pytest

from planner.flight import fly
from planner.geometry import tool_pose, tool_state
from planner.problem import TargetRelease, ThrowProblem
from planner.rotations import pose, rotation_vector_to_matrix
from planner.seeds import least_time, run_ups, sampling
from planner.seeds.run_ups import FLIGHT_SHARES
from tests.planner.problems import cell

PLACES = [(0.9, 0.3, 0.0), (1.3, 0.2, 0.0), (0.6, -0.7, 0.2), (-0.8, 0.5, 0.0)]


def problem_of(place, **changes) -> ThrowProblem:
    here = cell()
    return replace(ThrowProblem(here, here.home, TargetRelease(np.array(place)), here.limits), **changes)


def tilted(problem: ThrowProblem) -> ThrowProblem:
    """The same problem on a tilted base that is turned, too."""
    X_WB = pose([0.1, -0.05, 0.1], rotation_vector_to_matrix([0.3, -0.2, 0.5]))
    return replace(problem, cell=replace(problem.cell, X_WB=X_WB))


@pytest.mark.parametrize("mounted", [lambda problem: problem, tilted])
@pytest.mark.parametrize("place", PLACES)
def test_run_ups_hit_the_target(place, mounted):
    problem = mounted(problem_of(place))
    q, qd = run_ups.run_ups(problem, problem.release)
    assert 0 < len(q) <= len(FLIGHT_SHARES)
    for state in zip(q, qd, strict=True):
        tool = tool_state(problem.cell, *state)
        flight = fly(tool.p_WT, tool.v_WT, problem.plane_z, problem.gravity_at_tool_speed)
        assert flight is not None
        assert flight.landing_point == pytest.approx(np.array(place), abs=1e-6)
        assert np.all(np.abs(state[1]) <= problem.limits.qd_max * (1.0 + 1e-9))


@pytest.mark.parametrize("place", PLACES)
def test_the_soonest_is_near_a_constant_acceleration_from_the_start(place):
    problem = problem_of(place)
    q, qd = run_ups.run_ups(problem, problem.release)
    soonest = int(least_time(q - problem.start, qd, problem.limits).argmin())
    least_s = float(least_time(q[soonest] - problem.start, qd[soonest], problem.limits))
    straight = qd[soonest] * least_s / 2.0
    assert np.abs(q[soonest] - problem.start - straight).max() < 0.25 * np.abs(straight).max()
    assert least_s < 1.35 * np.abs(qd[soonest] / problem.limits.qdd_max).max()


@pytest.mark.parametrize("place", PLACES)
def test_they_are_sooner_than_throws_from_postures_that_are_drawn(place):
    problem = problem_of(place)
    q, qd = run_ups.run_ups(problem, problem.release)
    drawn_q, drawn_qd = sampling._thrown(problem, problem.release.target, thorough=False)
    drawn_s = least_time(drawn_q - problem.start, drawn_qd, problem.limits).min()
    assert least_time(q - problem.start, qd, problem.limits).min() < 0.8 * drawn_s


def test_a_target_beyond_every_speed_has_none():
    problem = problem_of((30.0, 0.0, 0.0))
    q, qd = run_ups.run_ups(problem, problem.release)
    assert q.shape == qd.shape == (0, 6)


def test_a_target_where_the_tool_is_has_a_short_flight():
    problem = problem_of(tool_pose(cell(), cell().home[None])[0, :3, 3])
    q, qd = run_ups.run_ups(problem, problem.release)
    assert len(q) > 0
    assert np.isfinite(q).all() and np.isfinite(qd).all()
