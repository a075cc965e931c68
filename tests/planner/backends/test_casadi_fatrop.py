"""The extension's calls of fatrop against casadi's interface to it, and its matrix products against BLASFEO's own."""

from __future__ import annotations

import ctypes
import json
import math
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from planner.backends import ruckig_otg
from planner.backends.casadi_nlp import (
    DEFAULT_MARGINS,
    Margins,
    emission,
    fatrop,
    functions,
    layout,
    solver,
)
from planner.backends.casadi_nlp.flight_rows import constrains_flight
from planner.backends.casadi_nlp.instance import Instance
from planner.backends.casadi_nlp.layout import StageLayout
from planner.cell import Box, Cell, load_cell
from planner.errors import SolverFailed
from planner.native import OPTIMISER
from planner.problem import JointRelease, TargetRelease, ThrowProblem
from planner.seeds import Seed, candidates
from tests.planner.backends.casadi_fatrop import CasadiLaunch
from tests.planner.backends.whole_problem import whole_problem

CELL = load_cell(Path(__file__).parents[3] / "cells" / "ur5e-sim.toml")
WALL = Box(np.array([0.55, -0.8, 0.0]), np.array([0.6, 0.2, 0.3]), "wall")
RNG = np.random.default_rng(12)
CASADI = Path(ca.__file__).parent
C = OPTIMISER.parent / "optimiser"
TARGET = TargetRelease(np.array([0.9, -0.5, 0.0]))


def _instance(cell: Cell, window_s: float, margins: Margins = DEFAULT_MARGINS) -> Instance:
    robust = {"release_window_s": window_s, "landing_tolerance_m": 0.03} if window_s else {}
    problem = ThrowProblem(cell, cell.home, TARGET, cell.limits, **robust)
    candidate = candidates(problem)[0]
    return Instance.of(problem, Seed(candidate, ruckig_otg.solve(problem, candidate).trajectory), margins)


# With every group of rows; with a release window of several stages; with an object that is followed; beside a box.
INSTANCES = {
    "open": (CELL, 0.0),
    "window": (CELL, 0.02),
    "way out": (CELL, 0.0, Margins(leaves=True)),
    "ways out": (CELL, 0.02, Margins(leaves=True)),
    "wall": (replace(CELL, surroundings=replace(CELL.surroundings, keep_out=(WALL,))), 0.0),
}


@pytest.fixture(scope="module", params=list(INSTANCES))
def instance(request: pytest.FixtureRequest) -> Instance:
    return _instance(*INSTANCES[request.param])


