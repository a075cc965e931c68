"""Calls of the optimiser that are ended: they would release too late, or find no step."""

from __future__ import annotations

import math
from pathlib import Path
from unittest.mock import Mock

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import linprog

from benchmarks.problem_sets import build
from planner.backends import ruckig_otg
from planner.backends.casadi_nlp import DEFAULT_MARGINS, SeedFailed, SolveOptions, fatrop, layout, solve, solver
from planner.backends.casadi_nlp.instance import Instance
from planner.cell import load_cell
from planner.planning import plan
from planner.problem import PointRelease, TargetRelease, ThrowProblem
from planner.search import policy
from planner.seeds import Seed, candidates
from tests.planner.backends import casadi_fatrop
from tests.planner.backends.casadi_fatrop import CasadiLaunch
from tests.planner.backends.whole_problem import whole_problem

CELL = load_cell(Path(__file__).parents[3] / "cells" / "ur5e-sim.toml")
RNG = np.random.default_rng(5)

PROBLEMS = {
    "target": ThrowProblem(CELL, CELL.home, TargetRelease(np.array([0.9, -0.5, 0.0])), CELL.limits),
    "window": ThrowProblem(
        CELL,
        CELL.home,
        TargetRelease(np.array([0.9, -0.5, 0.0])),
        CELL.limits,
        release_window_s=0.02,
        landing_tolerance_m=0.03,
    ),
    "point": ThrowProblem(
        CELL, CELL.home, PointRelease(np.array([0.5, 0.1, 0.6]), np.array([1.5, 0.3, 0.5])), CELL.limits
    ),
}


def _seed(problem: ThrowProblem) -> Seed:
    candidate = candidates(problem)[0]
    return Seed(candidate, ruckig_otg.solve(problem, candidate).trajectory)


@pytest.fixture(scope="module", params=list(PROBLEMS))
def instance(request: pytest.FixtureRequest) -> Instance:
    problem = PROBLEMS[request.param]
    return Instance.of(problem, _seed(problem), DEFAULT_MARGINS)


def _calls(latest_s: float = math.inf) -> solver.Solver:
    return solver.Solver(1000, None, frozenset(), with_ipopt=False, latest_s=latest_s)


def _solved(instance: Instance) -> tuple[float, int]:
    """Returns the release time of a call's solution [s], and its iterations."""
    calls = _calls()
    z = calls._without_other_groups(instance, instance.arguments)
    assert z is not None
    return float(-z[0, layout.TIME] * instance.scales[layout.TIME]), calls.iterations


def test_a_call_ends_before_it_converges_where_it_would_release_too_late(instance: Instance) -> None:
    release_s, iterations = _solved(instance)
    calls = _calls(0.97 * release_s)
    assert calls.try_solve(instance) is None
    assert calls.is_late
    assert calls.status == f"would release after {0.97 * release_s:.3f} s, no sooner than another"
    assert 2 < calls.iterations < iterations - 2


def test_a_call_that_releases_in_time_is_not_changed(instance: Instance) -> None:
    release_s, _ = _solved(instance)
    found = [_calls(latest_s)._without_other_groups(instance, instance.arguments) for latest_s in (math.inf, release_s)]
    assert found[0] is not None
    assert found[1] is not None
    assert found[0].tobytes() == found[1].tobytes()


