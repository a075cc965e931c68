"""Symbolic formulas of the rows: of the arm, of clearances, and of every block; and their derivatives."""

from planner.backends.casadi_nlp.symbols.cost import COST, cost_parameters
from planner.backends.casadi_nlp.symbols.rows import (
    ALL_FORMULAS,
    FLIGHT_ROWS,
    FORMULAS,
    LEAVING_ROWS,
    RELEASE_ROWS,
    BlockFormula,
)
from planner.backends.casadi_nlp.symbols.terms import Terms

__all__ = [
    "ALL_FORMULAS",
    "COST",
    "FLIGHT_ROWS",
    "FORMULAS",
    "LEAVING_ROWS",
    "RELEASE_ROWS",
    "BlockFormula",
    "Terms",
    "cost_parameters",
]
