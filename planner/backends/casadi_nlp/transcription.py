"""Transcription: which blocks of rows apply on which stages, and the functions of the whole problem.

Variables: z_0 … z_N, each state then control, the last without a control; then an object's states of every stage from
the release on, where it has some. Rows, stage by stage: x_{k+1} - F(x_k, u_k), the object's last,
then the rows of the blocks that apply there. All derivatives are the blocks', mapped over the stages and put in their
places, so another number of stages or another set of blocks needs no compiling.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from planner.backends.casadi_nlp import codegen, layout
from planner.backends.casadi_nlp.functions import Block
from planner.backends.casadi_nlp.layout import (
    COST,
    LAZY_GROUPS,
    N_THROWN,
    NU,
    NX,
    NZ,
    OF_THE_OBJECT,
    StageLayout,
    Vector,
    group_of,
)
from planner.backends.casadi_nlp.symbols import FORMULAS

MX = Any
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
        self.core = self.variables = stages.stages * NZ + NX
        for first in stages.objects:
            self.variables += N_THROWN * (stages.stages + 1 - first)
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
        return NX + N_THROWN * sum(k >= first for first in self.stages.objects)

    def following(self, block: str) -> slice:
        """Returns which of the next stage's states a block's first rows are; none for most blocks."""
        if block in OF_THE_OBJECT:
            return slice(NX, NX + N_THROWN)
        return slice(0, NX if block == "motion" else 0)

    def columns(self, k: int, count: int = NZ) -> Indices:
        """Returns the positions of the first `count` variables (z, thrown) of a stage; -1 for what it does not have.

        Args:
            k: the stage.
            count: of variables.
        """
        z = np.arange(k * NZ, (k + 1) * NZ)
        if k == self.stages.stages:
            z[NX:] = -1
        return np.append(z, self.thrown(k))[:count]

    def thrown(self, k: int) -> Indices:
        """Returns the positions of the object's states of a stage; -1 where it has none."""
        if not self.stages.objects or k < self.stages.launch:
            return np.full(N_THROWN, -1)
        return self.core + N_THROWN * (k - self.stages.launch) + np.arange(N_THROWN)

    @cached_property
    def stagewise(self) -> Indices:
        """The positions of the variables in the order of casadi's interface to fatrop: all states of a stage first."""
        stages = range(self.stages.stages + 1)
        ordered = np.concatenate([np.append(self.states_at(k), self.columns(k)[NX:]) for k in stages])
        return ordered[ordered >= 0]

    def states_at(self, k: int) -> Indices:
        """Returns the positions of a stage's states, the object's last."""
        thrown = self.thrown(k)
        return np.append(self.columns(k)[:NX], thrown[thrown >= 0])

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

    def signs(self, block: str) -> np.ndarray:
        """Returns the signs (n,) with which a block's rows enter the problem: F enters as x_{k+1} - F."""
        signs = np.ones(self.blocks[block].n)
        following = self.following(block)
        signs[: following.stop - following.start] = -1.0
        return signs


@dataclass(frozen=True, eq=False)
class Transcription:
    """The problem of a layout.

    Attributes:
        row_index: position of its rows.
        blocks: every block, those that it leaves out included.
    """

    row_index: RowIndex
    blocks: dict[str, Block]

    @cached_property
    def functions(self) -> dict[str, Any]:
        """The functions f, g, grad_f, jac_g and hess_l of (x, p): 10 to 120 ms, and not needed by a compiled launch."""
        return assemble(self.row_index)


@cache
def transcription(stages: StageLayout) -> Transcription:
    """Returns the problem of a layout, built once per process; with compiled functions if there are any."""
    blocks = codegen.loaded_blocks().blocks
    return Transcription(RowIndex(stages, blocks), blocks)


def assemble(index: RowIndex) -> dict[str, Any]:
    """Returns the functions f, g and their derivatives of (x, p)."""
    x = ca.MX.sym("x", index.variables)
    p = ca.MX.sym("p", ALL_SHARED.size + COST.size * index.stages.stages)
    lam_f = ca.MX.sym("lam_f")
    lam_g = ca.MX.sym("lam_g", index.size)
    f = _objective(index, x, p)
    g = _constraints(index, x, _on_stages(index, "value", x, p))
    slopes = _on_stages(index, "slope", x, p)
    gradient, hessian = _lagrangian(index, x, p, lam_f, lam_g)
    outputs = {
        "f": ([x, p], [f]),
        "g": ([x, p], [g]),
        "grad_f": ([x, p], [_objective_gradient(index, x, p)]),
        "jac_g": ([x, p], [_constraints(index, x, slopes), _jacobian(index, slopes)]),
        "hess_l": ([x, p, lam_f, lam_g], [gradient, hessian]),
    }
    return {name: ca.Function(name, *both) for name, both in outputs.items()}