@pytest.mark.parametrize("with_groups", [False, True])
def test_variables_and_iterations_are_those_of_casadi_s_interface(
    instance: Instance, with_groups: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    _is_solved_alike(instance, with_groups, monkeypatch)


def _is_solved_alike(instance: Instance, with_groups: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    groups = frozenset((*instance.stages.groups, solver.POSITIONS)) if with_groups else frozenset[str]()
    found = []
    for launch in (fatrop.launch_of, CasadiLaunch):
        monkeypatch.setattr(solver, "launch_of", launch)
        calls = solver.Solver(None, groups, math.inf)
        found.append((calls._with_groups(instance, instance.arguments).tobytes(), calls.iterations))
    assert found[0] == found[1]
    assert calls.iterations > 5


def test_variables_and_iterations_of_a_solve_that_is_given_up_are_those_too(
    instance: Instance, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that what counts as a solution is compared, too."""
    found = []
    monkeypatch.setitem(solver.FATROP, "max_iter", 8)
    monkeypatch.setattr(solver, "_breaks_no_row", lambda _part, x, _arguments: found.append(x.tobytes()))
    for launch in (fatrop.launch_of, CasadiLaunch):
        monkeypatch.setattr(solver, "launch_of", launch)
        with pytest.raises(SolverFailed, match="gave up") as error:
            solver.Solver(None, frozenset(), math.inf)._with_groups(instance, instance.arguments)
        found.append(error.value.iterations)
    assert found[:2] == found[2:]


def test_a_call_is_ended_after_its_time_and_not_changed_by_it(instance: Instance) -> None:
    part = instance.stages.with_groups(frozenset())
    reduced = solver.Solver(None, frozenset(), math.inf)._reduced(instance, part, instance.arguments)
    launch = fatrop.launch_of(part)
    whole = launch.solve(reduced, solver.FATROP)
    in_time = launch.solve(reduced, solver.FATROP, math.inf, 1e3)
    assert in_time.x.tobytes() == whole.x.tobytes()
    assert in_time[1:] == whole[1:]
    ended = launch.solve(reduced, solver.FATROP, math.inf, 0.0)
    assert ended.is_out_of_time
    assert not ended.is_solved
    assert ended.iterations == 1 < whole.iterations
    assert np.isnan(ended.x).all()


def test_a_solve_is_ended_in_the_middle_of_a_call(instance: Instance, monkeypatch: pytest.MonkeyPatch) -> None:
    looks = iter([0.0])
    monkeypatch.setattr(time, "perf_counter", lambda: next(looks))
    with pytest.raises(SolverFailed, match=solver.OUT_OF_TIME) as failure:
        solver.Solver(1e-9, frozenset(), math.inf)._with_groups(instance, instance.arguments)
    assert failure.value.iterations == 1


@pytest.mark.parametrize(("off", "is_solution"), [(0.0, True), (0.5, True), (2.0, False)])
def test_where_fatrop_gives_up_what_breaks_no_row_is_a_solution(
    instance: Instance, off: float, is_solution: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = solver.Solver(None, frozenset(), math.inf)
    solve = fatrop.Launch.solve
    expected = calls._with_groups(instance, instance.arguments)

    def given_up(launch: fatrop.Launch, *given: object) -> fatrop.Outcome:
        outcome = solve(launch, *given)  # pyright: ignore[reportArgumentType]
        outcome.x[layout.NZ] += off * solver.VIOLATED  # a joint position after the first stage
        return outcome._replace(is_solved=False)

    monkeypatch.setattr(fatrop.Launch, "solve", given_up)
    if not is_solution:
        with pytest.raises(SolverFailed, match="gave up"):
            calls._with_groups(instance, instance.arguments)
    elif off == 0.0:
        np.testing.assert_array_equal(calls._with_groups(instance, instance.arguments), expected)
    else:
        calls._with_groups(instance, instance.arguments)


@pytest.mark.parametrize(("has_converged", "is_late"), [(True, True), (False, False)])
def test_only_an_optimum_says_that_a_release_is_too_late(
    instance: Instance, has_converged: bool, is_late: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    solve = fatrop.Launch.solve

    def ended(launch: fatrop.Launch, arguments: object, options: object, *_limits: float) -> fatrop.Outcome:
        outcome = solve(launch, arguments, options)  # pyright: ignore[reportArgumentType]
        return outcome._replace(is_solved=has_converged)

    monkeypatch.setattr(fatrop.Launch, "solve", ended)
    with pytest.raises(SolverFailed) as error:
        solver.Solver(None, frozenset(), 0.01).solve(instance)
    assert isinstance(error.value, solver.TooLate) is is_late


def test_a_flight_that_is_free_is_constrained_from_the_first_solve_with_a_box_and_without() -> None:
    given = JointRelease(CELL.home + 0.3, np.full(6, 0.1))
    for cell in (CELL, INSTANCES["wall"][0]):
        for release, is_free in ((TARGET, True), (given, False)):
            problem = ThrowProblem(cell, cell.home, release, cell.limits)
            assert constrains_flight(problem)
            instance = Instance.of(problem, Seed(candidates(problem)[0]), DEFAULT_MARGINS)
            assert ("flight" in instance.first_groups) is is_free


def test_rows_are_those_of_casadi_s_functions(instance: Instance) -> None:
    launch = fatrop.launch_of(instance.stages)
    arguments = instance.arguments
    x = arguments["x0"] + RNG.uniform(-0.1, 0.1, len(arguments["x0"]))
    expected = functions.evaluate(whole_problem(instance.stages)["g"], x, arguments["p"])[0].ravel()
    np.testing.assert_array_equal(launch.rows(x, arguments["p"]), expected)
    assert np.abs(expected).max() > 0.1


def test_arrays_of_another_problem_are_refused(instance: Instance) -> None:
    launch = fatrop.launch_of(instance.stages)
    arguments = instance.arguments
    with pytest.raises(ValueError, match=r"bounds and \d+ variables do not fit"):
        launch.solve({**arguments, "lbg": arguments["lbg"][1:]}, {})
    with pytest.raises(ValueError, match="variables do not fit"):
        launch.rows(arguments["x0"][1:], arguments["p"])


def test_another_launch_from_the_same_arguments_gives_the_same(instance: Instance) -> None:
    launch = fatrop.launch_of(instance.stages)
    first, second = (launch.solve(instance.arguments, solver.FATROP) for _ in range(2))
    assert first[0].tobytes() == second[0].tobytes()
    assert first[1:] == second[1:]


def test_a_start_that_is_not_finite_is_not_solved(instance: Instance) -> None:
    launch = fatrop.launch_of(instance.stages)
    arguments = instance.arguments
    for name in ("x0", "p"):
        spoilt = arguments[name].copy()
        spoilt[5] = np.nan
        x, *outcome = launch.solve({**arguments, name: spoilt}, solver.FATROP)
        assert outcome == [0, False, False, False]
        assert np.isnan(x).all()  # so that nothing takes it for a solution


@pytest.mark.parametrize("calls", [0, 20])
def test_derivatives_that_are_not_finite_end_a_solve(instance: Instance, calls: int) -> None:
    """From such fatrop does not return."""
    launch = fatrop.Launch(instance.row_index)
    motion = launch._problem.block[0]
    made = []
    signature = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)
    slope = signature(motion.slope)

    def spoilt(z: int, p: int, rows: int, jacobian: int) -> None:
        slope(z, p, rows, jacobian)
        made.append(jacobian)
        if len(made) > calls:
            ctypes.cast(jacobian, ctypes.POINTER(ctypes.c_double))[0] = np.nan

    kept = signature(spoilt)
    motion.slope = ctypes.cast(kept, ctypes.c_void_p)
    x, iterations, is_solved, *_ = launch.solve(instance.arguments, solver.FATROP)
    assert not is_solved
    assert np.isnan(x).all()
    assert iterations <= solver.FATROP["max_iter"] + 1
    assert len(made) > calls


def test_options_reach_fatrop(instance: Instance) -> None:
    launch = fatrop.launch_of(instance.stages)
    _, iterations, is_solved, *_ = launch.solve(instance.arguments, {**solver.FATROP, "max_iter": 3})
    assert not is_solved
    assert iterations == 3 + 1  # of which fatrop counts the last


# --- matrix products ---

SIZE = 48  # rows and columns of the matrices compared: more than a stage's


class Matrix(ctypes.Structure):
    """`struct blasfeo_dmat`, panel-major: four rows at a time, column by column."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("mem", "pA", "dA")),
        *((name, ctypes.c_int) for name in ("m", "n", "pm", "cn", "use_dA", "memsize")),
    )


class BlasfeoVector(ctypes.Structure):
    """`struct blasfeo_dvec`."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("mem", "pa")),
        *((name, ctypes.c_int) for name in ("m", "pm", "memsize")),
    )


def _matrix(values: np.ndarray) -> Matrix:
    return Matrix(None, values.ctypes.data, None, SIZE, SIZE, SIZE, SIZE, 0, 0)


def _vector(values: np.ndarray) -> BlasfeoVector:
    return BlasfeoVector(None, values.ctypes.data, values.size, values.size, 0)


def _multiplied(library: ctypes.CDLL, name: str, rng: np.random.Generator) -> np.ndarray:
    """Returns D of D = alpha A B' + beta C, or z of z = alpha A x + beta y, among random numbers."""
    a, b, c, d = aligned = _aligned(4)
    aligned[:] = rng.uniform(-1.0, 1.0, aligned.shape)
    n = int(rng.integers(1, 40))
    m = n + int(rng.integers(3))
    k = int(rng.integers(41))
    columns = [int(i) for i in rng.integers(3, size=4)]
    rows = [int(i) for i in rng.choice([0, 0, 0, 1, 4], size=4)]
    alpha, beta = (ctypes.c_double(float(rng.choice(each))) for each in ([-1.0, 0.7], [0.0, 1.0]))
    places = list(zip(rows, columns, strict=True))
    if "gemv" in name:
        given = [m, n, alpha, _matrix(a), *places[0], _vector(b), 1, beta, _vector(c), 2, _vector(d), 3]
    else:
        depth = [_matrix(a), *places[0], _matrix(b), *places[1], beta, _matrix(c), *places[2], _matrix(d), *places[3]]
        given = [m, n, k, alpha, *depth]
    getattr(library, name)(*(ctypes.byref(x) if isinstance(x, ctypes.Structure) else x for x in given))
    return d.copy()


def _aligned(count: int) -> np.ndarray:
    """Returns matrices (count, SIZE, SIZE) at addresses that BLASFEO takes."""
    memory = np.zeros(count * SIZE * SIZE + 8)
    begin = (-memory.ctypes.data % 64) // 8
    return memory[begin : begin + count * SIZE * SIZE].reshape(count, SIZE, SIZE)


@pytest.fixture(scope="module")
def narrow_products(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The products compiled without wider instructions."""
    made = tmp_path_factory.mktemp("products") / "narrow.so"
    flags = ["-O2", "-ffp-contract=off", "-w", "-DWIDEST=", f"-I{CASADI / 'include'}", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, str(C / "products.c"), "-o", str(made)], check=True)
    return made


@pytest.mark.parametrize("name", ["dgemm_nt", "dsyrk_ln_mn", "dgemv_n", "dgemv_t"])
@pytest.mark.parametrize("is_narrow", [False, True])
def test_matrix_products_are_blasfeo_s_to_the_last_bit(name: str, is_narrow: bool, narrow_products: Path) -> None:
    """Of matrices that begin within a panel, too."""
    own = ctypes.CDLL(str(narrow_products if is_narrow else OPTIMISER))
    blasfeo = ctypes.CDLL(str(next(CASADI.glob("libblasfeo.so.0"))))
    for seed in range(200):
        expected, found = (
            _multiplied(library, f"blasfeo_{name}", np.random.default_rng(seed)) for library in (blasfeo, own)
        )
        np.testing.assert_array_equal(found, expected)


# --- the C of functions ---


def test_what_follows_from_parameters_alone_is_computed_once() -> None:
    x = ca.SX.sym("x", 2)
    p = ca.SX.sym("p", 2)
    text = emission.written([(ca.Function("f", [x, p], [ca.sin(p[0]) * p[1] + x]), (True, False))])
    body = text[text.index("void f_0") : text.index("static const long long f_in_0")]
    assert "double" in body
    assert "= sin(i1[0])" in body
    assert "sin_lanes" not in body


def test_parts_of_a_long_function_keep_what_later_ones_need() -> None:
    x = ca.SX.sym("x")
    terms = [ca.sin(k * x) for k in range(2, emission.PART)]
    text = emission.written([(ca.Function("f", [x], [ca.vertcat(sum(terms), *terms)]), (True,))])
    assert "void f_2(" in text
    assert "] = a" in text[text.index("void f_0(") : text.index("void f_1(")]


def test_an_operation_without_c_is_named() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(ValueError, match="f: operation"):
        emission.written([(ca.Function("f", [x], [ca.tanh(x)]), (True,))])


def test_the_launch_takes_the_sizes_that_python_does() -> None:
    source = (C / "launch.c").read_text()
    for name, value in (("STATES", layout.NX), ("CONTROLS", layout.NU), ("THROWN", layout.N_THROWN)):
        assert f"#define {name} {value}\n" in source
    assert f"#define ROWS_MAX {fatrop.ROWS_MAX} " in source


def test_a_solve_from_which_fatrop_does_not_return_is_left() -> None:
    """Found by the audit: these are the arguments of that solve, with the rows of today and a gripper that jitters."""
    stored = json.loads(Path(__file__).with_name("unreturned_launch.json").read_text(encoding="utf-8"))
    options = stored.pop("options")
    arguments = {name: np.array(values, float) for name, values in stored.items()}
    launch = fatrop.launch_of(StageLayout(launch=8, brake=3, groups=("clearance", "flight")))
    before = launch.solve(arguments, {**options, "max_iter": 20})
    for _ in range(3):
        variables, iterations, is_solved, *_ = launch.solve(arguments, options)
        assert not is_solved
        assert 0 < iterations < options["max_iter"]
        assert np.isnan(variables).all()
    after = launch.solve(arguments, {**options, "max_iter": 20})  # as if nothing had been
    assert np.isfinite(after[0]).all()
    assert np.array_equal(after[0], before[0])
    assert after[1:] == before[1:]
