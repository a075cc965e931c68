"""The stages of a problem, what applies on which of them, and where every row stands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.backends.casadi_nlp.blocks import Block
from planner.backends.casadi_nlp.layout import NX, NZ

WATCHED = 3  # stages before the release on which the singularities are watched; so are all after it
GROUPS = ("effort", "space", "boxes")  # blocks that a problem may do without, each with its rows in the steps' middles


@dataclass(frozen=True)
class Shape:
    """How many stages, and what applies.

    Attributes:
        launch: stages before the release.
        brake: stages after it.
        window: stages on either side of the release that make up a release window.
        groups: those of `GROUPS` that it holds.
    """

    launch: int = 8
    brake: int = 4
    window: int = 0
    groups: tuple[str, ...] = ()

    @property
    def stages(self) -> int:
        """Number of steps."""
        return self.launch + self.brake

    def holds(self, block: str) -> bool:
        """Returns whether a block is part of the problem."""
        group = block.removesuffix("_middle")
        return group not in GROUPS or group in self.groups

    def knots(self, block: str) -> range:
        """Returns the stages on which a block applies."""
        around = self.window
        return {
            "motion": range(self.stages),
            "cost": range(self.stages),
            **{group: range(1, self.stages + 1) for group in GROUPS},
            **{f"{group}_middle": range(self.stages) for group in GROUPS},
            "singular": range(self.launch - WATCHED - around, self.stages + 1),
            "singular_middle": range(self.launch - WATCHED - around, self.stages),
            "release": range(self.launch - around, self.launch + around + 1),
        }[block]


class Table:
    """Where every row of every block stands in the problem."""

    def __init__(self, shape: Shape, blocks: Mapping[str, Block]) -> None:
        self.shape, self.blocks = shape, blocks
        self.rows: dict[tuple[str, int], np.ndarray] = {}
        self.dynamics: list[np.ndarray] = []
        self.ng: list[int] = []
        at = 0
        for k in range(shape.stages + 1):
            if k < shape.stages:
                self.dynamics.append(np.arange(at, at + NX))
                at += NX
            at += self._stage(k, at)
        self.size = at

    def _stage(self, k: int, at: int) -> int:
        """Gives rows to the blocks of stage `k` from row `at` on, and returns how many."""
        start = at
        for name, block in self.blocks.items():
            if name == "cost" or k not in self.shape.knots(name):
                continue
            fresh = block.n - (NX if name == "motion" else 0)
            own = np.arange(at, at + fresh)
            self.rows[name, k] = np.concatenate([self.dynamics[k], own]) if name == "motion" else own
            at += fresh
        self.ng.append(at - start)
        return at - start

    @cached_property
    def variables(self) -> int:
        """Length of x."""
        return self.shape.stages * NZ + NX

    def rows_of(self, block: str) -> np.ndarray:
        """Returns the rows of a block on all its stages."""
        return np.concatenate([rows for (name, _), rows in self.rows.items() if name == block])

    def within(self, whole: Table) -> np.ndarray:
        """Returns for every row where it stands in a problem that holds more groups."""
        places = np.zeros(self.size, dtype=np.intp)
        for k, rows in enumerate(self.dynamics):
            places[rows] = whole.dynamics[k]
        for key, rows in self.rows.items():
            places[rows] = whole.rows[key]
        return places

    @staticmethod
    def sign(name: str) -> np.ndarray | float:
        """Returns by what a block's rows enter the problem: its first NX rows are F in x_{k+1} - F."""
        return np.concatenate([-np.ones(NX), np.ones(12)]) if name == "motion" else 1.0
