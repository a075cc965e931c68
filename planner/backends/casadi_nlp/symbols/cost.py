"""What the optimiser minimises: what each stage adds to the cost, and the numbers that it takes for that.

Another objective is another formula here; the search ranks motions by it in `planner.search.record`.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from planner.backends.casadi_nlp import layout
from planner.backends.casadi_nlp.layout import StageLayout, Vector, VectorLayout
from planner.backends.casadi_nlp.symbols.passing import Given
from planner.backends.casadi_nlp.symbols.terms import Terms
from planner.backends.casadi_nlp.tuning import BRAKE_WEIGHT, JERK_WEIGHT, STEP_WEIGHT

SX = Any

COST = VectorLayout({"time": 1, "jerk": 1, "step": 1, "initial_step": 1})  # parameters of each stage


def cost(z: SX, given: Given, terms: Terms) -> SX:
    """One row: weighted time, squared jerk, and the step's relative deviation from its initial guess."""
    c = given["cost"]
    step = z[layout.STEP]
    return c["time"] * step + c["jerk"] * ca.sumsqr(z[layout.JERK]) + c["step"] * (step / c["initial_step"] - 1) ** 2


def cost_parameters(stages: StageLayout, initial_steps: Vector, has_fixed_times: bool) -> Vector:
    """Returns the `COST` parameters of every stage; with fixed times only jerk and steps have a cost.

    Args:
        stages: the layout.
        initial_steps: scaled lengths of the steps (N,) in the initial guess.
        has_fixed_times: whether start and end are at fixed times.
    """
    n = len(initial_steps)
    time = np.where(np.arange(n) < stages.launch, 1.0, BRAKE_WEIGHT)
    weights = {
        "time": np.zeros(n) if has_fixed_times else time,
        "jerk": np.full(n, JERK_WEIGHT / n / 6),
        "step": np.full(n, STEP_WEIGHT / n),
        "initial_step": initial_steps,
    }
    return np.stack([weights[name] for name in COST.sizes]).T.ravel()
