"""The audit's problems: random cells as files, and random requests in them, each a function of seed and index alone."""

from audit.problems.drawing import GENERATOR, KINDS, DrawnProblem, drawn_problem

__all__ = ["GENERATOR", "KINDS", "DrawnProblem", "drawn_problem"]
