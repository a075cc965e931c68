"""Transcription: which blocks of rows apply on which stages, and where their rows are in the whole problem.

Variables: z_0 … z_N, each state then control, the last without a control; then an object's states of every stage from
the release on, where it has some. Rows, stage by stage: x_{k+1} - F(x_k, u_k), the object's last,
then the rows of the blocks that apply there. All derivatives are the blocks', mapped over the stages and put in their
places, so another number of stages or another set of blocks needs no compiling.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from planner.backends.casadi_nlp import layout
from planner.backends.casadi_nlp.functions import Block, all_blocks
from planner.backends.casadi_nlp.layout import (
    LAZY_GROUPS,
    N_THROWN,
    NX,
    NZ,
    OF_THE_OBJECT,
    StageLayout,
    group_of,
)
from planner.backends.casadi_nlp.symbols import FORMULAS

Indices = NDArray[np.intp]

# Parameters p: these, then the costs of every stage.
ALL_SHARED = layout.VectorLayout({name: piece.size for name, piece in layout.SHARED.items()})


class RowIndex:
    """Position of every row of every block in the whole problem.

    Attributes:
        stages: the layout.
        blocks: blocks that the layout includes on some stage, by name.
        knots: stages on which each block applies.
        rows: rows of a block on a stage.
        rows_of: rows of a block on all its stages, none for a block that is not included.
        rows_of_group: rows of a lazy group, at knots and midpoints.
        dynamics: rows of x_{k+1} - F(x_k, u_k) for each k.
        per_stage: number of rows of each stage, its dynamics excepted.
        size: number of rows.
        core: number of variables but for the object's.
        variables: number of variables.
    """

    def __init__(self, stages: StageLayout, blocks: Mapping[str, Block]) -> None:
        self.stages = stages
        included = [name for name in FORMULAS if stages.includes(name) and stages.knots(name)]
        self.blocks = {name: blocks[stages.function(name)] for name in included}
        self.knots = {name: stages.knots(name) for name in self.blocks}
        self.rows: dict[tuple[str, int], Indices] = {}
        self.dynamics: list[Indices] = []
        self.per_stage: list[int] = []
        self.core = stages.stages * NZ + NX
        self.variables = self.core + N_THROWN * (stages.stages + 1 - stages.thrown)
        self.size = 0
        for k in range(stages.stages + 1):
            self._add_stage(k)
        self.rows_of = {name: self._all_rows(name) for name in FORMULAS}
        self.rows_of_group = {group: self._in_group(group) for group in LAZY_GROUPS}

    def _add_stage(self, k: int) -> None:
        if k < self.stages.stages:
            self.dynamics.append(np.arange(self.size, self.size + self.states(k + 1)))
            self.size += self.states(k + 1)
        followed = self.dynamics[k] if k < self.stages.stages else np.zeros(0, np.intp)
        first = self.size
        for name, block in self.blocks.items():
            if name == "cost" or k not in self.knots[name]:
                continue
            shared = followed[self.following(name)]
            own = np.arange(self.size, self.size + block.n - len(shared))
            self.rows[name, k] = np.concatenate([shared, own])
            self.size += len(own)
        self.per_stage.append(self.size - first)

    def states(self, k: int) -> int:
        """Returns the number of states of a stage."""
        return NX + N_THROWN * (k >= self.stages.thrown)

    def following(self, block: str) -> slice:
        """Returns which of the next stage's states a block's first rows are; none for most blocks."""
        if block in OF_THE_OBJECT:
            return slice(NX, NX + N_THROWN)
        return slice(0, NX if block == "motion" else 0)

    def _in_group(self, group: str) -> Indices:
        return np.concatenate([rows for name, rows in self.rows_of.items() if group_of(name) == group])

    def _all_rows(self, block: str) -> Indices:
        return np.concatenate([np.zeros(0, np.intp), *(rows for (name, _), rows in self.rows.items() if name == block)])

    def within(self, whole: RowIndex) -> Indices:
        """Returns the position of every row in a problem with more groups."""
        positions = np.zeros(self.size, dtype=np.intp)
        for k, rows in enumerate(self.dynamics):
            positions[rows] = whole.dynamics[k][: len(rows)]
        for (name, k), rows in self.rows.items():
            if name not in OF_THE_OBJECT:  # these are rows of the dynamics alone
                positions[rows] = whole.rows[name, k]
        return positions


@cache
def row_index(stages: StageLayout) -> RowIndex:
    """Returns the rows of a layout, found once per process."""
    return RowIndex(stages, all_blocks())
