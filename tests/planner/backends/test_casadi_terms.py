"""Derivatives by way of intermediate terms against those that casadi takes of the whole expression."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from planner.backends.casadi_nlp.symbols import Terms

N = 5
AT = np.random.default_rng(3).uniform(0.2, 1.0, N)


def _nested(z: Any, terms: Terms) -> Any:
    """Rows of a term of a term, of both, and of the variables themselves."""
    first = terms.through(ca.vertcat(ca.sin(z[0] * z[1]), z[2] ** 3 + z[1], z[3]))
    second = terms.through(ca.vertcat(first[0] * first[1], ca.exp(first[2]) * z[4]))
    return ca.vertcat(second[0] * second[1] ** 2, ca.cos(second[0]) * first[1] * z[0], z[4] ** 2)


def _numbers(expression: Any, z: Any) -> np.ndarray:
    return np.array(ca.Function("numbers", [z], [ca.densify(expression)])(AT))


@pytest.mark.parametrize("row", range(3))
def test_first_and_second_derivatives_are_those_of_the_whole_expression(row: int) -> None:
    z = ca.SX.sym("z", N)
    terms = Terms()
    rows = _nested(z, terms)
    (whole,) = terms.restored([rows])
    slope, second = terms.restored([terms.jacobian(rows, z), terms.hessian(rows[row], z)])
    np.testing.assert_allclose(_numbers(slope, z), _numbers(ca.jacobian(whole, z), z), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(_numbers(second, z), _numbers(ca.hessian(whole[row], z)[0], z), rtol=1e-12, atol=1e-12)


def test_a_frozen_term_is_constant_whatever_it_depends_on() -> None:
    z = ca.SX.sym("z", N)
    terms = Terms()
    moved = terms.through(z[0] * z[1])
    frozen = terms.freeze(moved**2)
    row = frozen * moved
    value, slope, second = terms.restored([row, terms.jacobian(row, z), terms.hessian(row, z)])
    product = AT[0] * AT[1]
    assert _numbers(value, z) == pytest.approx(product**3)
    assert _numbers(slope, z)[0] == pytest.approx([product**2 * AT[1], product**2 * AT[0], 0.0, 0.0, 0.0])
    expected = np.zeros((N, N))
    expected[0, 1] = expected[1, 0] = product**2
    np.testing.assert_allclose(_numbers(second, z), expected, rtol=1e-12, atol=1e-12)


def test_without_terms_nothing_is_changed() -> None:
    z = ca.SX.sym("z", N)
    terms = Terms()
    row = ca.sumsqr(z)
    np.testing.assert_allclose(_numbers(terms.jacobian(row, z), z)[0], 2.0 * AT)
    np.testing.assert_allclose(_numbers(terms.hessian(row, z), z), 2.0 * np.eye(N))