def _parameters(index: RowIndex, name: str, p: MX) -> MX:
    if name == "cost":
        return ca.reshape(p[ALL_SHARED.size :], COST.size, index.stages.stages)
    return ca.vertcat(ca.MX(0, 1), *(p[ALL_SHARED.slices[piece]] for piece in FORMULAS[name].parameters))


def _mapped(index: RowIndex, name: str, kind: str, x: MX, p: MX, *more: MX) -> list[MX]:
    """Returns the outputs of a block's function, one column per stage."""
    knots = index.knots[name]
    function = getattr(index.blocks[name], kind)
    same_on_all = [] if name == "cost" else [1]
    mapped = function.map(f"{function.name()}_{len(knots)}", "serial", len(knots), same_on_all, [])
    return mapped.call([_columns(index, name, x), _parameters(index, name, p), *more])


def _columns(index: RowIndex, name: str, x: MX) -> MX:
    """Returns the variables of a block (m, n), one column per stage; the object's are zeros where it has no states."""
    knots = index.knots[name]
    core = ca.reshape(ca.vertcat(x[: index.core], ca.MX.zeros(NU)), NZ, index.stages.stages + 1)
    own = core[:, knots.start : knots.stop]
    if index.blocks[name].variables == NZ:
        return own
    thrown = [index.thrown(k) for k in knots]
    if (thrown[0] < 0).any():
        return ca.vertcat(own, ca.MX.zeros(N_THROWN, len(knots)))
    return ca.vertcat(own, ca.reshape(x[np.concatenate(thrown).tolist()], N_THROWN, len(knots)))


def _on_stages(index: RowIndex, kind: str, x: MX, p: MX) -> dict[str, list[MX]]:
    """Returns the outputs of every block of constraints by name."""
    return {name: _mapped(index, name, kind, x, p) for name in index.blocks if name != "cost"}


def _objective(index: RowIndex, x: MX, p: MX) -> MX:
    return ca.sum2(_mapped(index, "cost", "value", x, p)[0])


def _objective_gradient(index: RowIndex, x: MX, p: MX) -> MX:
    nonzeros = ca.vec(_mapped(index, "cost", "slope", x, p)[1].nz[:])
    _, columns = index.blocks["cost"].jacobian.get_triplet()
    positions = np.concatenate([k * NZ + np.array(columns) for k in index.knots["cost"]])
    return ca.densify(_scatter(positions, 1.0, index.variables) @ nonzeros)  # the solvers need a dense gradient


def _constraints(index: RowIndex, x: MX, outputs: Mapping[str, Sequence[MX]]) -> MX:
    """Returns the rows: the first output of every block's function."""
    g = _next_states(index) @ x
    for name, (rows, *_) in outputs.items():
        g += _into_rows(index, name) @ ca.vec(rows)
    return g


def _into_rows(index: RowIndex, name: str) -> Any:
    """Returns the constant matrix that adds a block's rows on all its stages, with their signs, to the problem's."""
    return _scatter(index.rows_of[name], np.tile(index.signs(name), len(index.knots[name])), index.size)


def _scatter(positions: Indices, values: np.ndarray | float, rows: int) -> Any:
    """Returns the constant matrix (rows, n) that adds entry i, times its value, to row `positions[i]`."""
    n = len(positions)
    sparsity = ca.Sparsity.triplet(rows, n, [int(i) for i in positions], list(range(n)))
    return ca.DM(sparsity, np.broadcast_to(values, n).copy())  # one entry per column: triplet order is kept


def _next_states(index: RowIndex) -> Any:
    """Returns the constant matrix that x_{k+1} enters the dynamics by."""
    rows = np.concatenate(index.dynamics)
    columns = np.concatenate([index.states_at(k + 1) for k in range(index.stages.stages)])
    return ca.DM(ca.Sparsity.triplet(index.size, index.variables, rows.tolist(), columns.tolist()), 1.0)


