"""Calls of the optimiser that are ended: they would release too late, or find no step."""

from __future__ import annotations

import math
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import linprog

from planner.arrays import Array
from planner.backends import ruckig_otg
from planner.backends.casadi_nlp import DEFAULT_MARGINS, SeedFailed, SolveOptions, fatrop, layout, solve, solver
from planner.backends.casadi_nlp.instance import Instance
from planner.cell import load_cell
from planner.problem import PointRelease, TargetRelease, ThrowProblem
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
    return solver.Solver(None, frozenset(), latest_s)


def _first(calls: solver.Solver, instance: Instance) -> Array:
    """Returns the solution of the first call alone, scaled."""
    return calls._with_groups(instance, instance.arguments)


def _release_s(instance: Instance, z: Array) -> float:
    return float(-z[0, layout.TIME] * instance.scales[layout.TIME])


def test_a_call_ends_before_it_converges_where_it_would_release_too_late(instance: Instance) -> None:
    usual = _calls()
    release_s = _release_s(instance, _first(usual, instance))
    calls = _calls(0.97 * release_s)
    with pytest.raises(solver.TooLate, match=f"would release after {0.97 * release_s:.3f} s, no sooner than another"):
        _first(calls, instance)
    assert 2 < calls.iterations < usual.iterations - 2


def test_a_call_that_releases_in_time_is_not_changed(instance: Instance) -> None:
    found = _first(_calls(), instance)
    in_time = _first(_calls(1.0001 * _release_s(instance, found)), instance)
    assert found.tobytes() == in_time.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.6, 0.9, 0.99, 1.01])
def test_casadi_s_interface_ends_where_the_extension_does(
    instance: Instance, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that what it is tested by is the same solver."""
    release_s = _release_s(instance, _first(_calls(), instance))
    found: list[tuple[int, bytes]] = []
    for launch in (fatrop.launch_of, CasadiLaunch):
        monkeypatch.setattr(solver, "launch_of", launch)
        calls = _calls(share * release_s)
        try:
            found.append((calls.iterations, _first(calls, instance).tobytes()))
        except solver.TooLate as error:
            found.append((error.iterations, b"late"))
    assert found[0] == found[1]
    assert (found[0][1] == b"late") is (share < 1.0)


def test_times_that_are_given_are_not_too_late(instance: Instance) -> None:
    z = _calls().solve(instance)
    release_s = 1.05 * float(-z[0, layout.TIME])
    given = instance.on_times(z, release_s, float(z[-1, layout.TIME]))
    found = _calls(0.5 * release_s)._with_groups(given, given.arguments)
    assert _release_s(given, found) == pytest.approx(release_s)


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
