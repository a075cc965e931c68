"""Functions called through buffers against casadi's own calls."""

from __future__ import annotations

import ast
import importlib.util
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from planner.backends.casadi_nlp import codegen, functions
from planner.backends.casadi_nlp.layout import StageLayout
from planner.backends.casadi_nlp.transcription import transcription

RNG = np.random.default_rng(5)
FUNCTIONS = ("motion", "clearance", "release")


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("kind", ["value", "slope"])
def test_results_are_casadi_s_own_and_dense(name: str, kind: str) -> None:
    function = getattr(transcription(StageLayout(8, 3, 0, ("clearance",))).blocks[name], kind)
    arguments = [RNG.uniform(0.1, 1.0, function.numel_in(i)) for i in range(function.n_in())]
    expected = function(*arguments)
    expected = [np.array(x) for x in (expected if isinstance(expected, (list, tuple)) else [expected])]
    found = functions.evaluate(function, *arguments)
    assert [x.shape for x in found] == [x.shape for x in expected]
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)


def test_arrays_of_any_memory_layout_and_type_are_accepted() -> None:
    x = ca.SX.sym("x", 3)
    double = ca.Function("double", [x], [2.0 * x])
    np.testing.assert_array_equal(functions.evaluate(double, np.arange(6)[::2])[0].ravel(), [0.0, 4.0, 8.0])


def test_a_wrong_size_is_refused() -> None:
    x = ca.SX.sym("x", 3)
    double = ca.Function("double", [x], [2.0 * x])
    with pytest.raises(ValueError, match="has 2 entries instead of 3"):
        functions.evaluate(double, np.zeros(2))
    with pytest.raises(ValueError, match=r"shorter|longer"):
        functions.evaluate(double)


def test_a_solver_is_called_by_names_and_returns_its_statistics() -> None:
    x = ca.SX.sym("x", 2)
    p = ca.SX.sym("p", 1)
    problem = {"x": x, "p": p, "f": (x[0] - p) ** 2 + x[1] ** 2, "g": x[0] + x[1]}
    solver = ca.nlpsol("solver", "ipopt", problem, {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"})
    call = {"x0": np.zeros(2), "p": np.array([3.0]), "lbg": np.array([1.0]), "ubg": np.array([1.0]),
            "lbx": np.full(2, -np.inf), "ubx": np.full(2, np.inf)}  # fmt: skip
    result, stats = functions.first_result(solver, call)
    np.testing.assert_allclose(result, [2.0, -1.0], atol=1e-6)
    assert stats["success"]
    assert stats["iter_count"] > 0
    with pytest.raises(ValueError, match="p has 2 entries"):
        functions.first_result(solver, {**call, "p": np.zeros(2)})


def _is_module(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False


def test_every_module_behind_the_compiled_formulas_is_part_of_their_hash() -> None:
    package = "planner.backends.casadi_nlp"
    known = set(codegen.FORMULA_MODULES)
    names = {f"{package}.{module}".replace("/", ".").removesuffix(".__init__") for module in known}
    imported = set()
    for module in known:
        source = Path(codegen.__file__).parent.joinpath(f"{module}.py").read_text()
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Import):
                imported |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{module}: relative import"
                for alias in node.names:
                    inner = f"{node.module}.{alias.name}"
                    imported.add(inner if _is_module(inner) else node.module or "")
    fling = {name for name in imported if name.split(".")[0] in ("planner", "api", "store", "executor", "benchmarks")}
    assert fling <= names
    assert len(names) == len(known)


@pytest.mark.parametrize("kind", functions.KINDS)
def test_compiled_functions_give_the_numbers_of_the_interpreted_ones(kind: str) -> None:
    compiled = codegen.compiled_blocks()
    if compiled is None:
        pytest.skip("nothing is compiled")
    for name in functions.ALL_FORMULAS:
        interpreted = getattr(functions.interpreted_blocks()[name], kind)
        function = getattr(compiled[name], kind)
        arguments = [RNG.uniform(0.1, 1.0, function.numel_in(i)) for i in range(function.n_in())]
        for a, b in zip(
            functions.evaluate(function, *arguments), functions.evaluate(interpreted, *arguments), strict=True
        ):
            assert np.isfinite(b).all()
            np.testing.assert_array_equal(a, b)