def _jacobian(index: RowIndex, outputs: Mapping[str, Sequence[MX]]) -> MX:
    """Returns the Jacobian. Every entry comes from one block, so the nonzeros are only put in order."""
    following = _next_states(index).sparsity()
    rows, columns = ([np.array(i)] for i in following.get_triplet())
    entries = [ca.MX.ones(following.nnz())]
    for name, (_, slope) in outputs.items():
        row, column = (np.array(i) for i in index.blocks[name].jacobian.get_triplet())
        signs = index.signs(name)[row]
        slopes = ca.vec(slope.nz[:])
        entries.append(slopes if (signs == 1.0).all() else slopes * np.tile(signs, len(index.knots[name])))
        for k in index.knots[name]:
            rows.append(index.rows[name, k][row])
            columns.append(index.columns(k, index.blocks[name].variables)[column])
    positions = np.concatenate(columns) * index.size + np.concatenate(rows)
    order = np.argsort(positions)
    order = order[positions[order] >= 0]  # no control on the last stage, and not always an object
    kept = positions[order]
    sparsity = ca.Sparsity.triplet(
        index.size, index.variables, (kept % index.size).tolist(), (kept // index.size).tolist()
    )
    return ca.MX(sparsity, ca.vertcat(*entries)[order.tolist()])


def _matrix(positions: tuple[Indices, Indices], entries: MX, rows: int, columns: int) -> MX:
    """Returns the sparse matrix with `entries` at `positions`; several at one position add up."""
    inside = (positions[0] >= 0) & (positions[1] >= 0)
    key = positions[1] * rows + positions[0]
    unique, which = np.unique(key[inside], return_inverse=True)
    sparsity = ca.Sparsity.triplet(rows, columns, (unique % rows).tolist(), (unique // rows).tolist())
    gather = ca.DM(ca.Sparsity.triplet(len(unique), len(key), which.tolist(), np.flatnonzero(inside).tolist()), 1.0)
    return ca.MX(sparsity, gather @ entries)


def _lagrangian(index: RowIndex, x: MX, p: MX, lam_f: MX, lam_g: MX) -> tuple[MX, MX]:
    """Returns gradient and Hessian of the Lagrangian."""
    gradient = _next_states(index).T @ lam_g
    rows = []
    columns = []
    entries = []
    for name, block in index.blocks.items():
        knots = index.knots[name]
        if name == "cost":
            lam = ca.repmat(lam_f, 1, len(knots))
        else:
            lam = ca.reshape(_into_rows(index, name).T @ lam_g, block.n, -1)
        slopes, nonzeros = _mapped(index, name, "curve", x, p, lam)
        own = [index.columns(k, block.variables) for k in knots]
        positions = np.concatenate(own)
        inside = np.flatnonzero(positions >= 0)
        gradient += _scatter(positions[inside], 1.0, index.variables) @ ca.vec(slopes)[inside.tolist()]
        row, column = (np.array(i, int) for i in block.hessian.get_triplet())
        rows += [each[row] for each in own]
        columns += [each[column] for each in own]
        entries.append(ca.vec(nonzeros.nz[:]))
    stacked = ca.vertcat(*entries)
    positions = (np.concatenate(rows), np.concatenate(columns))
    matrix = _matrix(positions, stacked, index.variables, index.variables)
    return ca.densify(gradient), matrix


class Iterates(ca.Callback):
    """A casadi function (x, weight of the cost, multipliers) -> x that notes what it is called with.

    Attributes:
        seen: the arguments, in order.
    """

    def __init__(self, variables: int, rows: int) -> None:
        ca.Callback.__init__(self)
        self.seen: list[tuple[Vector, float, Vector]] = []
        self._sizes = variables, 1, rows
        self.construct("iterates", {})

    def get_n_in(self) -> int:
        """Number of arguments."""
        return 3

    def get_n_out(self) -> int:
        """Number of results."""
        return 1

    def get_sparsity_in(self, i: int) -> Any:
        """Shape of an argument."""
        return ca.Sparsity.dense(self._sizes[i], 1)

    def get_sparsity_out(self, i: int) -> Any:
        """Shape of the result."""
        return ca.Sparsity.dense(self._sizes[0], 1)

    def eval(self, arg: Sequence[Any]) -> list[Any]:
        """Notes the arguments and returns the first."""
        x, weight, multipliers = (np.array(each, float).ravel() for each in arg)
        self.seen.append((x, float(weight[0]), multipliers))
        return [arg[0]]
