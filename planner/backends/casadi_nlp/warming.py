"""Work done ahead of requests: compiling once a machine, building solvers once a process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

from planner.backends.casadi_nlp import codegen
from planner.backends.casadi_nlp.request import (
    BRAKE_STAGES,
    FINE_BRAKE_STAGES,
    FINE_LAUNCH_STAGES,
    LAUNCH_STAGES,
)
from planner.backends.casadi_nlp.solving import machine
from planner.backends.casadi_nlp.table import GROUPS, Shape
from planner.backends.casadi_nlp.window import USUAL_STAGES

STAGES = (
    Shape(LAUNCH_STAGES, BRAKE_STAGES),
    Shape(LAUNCH_STAGES + USUAL_STAGES, BRAKE_STAGES + USUAL_STAGES, USUAL_STAGES),
    Shape(LAUNCH_STAGES, 0),
)
FINE = (
    Shape(FINE_LAUNCH_STAGES, FINE_BRAKE_STAGES),
    Shape(FINE_LAUNCH_STAGES, 0),
)
ALWAYS = GROUPS[:-1]  # with keep-out boxes: built with the first such request, in a few hundredths of a second
SHAPES = tuple(
    replace(stages, groups=groups)
    for stages in STAGES
    for size in range(len(ALWAYS) + 1)
    for groups in combinations(ALWAYS, size)
) + tuple(replace(stages, groups=ALWAYS) for stages in FINE)


def warm(progress: Callable[[str, float], None]) -> bool:
    """Returns whether compiled functions are in use."""
    progress("compiling", 0.0)
    compiled = codegen.compile_blocks() is not None
    for i, shape in enumerate(SHAPES):
        progress("building solvers", 0.9 + 0.1 * i / len(SHAPES))
        machine(shape)
    progress("ready" if compiled else "no compiler: interpreted functions", 1.0)
    return compiled
