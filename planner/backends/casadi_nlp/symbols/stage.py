"""The joint state of a stage, from the optimiser's scaled variables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from planner.backends.casadi_nlp import layout
from planner.backends.casadi_nlp.symbols.terms import Terms

SX = Any


@dataclass(frozen=True)
class StageState:
    """Joint state in SI units, each (6,)."""

    q: SX
    qd: SX
    qdd: SX


def state(z: SX, c: dict[str, SX]) -> StageState:
    """Returns the state at the beginning of a stage, from its variables and the pieces of `SCALES`."""
    return StageState(z[layout.Q], z[layout.QD] * c["qd"], z[layout.QDD] * c["qdd"])


def state_after(z: SX, c: dict[str, SX], share: float) -> StageState:
    """Returns the exact state after a share of the stage's step."""
    return state_at(z, c, share * z[layout.STEP] * c["time"])


def state_at(z: SX, c: dict[str, SX], h: SX) -> StageState:
    """Returns the state at a time after the stage's beginning [s], exact within its step."""
    s = state(z, c)
    j = z[layout.JERK] * c["jerk"]
    q = s.q + h * (s.qd + h * (s.qdd / 2 + h * j / 6))
    return StageState(q, s.qd + h * (s.qdd + h * j / 2), s.qdd + h * j)


def through(s: StageState, terms: Terms) -> StageState:
    """Returns symbols for a state."""
    return StageState(*ca.vertsplit(terms.through(ca.vertcat(s.q, s.qd, s.qdd)), layout.LINKS))
