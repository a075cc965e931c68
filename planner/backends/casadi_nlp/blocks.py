"""From rows to functions: values, Jacobians and Hessians of one stage, by symbolic differentiation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca

from planner.backends.casadi_nlp import stages, throw
from planner.backends.casadi_nlp.layout import ARM, BOXES, NZ, RELEASE

SX = Any


@dataclass(frozen=True)
class Block:
    """Three functions of one stage, and where their derivatives are not zero.

    Attributes:
        name: of the block.
        value: (z, p) -> rows.
        slope: (z, p) -> rows, Jacobian (n, NZ).
        curve: (z, p, multipliers) -> their gradient, Hessian (NZ, NZ).
    """

    name: str
    value: Any
    slope: Any
    curve: Any

    @property
    def jacobian(self) -> Any:
        """Sparsity (n, NZ)."""
        return self.slope.sparsity_out(1)

    @property
    def hessian(self) -> Any:
        """Sparsity (NZ, NZ), of both triangles."""
        return self.curve.sparsity_out(1)

    @property
    def n(self) -> int:
        """Number of rows."""
        return self.slope.size1_out(0)

    @property
    def functions(self) -> tuple[Any, Any, Any]:
        """What is worth compiling."""
        return self.value, self.slope, self.curve


KINDS = ("value", "slope", "curve")

SOURCES: dict[str, tuple[Callable[[SX, SX], stages.Rows], int]] = {
    "motion": (stages.motion, 0),
    "cost": (stages.cost, stages.COST.size),
    "effort": (stages.effort, ARM.size),
    "effort_middle": (stages.effort_middle, ARM.size),
    "space": (stages.space, ARM.size),
    "space_middle": (stages.space_middle, ARM.size),
    "boxes": (stages.boxes, ARM.size + BOXES.size),
    "boxes_middle": (stages.boxes_middle, ARM.size + BOXES.size),
    "singular": (stages.singular, ARM.size),
    "singular_middle": (stages.singular_middle, ARM.size),
    "release": (throw.release, ARM.size + RELEASE.size),
}


@cache
def interpreted() -> dict[str, Block]:
    """Returns every block with functions that casadi evaluates itself."""
    return {name: build(name, rows, size) for name, (rows, size) in SOURCES.items()}


def build(name: str, rows: Callable[[SX, SX], stages.Rows], parameters: int) -> Block:
    """Returns the block of `rows(z, p)`."""
    z, p = ca.SX.sym("z", NZ), ca.SX.sym("p", parameters)
    made = rows(z, p)
    lam = ca.SX.sym("lam", made.rows.size1())
    jacobian = ca.jacobian(made.rows, z)
    gradient = ca.jtimes(made.rows, z, lam, True)
    kept = ca.dot(lam[made.uncurved :], made.rows[made.uncurved :])
    hessian = ca.hessian(kept, z)[0]

    def function(kind: str, inputs: list[SX], outputs: list[SX]) -> Any:
        return ca.Function(f"{name}_{kind}", inputs, _release(made.held, outputs), {"cse": True})

    return Block(
        name,
        function("value", [z, p], [ca.densify(made.rows)]),
        function("slope", [z, p], [ca.densify(made.rows), jacobian]),
        function("curve", [z, p, lam], [ca.densify(gradient), hessian]),
    )


def _release(held: Any, outputs: list[SX]) -> list[SX]:
    """Puts back what was held while differentiating, the last first: later ones may stand on earlier ones."""
    for symbol, value in reversed(list(zip(held.symbols, held.values, strict=True))):
        outputs = list(ca.substitute(outputs, [symbol], [value]))  # pyright: ignore[reportAssignmentType]
    return outputs
