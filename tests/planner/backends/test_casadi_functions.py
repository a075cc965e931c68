"""Compiled functions against casadi's interpreter."""

from __future__ import annotations

import numpy as np
import pytest

from planner.backends.casadi_nlp import functions

RNG = np.random.default_rng(5)


@pytest.mark.slow
@pytest.mark.parametrize("kind", functions.KINDS)
def test_compiled_functions_give_the_numbers_of_casadi_s_interpreter(kind: str) -> None:
    for name, block in functions.all_blocks().items():
        interpreted = getattr(functions.build_block(name, functions.ALL_FORMULAS[name]), kind)
        function = getattr(block, kind)
        arguments = [RNG.uniform(0.1, 1.0, function.numel_in(i)) for i in range(function.n_in())]
        for a, b in zip(
            functions.evaluate(function, *arguments), functions.evaluate(interpreted, *arguments), strict=True
        ):
            assert np.isfinite(b).all()
            np.testing.assert_array_equal(a, b)
