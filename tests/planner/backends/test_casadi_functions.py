"""Functions called through buffers against casadi's own calls."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from planner.backends.casadi_nlp import functions
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


@pytest.mark.parametrize("kind", functions.KINDS)
def test_compiled_functions_give_the_numbers_of_casadi_s_interpreter(kind: str) -> None:
    for name, block in functions.all_blocks().items():
        interpreted = getattr(functions.build_block(name, functions.FORMULAS[name]), kind)
        function = getattr(block, kind)
        arguments = [RNG.uniform(0.1, 1.0, function.numel_in(i)) for i in range(function.n_in())]
        for a, b in zip(
            functions.evaluate(function, *arguments), functions.evaluate(interpreted, *arguments), strict=True
        ):
            assert np.isfinite(b).all()
            np.testing.assert_array_equal(a, b)
