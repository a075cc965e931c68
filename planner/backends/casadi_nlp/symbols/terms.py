"""Derivatives of a block's rows by way of intermediate terms.

casadi's own second derivative of a formula grows with every variable that each operation depends on: torques in the
middle of a step depend on 25 variables by way of 18. Taken with respect to those 18, and then by the chain rule, it has
three tenths of the operations.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import casadi as ca

SX = Any  # casadi's type stubs are incomplete


@dataclass(frozen=True, eq=False)
class _Term:
    """A symbol and the expression it stands for; constant while differentiating, or not."""

    symbol: SX
    value: SX
    constant: bool


class Terms:
    """Intermediate terms of one formula, in order: each may depend on earlier ones.

    While the formula is differentiated, a symbol stands for each.
    """

    def __init__(self) -> None:
        self._terms: list[_Term] = []

    def freeze(self, value: SX) -> SX:
        """Returns a symbol for `value`, which derivatives take as constant."""
        return self._add(value, constant=True)

    def through(self, value: SX) -> SX:
        """Returns a symbol for `value`, of which derivatives are taken by the chain rule."""
        return self._add(value, constant=False)

    def _add(self, value: SX, constant: bool) -> SX:
        symbol = ca.SX.sym(f"term{len(self._terms)}", *value.shape)
        self._terms.append(_Term(symbol, value, constant))
        return symbol

    @property
    def _linked(self) -> list[_Term]:
        return [term for term in self._terms if not term.constant]

    def restored(self, outputs: Iterable[SX]) -> list[SX]:
        """Returns expressions with the values in the place of the symbols."""
        symbols, values = ([getattr(term, name) for term in self._terms] for name in ("symbol", "value"))
        _, restored = ca.substitute_inplace(symbols, values, list(outputs), False)  # in one pass over all of them
        return list(restored)

    def jacobian(self, rows: SX, z: SX) -> SX:
        """Returns the derivative (n, m) of rows (n,) with respect to variables (m,), in symbols of the terms."""
        slope = ca.jacobian(rows, self._variables(z))
        for _, earlier, inner in self._links(z):
            slope = slope[:, : earlier.size1()] + slope[:, earlier.size1() :] @ inner
        return slope

    def hessian(self, row: SX, z: SX) -> SX:
        """Returns the second derivative (m, m) of one row with respect to variables (m,), in symbols of the terms."""
        second, slope = ca.hessian(row, self._variables(z))
        for value, earlier, inner in self._links(z):
            n = earlier.size1()
            weights = ca.SX.sym("weights", value.size1())
            bent = ca.substitute(ca.hessian(ca.dot(weights, value), earlier)[0], weights, slope[n:])
            across = second[n:, :n]
            own = second[n:, n:]
            upper = second[:n, :n] + bent + inner.T @ (across + own @ inner) + across.T @ inner
            second = ca.triu2symm(ca.triu(upper))
            slope = slope[:n] + inner.T @ slope[n:]
        return second

    def _variables(self, z: SX) -> SX:
        return ca.vertcat(z, *(term.symbol for term in self._linked))

    def _links(self, z: SX) -> Iterator[tuple[SX, SX, SX]]:
        """Yields from the last link: its value, the variables before it, and the value's derivative by them."""
        for i, link in reversed(list(enumerate(self._linked))):
            earlier = ca.vertcat(z, *(term.symbol for term in self._linked[:i]))
            yield link.value, earlier, ca.jacobian(link.value, earlier)
