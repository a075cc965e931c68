"""Casadi functions: blocks of rows with their derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from planner.backends.casadi_nlp.symbols import ALL_FORMULAS, BlockFormula, Terms
from planner.native import OPTIMISER

SX = Any
Vector = NDArray[np.float64]

KINDS = ("value", "slope", "curve")


@dataclass(frozen=True)
class Block:
    """The functions of one stage's rows, and the sparsity of their derivatives.

    Attributes:
        name: key of `symbols.ALL_FORMULAS`.
        value: (z, p) -> rows (n,).
        slope: (z, p) -> rows (n,), Jacobian (n, m), for m variables: NZ, or those and the object's.
        curve: (z, p, multipliers) -> gradient (m,) and Hessian (m, m) of multipliers @ rows.
    """

    name: str
    value: Any
    slope: Any
    curve: Any

    @property
    def jacobian(self) -> Any:
        """Sparsity (n, m) of the Jacobian."""
        return self.slope.sparsity_out(1)

    @property
    def hessian(self) -> Any:
        """Sparsity (m, m) of the Hessian, both triangles."""
        return self.curve.sparsity_out(1)

    @property
    def n(self) -> int:
        """Number of rows."""
        return self.slope.size1_out(0)

    @property
    def variables(self) -> int:
        """Number of variables m."""
        return self.slope.size2_out(1)

    @property
    def functions(self) -> tuple[Any, Any, Any]:
        """The functions, in the order of `KINDS`."""
        return self.value, self.slope, self.curve


@cache
def all_blocks() -> dict[str, Block]:
    """Returns every block, with the functions of the package's extension."""
    path = str(OPTIMISER)
    return {name: Block(name, *(ca.external(f"{name}_{kind}", path) for kind in KINDS)) for name in ALL_FORMULAS}


def build_block(name: str, formula: BlockFormula) -> Block:
    """Returns the block of a formula, by symbolic differentiation: what the extension is made from."""
    z = ca.SX.sym("z", formula.variables)
    p = ca.SX.sym("p", formula.layout.size)
    terms = Terms()
    rows = formula.rows(z, formula.given(p), terms)
    lam = ca.SX.sym("lam", rows.size1())
    jacobian, gradient = terms.jacobian(rows, z), terms.jacobian(ca.dot(lam, rows), z).T
    hessian = terms.hessian(ca.dot(lam, rows), z) if formula.curved else ca.SX(z.numel(), z.numel())

    def function(kind: str, inputs: list[SX], outputs: list[SX]) -> Any:
        return ca.Function(f"{name}_{kind}", inputs, terms.restored(outputs), {"cse": True})

    return Block(
        name,
        function("value", [z, p], [ca.densify(rows)]),
        function("slope", [z, p], [ca.densify(rows), jacobian]),
        function("curve", [z, p, lam], [ca.densify(gradient), hessian]),
    )


def evaluate(function: Any, *arguments: Vector) -> list[Vector]:
    """Returns every result of a function, dense (rows, columns).

    Raises:
        RuntimeError: an argument has another size than the function takes.
    """
    return [result.full() for result in function.call(list(arguments))]