@pytest.mark.parametrize("share", [0.6, 0.9, 0.99, 1.01])
def test_casadi_s_interface_ends_where_the_extension_does(
    instance: Instance, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    release_s, _ = _solved(instance)
    found = []
    for launch in (fatrop.launch_of, CasadiLaunch):
        monkeypatch.setattr(solver, "launch_of", launch)
        calls = _calls(share * release_s)
        z = calls._without_other_groups(instance, instance.arguments)
        found.append((calls.is_late, calls.iterations, calls.status, None if z is None else z.tobytes()))
    assert found[0] == found[1]
    assert found[0][0] is (share < 1.0)


@pytest.mark.parametrize("launch", [fatrop.launch_of, CasadiLaunch])
def test_a_call_that_finds_no_step_is_ended(
    instance: Instance, launch: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No motion takes a third of the time: fatrop looks for what comes close to one, for 30 iterations and more."""
    monkeypatch.setattr(solver, "launch_of", launch)
    z = _calls().solve(instance)
    release_s = float(-z[0, layout.TIME])
    end_s = float(z[-1, layout.TIME] - z[0, layout.TIME])
    hurried = instance.on_times(z, release_s / 3.0, release_s / 3.0 + end_s - release_s)
    usual = solver._fatrop_options(instance.stages, instance)
    spent = []
    given = solver._fatrop_options(instance.stages, hurried)
    for allowed in (0, 5, 1000):
        options = Mock(return_value={**given, fatrop.RESTORATIONS: allowed})
        monkeypatch.setattr(solver, "_fatrop_options", options)
        calls = _calls()
        assert calls._without_other_groups(hurried, hurried.arguments) is None
        assert not calls.is_late
        spent.append(calls.iterations)
    assert spent[0] + 5 <= spent[1] < spent[2]
    fewest = 0 if isinstance(instance.problem.release, PointRelease) else 30
    assert usual[fatrop.RESTORATIONS] == fewest


def test_times_that_are_given_are_not_too_late(instance: Instance) -> None:
    z = _calls().solve(instance)
    end_s = float(z[-1, layout.TIME] - z[0, layout.TIME])
    given = instance.on_times(z, float(-z[0, layout.TIME]), end_s)
    assert _calls(0.5 * end_s)._latest_scaled(given) == math.inf
    assert _calls(0.5)._latest_scaled(given.brake_alone(z, None)) == math.inf
    assert _calls(0.5)._latest_scaled(instance) == pytest.approx(0.5 / instance.scales[layout.TIME])


def test_a_seed_that_is_ended_is_late() -> None:
    problem = PROBLEMS["point"]
    soonest = solve(problem, _seed(problem)).trajectory.release_time_s
    with pytest.raises(SeedFailed, match="would release after") as failed:
        solve(problem, _seed(problem), SolveOptions(latest_s=0.9 * soonest))
    assert failed.value.is_late
    assert solve(problem, _seed(problem), SolveOptions(latest_s=soonest)).trajectory.release_time_s == soonest


def test_the_estimate_of_a_linear_program_is_a_lower_bound_that_its_multipliers_attain() -> None:
    """Weak and strong duality, by scipy's linear programs: least -x[TIME] with A x >= b, within bounds."""
    n = layout.TIME + 1
    m = 12
    A = RNG.normal(size=(m, n))
    low = RNG.uniform(-2.0, -1.0, n)
    high = RNG.uniform(1.0, 2.0, n)
    low[layout.TIME] = -5.0
    high[layout.TIME] = -1.0  # like the time of a start before the release
    b = A @ RNG.uniform(low, high) - 0.1
    cost = -np.eye(n)[layout.TIME]
    best = linprog(cost, A_ub=-A, b_ub=-b, bounds=np.column_stack([low, high]))
    assert best.success
    x, p, weight, multipliers = (ca.SX.sym(name, size) for name, size in (("x", n), ("p", 1), ("w", 1), ("m", m)))
    slope = weight * ca.SX(cost) + ca.SX(A.T) @ multipliers
    functions = {
        "g": ca.Function("g", [x, p], [ca.SX(A) @ x]),
        "hess_l": ca.Function("hess_l", [x, p, weight, multipliers], [slope]),
    }
    given = {"p": np.zeros(1), "lbx": low, "ubx": high, "lbg": b, "ubg": np.full(m, np.inf)}

    def estimate(at: np.ndarray, by: np.ndarray) -> float:
        return casadi_fatrop._least_release(functions, given, at, by)

    at_optimum = best.ineqlin.marginals
    inside = RNG.uniform(low, high)
    assert estimate(inside, at_optimum) == pytest.approx(best.fun, abs=1e-9)
    others = [estimate(inside, -RNG.exponential(0.2, m)) for _ in range(200)]
    assert max(others) <= best.fun + 1e-9
    assert np.isfinite(others).any()


def test_multipliers_of_zero_say_nothing(instance: Instance) -> None:
    """fatrop begins anew with them where a step fails; the estimate would be the time of the iteration itself."""
    functions = whole_problem(instance.stages)
    arguments = dict(instance.arguments)
    n = len(arguments["x0"])
    arguments |= {"lbx": np.full(n, -np.inf), "ubx": np.full(n, np.inf)}
    rows = len(arguments["lbg"])
    assert casadi_fatrop._least_release(functions, arguments, arguments["x0"], np.zeros(rows)) == -math.inf


def test_a_search_is_as_soon_with_calls_that_are_ended_as_without(monkeypatch: pytest.MonkeyPatch) -> None:
    """A point from a random start; calls to two of its aspects are ended, or more.

    Whether what is unlike the answer is tried depends on the iterations, which are fewer; here it is in any case.
    """
    monkeypatch.setattr(policy, "FEW_ITERATIONS_AT_POINT", 1000)
    late = []
    note = solver.Solver._note_lateness

    def noting(self: solver.Solver, is_late: bool, what: str) -> None:
        late.append(what)
        note(self, is_late, what)

    monkeypatch.setattr(solver.Solver, "_note_lateness", noting)
    task = build("point-anywhere", 2, 0)[1]
    ended = plan(task.problem).trajectory
    assert sum(what.startswith("would release after") for what in late) > 1
    monkeypatch.setattr(solver.Solver, "_latest_scaled", lambda *_: math.inf)
    assert plan(task.problem).trajectory.release_time_s == ended.release_time_s
