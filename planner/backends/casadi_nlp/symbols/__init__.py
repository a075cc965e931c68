"""Symbolic formulas of the rows: of the arm, of clearances, and of every block; and their derivatives."""

from planner.backends.casadi_nlp.symbols.rows import (
    FLIGHT_ROWS,
    FORMULAS,
    LEAVING_ROWS,
    RELEASE_ROWS,
    BlockFormula,
)
from planner.backends.casadi_nlp.symbols.terms import Terms

__all__ = [
    "FLIGHT_ROWS",
    "FORMULAS",
    "LEAVING_ROWS",
    "RELEASE_ROWS",
    "BlockFormula",
    "Terms",
]
