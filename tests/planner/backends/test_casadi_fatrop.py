"""The compiled launch against casadi's interface to fatrop, and its matrix products against BLASFEO's own."""

from __future__ import annotations

import ctypes
import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from planner.backends import ruckig_otg
from planner.backends.casadi_nlp import (
    DEFAULT_MARGINS,
    Margins,
    codegen,
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
from planner.kernel import compile_once
from planner.problem import JointRelease, TargetRelease, ThrowProblem
from planner.seeds import Seed, candidates

CELL = load_cell(Path(__file__).parents[3] / "cells" / "ur5e-sim.toml")
WALL = Box(np.array([0.55, -0.8, 0.0]), np.array([0.6, 0.2, 0.3]), "wall")
RNG = np.random.default_rng(12)
TARGET = TargetRelease(np.array([0.9, -0.5, 0.0]))

needs_launch = pytest.mark.skipif(fatrop._libraries() is None, reason="nothing is compiled")


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


@needs_launch
@pytest.mark.parametrize("with_groups", [False, True])
def test_variables_and_iterations_are_those_of_casadi_s_interface(
    instance: Instance, with_groups: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    _is_solved_alike(instance, with_groups, monkeypatch)


def _is_solved_alike(instance: Instance, with_groups: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    groups = frozenset((*instance.stages.groups, solver.POSITIONS)) if with_groups else frozenset[str]()
    found = []
    for launch in (fatrop.compiled_launch, lambda _stages: None):
        monkeypatch.setattr(solver, "compiled_launch", launch)
        calls = solver.Solver(1000, None, groups, math.inf)
        found.append((calls._with_groups(instance, instance.arguments).tobytes(), calls.iterations))
    assert found[0] == found[1]
    assert calls.iterations > 5


@needs_launch
def test_variables_and_iterations_of_a_solve_that_is_given_up_are_those_too(
    instance: Instance, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that what counts as a solution does not depend on whether anything is compiled."""
    found = []
    monkeypatch.setitem(solver.FATROP, "max_iter", 8)
    monkeypatch.setattr(solver, "_breaks_no_row", lambda _part, x, _arguments: found.append(x.tobytes()))
    for launch in (fatrop.compiled_launch, lambda _stages: None):
        monkeypatch.setattr(solver, "compiled_launch", launch)
        with pytest.raises(SolverFailed, match="gave up") as error:
            solver.Solver(1000, None, frozenset(), math.inf)._with_groups(instance, instance.arguments)
        found.append(error.value.iterations)
    assert found[:2] == found[2:]


@needs_launch
@pytest.mark.parametrize(("off", "is_solution"), [(0.0, True), (0.5, True), (2.0, False)])
def test_where_fatrop_gives_up_what_breaks_no_row_is_a_solution(
    instance: Instance, off: float, is_solution: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = solver.Solver(1000, None, frozenset(), math.inf)
    solve = fatrop.CompiledLaunch.solve
    expected = calls._with_groups(instance, instance.arguments)

    def given_up(launch: fatrop.CompiledLaunch, *given: object) -> fatrop.Outcome:
        outcome = solve(launch, *given)  # pyright: ignore[reportArgumentType]
        outcome.x[layout.NZ] += off * solver.VIOLATED  # a joint position after the first stage
        return outcome._replace(is_solved=False)

    monkeypatch.setattr(fatrop.CompiledLaunch, "solve", given_up)
    if not is_solution:
        with pytest.raises(SolverFailed, match="gave up"):
            calls._with_groups(instance, instance.arguments)
    elif off == 0.0:
        np.testing.assert_array_equal(calls._with_groups(instance, instance.arguments), expected)
    else:
        calls._with_groups(instance, instance.arguments)


@needs_launch
@pytest.mark.parametrize(("has_converged", "is_late"), [(True, True), (False, False)])
def test_only_an_optimum_says_that_a_release_is_too_late(
    instance: Instance, has_converged: bool, is_late: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    solve = fatrop.CompiledLaunch.solve

    def ended(launch: fatrop.CompiledLaunch, arguments: object, options: object, _latest: float) -> fatrop.Outcome:
        outcome = solve(launch, arguments, options)  # pyright: ignore[reportArgumentType]
        return outcome._replace(is_solved=has_converged)

    monkeypatch.setattr(fatrop.CompiledLaunch, "solve", ended)
    with pytest.raises(SolverFailed) as error:
        solver.Solver(1000, None, frozenset(), 0.01).solve(instance)
    assert isinstance(error.value, solver.TooLate) is is_late


def test_a_flight_that_is_free_is_constrained_from_the_first_solve_with_a_box_and_without() -> None:
    given = JointRelease(CELL.home + 0.3, np.full(6, 0.1))
    for cell in (CELL, INSTANCES["wall"][0]):
        for release, is_free in ((TARGET, True), (given, False)):
            problem = ThrowProblem(cell, cell.home, release, cell.limits)
            assert constrains_flight(problem)
            instance = Instance.of(problem, Seed(candidates(problem)[0]), DEFAULT_MARGINS)
            assert ("flight" in instance.first_groups) is is_free


@needs_launch
def test_rows_are_those_of_casadi_s_functions(instance: Instance) -> None:
    launch = fatrop.compiled_launch(instance.stages)
    arguments = instance.arguments
    assert launch is not None
    x = arguments["x0"] + RNG.uniform(-0.1, 0.1, len(arguments["x0"]))
    expected = functions.evaluate(instance.transcription.functions["g"], x, arguments["p"])[0].ravel()
    np.testing.assert_array_equal(launch.rows(x, arguments["p"]), expected)
    assert np.abs(expected).max() > 0.1


@needs_launch
def test_arrays_of_another_problem_are_refused(instance: Instance) -> None:
    launch = fatrop.compiled_launch(instance.stages)
    arguments = instance.arguments
    assert launch is not None
    with pytest.raises(ValueError, match=r"bounds and \d+ variables do not fit"):
        launch.solve({**arguments, "lbg": arguments["lbg"][1:]}, {})
    with pytest.raises(ValueError, match="variables do not fit"):
        launch.rows(arguments["x0"][1:], arguments["p"])


@needs_launch
def test_another_launch_from_the_same_arguments_gives_the_same(instance: Instance) -> None:
    launch = fatrop.compiled_launch(instance.stages)
    assert launch is not None
    first, second = (launch.solve(instance.arguments, solver.FATROP) for _ in range(2))
    assert first[0].tobytes() == second[0].tobytes()
    assert first[1:] == second[1:]


@needs_launch
def test_a_start_that_is_not_finite_is_not_solved(instance: Instance) -> None:
    launch = fatrop.compiled_launch(instance.stages)
    arguments = instance.arguments
    assert launch is not None
    for name in ("x0", "p"):
        spoilt = arguments[name].copy()
        spoilt[5] = np.nan
        x, *outcome = launch.solve({**arguments, name: spoilt}, solver.FATROP)
        assert outcome == [0, False, False]
        assert np.isnan(x).all()  # so that nothing takes it for a solution


@needs_launch
@pytest.mark.parametrize("calls", [0, 20])
def test_derivatives_that_are_not_finite_end_a_solve(instance: Instance, calls: int) -> None:
    """From such fatrop does not return."""
    libraries = fatrop._libraries()
    assert libraries is not None
    launch = fatrop.CompiledLaunch(instance.transcription.row_index, *libraries)
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
    x, iterations, is_solved, _ = launch.solve(instance.arguments, solver.FATROP)
    assert not is_solved
    assert np.isnan(x).all()
    assert iterations <= solver.FATROP["max_iter"] + 1
    assert len(made) > calls


def test_options_reach_fatrop(instance: Instance) -> None:
    launch = fatrop.compiled_launch(instance.stages)
    if launch is None:
        pytest.skip("nothing is compiled")
    _, iterations, is_solved, _ = launch.solve(instance.arguments, {**solver.FATROP, "max_iter": 3})
    assert not is_solved
    assert iterations == 3 + 1  # of which fatrop counts the last


# --- matrix products ---


def _launch_compiled(folder: Path, *more: str) -> ctypes.CDLL:
    flags = (*codegen.LAUNCH_FLAGS, "-mavx2", f"-I{codegen.CASADI / 'include'}", *more)
    text = "\n".join(file.read_text() for file in codegen.LAUNCH_C)
    made = compile_once(folder / "launch.so", flags, lambda: [text], codegen._linked())
    assert made is not None
    return ctypes.CDLL(str(made))


needs_avx2 = pytest.mark.skipif(
    codegen._processor_flags() != codegen.AVX2 or shutil.which("cc") is None, reason="no compiler, or no AVX2"
)


@needs_avx2
def test_matrix_products_are_blasfeo_s_to_the_last_bit(tmp_path: Path) -> None:
    assert _launch_compiled(tmp_path).linear_algebra_agrees() == 1


@needs_avx2
def test_products_that_round_otherwise_are_not_used(tmp_path: Path) -> None:
    fused = _launch_compiled(tmp_path, "-mfma", "-ffp-contract=fast")
    assert fused.linear_algebra_agrees() == 0


# --- the C of functions ---


def test_what_follows_from_parameters_alone_is_computed_once() -> None:
    x = ca.SX.sym("x", 2)
    p = ca.SX.sym("p", 2)
    text = emission.written([(ca.Function("f", [x, p], [ca.sin(p[0]) * p[1] + x]), (True, False))])
    body = text[text.index("void f_lanes") : text.index("static const long long f_in_0")]
    assert "double" in body
    assert "= sin(a" in body
    assert "sin_lanes" not in body


def test_an_operation_without_c_is_named() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(ValueError, match="f: operation"):
        emission.written([(ca.Function("f", [x], [ca.tanh(x)]), (True,))])


def test_compiled_units_are_one_library(tmp_path: Path) -> None:
    if shutil.which("cc") is None:
        pytest.skip("no compiler")
    units = ["int one(void) { return 1; }", "int one(void); int two(void) { return one() + one(); }"]
    made = compile_once(tmp_path / "two.so", ("-shared", "-fPIC"), lambda: units)
    assert ctypes.CDLL(str(made)).two() == 2


def test_without_libraries_for_this_processor_those_for_any_are_used(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(codegen, "_processor_flags", lambda: codegen.AVX2)
    caches = codegen._flags, codegen._blocks_path, codegen._launch_path
    try:
        for cached in caches:
            cached.cache_clear()
        assert codegen._flags() == codegen.AVX2  # nothing is compiled: for this processor
        made = codegen._blocks_path(codegen.ANY_PROCESSOR)
        made.parent.mkdir(parents=True)
        made.touch()
        codegen._flags.cache_clear()
        assert codegen.library() == made
        assert codegen.launch_library() == codegen._launch_path(codegen.ANY_PROCESSOR)
    finally:
        for cached in caches:
            cached.cache_clear()


def test_the_launch_takes_the_sizes_that_python_does() -> None:
    source = (codegen.LAUNCH_C[-1]).read_text()
    for name, value in (("STATES", layout.NX), ("CONTROLS", layout.NU), ("THROWN", layout.N_THROWN)):
        assert f"#define {name} {value}\n" in source
    for name, value in (("ROWS_MAX", fatrop.ROWS_MAX), ("OBJECTS_MAX", fatrop.OBJECTS_MAX)):
        assert f"#define {name} {value} " in source


@needs_launch
def test_a_solve_from_which_fatrop_does_not_return_is_left() -> None:
    """Found by the audit: these are the arguments of that solve."""
    stored = json.loads(Path(__file__).with_name("unreturned_launch.json").read_text(encoding="utf-8"))
    options = stored.pop("options")
    arguments = {name: np.array(values, float) for name, values in stored.items()}
    launch = fatrop.compiled_launch(StageLayout(launch=8, brake=3, groups=("clearance", "flight")))
    assert launch is not None
    before = launch.solve(arguments, {**options, "max_iter": 20})
    for _ in range(3):
        variables, iterations, is_solved, _ = launch.solve(arguments, options)
        assert not is_solved
        assert 0 < iterations < options["max_iter"]
        assert np.isnan(variables).all()
    after = launch.solve(arguments, {**options, "max_iter": 20})  # as if nothing had been
    assert np.isfinite(after[0]).all()
    assert np.array_equal(after[0], before[0])
    assert after[1:] == before[1:]
