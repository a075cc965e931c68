"""Work done ahead of requests: compiling once a machine, building solvers once a process."""

from __future__ import annotations

from collections.abc import Callable

from planner.backends.casadi_nlp import codegen
from planner.backends.casadi_nlp.assembly import Shape
from planner.backends.casadi_nlp.request import BRAKE_STAGES, LAUNCH_STAGES
from planner.backends.casadi_nlp.task import machine

SHAPES = (
    Shape(LAUNCH_STAGES, BRAKE_STAGES),
    Shape(LAUNCH_STAGES + 1, BRAKE_STAGES + 1, window=True),
    Shape(LAUNCH_STAGES, 0),
)  # with keep-out boxes: built with the first such request, in a few hundredths of a second


def warm(progress: Callable[[str, float], None]) -> bool:
    """Returns whether compiled functions are in use."""
    progress("compiling", 0.0)
    compiled = codegen.compile_blocks() is not None
    for i, shape in enumerate(SHAPES):
        progress("building solvers", 0.9 + 0.1 * i / len(SHAPES))
        machine(shape)
    progress("ready" if compiled else "no compiler: interpreted functions", 1.0)
    return compiled
