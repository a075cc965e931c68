"""The functions of the whole problem, as casadi puts them together from the blocks: what the extension is tested by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from planner.backends.casadi_nlp.layout import N_THROWN, NU, NX, NZ, StageLayout, Vector
from planner.backends.casadi_nlp.symbols import COST, FORMULAS
from planner.backends.casadi_nlp.transcription import ALL_SHARED, Indices, RowIndex, row_index

MX = Any


@cache
def whole_problem(stages: StageLayout) -> dict[str, Any]:
    """Returns the functions f, g, grad_f, jac_g and hess_l of (x, p) of a layout."""
    return assemble(row_index(stages))


def states_at(index: RowIndex, k: int) -> Indices:
    """Returns the positions of a stage's states, the object's last."""
    thrown = thrown_at(index, k)
    return np.append(columns_at(index, k)[:NX], thrown[thrown >= 0])


def columns_at(index: RowIndex, k: int, count: int = NZ) -> Indices:
    """Returns the positions of the first `count` variables (z, thrown) of a stage; -1 for what it does not have."""
    z = np.arange(k * NZ, (k + 1) * NZ)
    if k == index.stages.stages:
        z[NX:] = -1
    return np.append(z, thrown_at(index, k))[:count]


def thrown_at(index: RowIndex, k: int) -> Indices:
    """Returns the positions of the object's states of a stage; -1 where it has none."""
    if k < index.stages.thrown:
        return np.full(N_THROWN, -1)
    return index.core + N_THROWN * (k - index.stages.thrown) + np.arange(N_THROWN)


def signs_of(index: RowIndex, block: str) -> np.ndarray:
    """Returns the signs (n,) with which a block's rows enter the problem: F enters as x_{k+1} - F."""
    signs = np.ones(index.blocks[block].n)
    following = index.following(block)
    signs[: following.stop - following.start] = -1.0
    return signs


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
    thrown = [thrown_at(index, k) for k in knots]
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
    return _scatter(index.rows_of[name], np.tile(signs_of(index, name), len(index.knots[name])), index.size)


def _scatter(positions: Indices, values: np.ndarray | float, rows: int) -> Any:
    """Returns the constant matrix (rows, n) that adds entry i, times its value, to row `positions[i]`."""
    n = len(positions)
    sparsity = ca.Sparsity.triplet(rows, n, [int(i) for i in positions], list(range(n)))
    return ca.DM(sparsity, np.broadcast_to(values, n).copy())  # one entry per column: triplet order is kept


def _next_states(index: RowIndex) -> Any:
    """Returns the constant matrix that x_{k+1} enters the dynamics by."""
    rows = np.concatenate(index.dynamics)
    columns = np.concatenate([states_at(index, k + 1) for k in range(index.stages.stages)])
    return ca.DM(ca.Sparsity.triplet(index.size, index.variables, rows.tolist(), columns.tolist()), 1.0)


def _jacobian(index: RowIndex, outputs: Mapping[str, Sequence[MX]]) -> MX:
    """Returns the Jacobian. Every entry comes from one block, so the nonzeros are only put in order."""
    following = _next_states(index).sparsity()
    rows, columns = ([np.array(i)] for i in following.get_triplet())
    entries = [ca.MX.ones(following.nnz())]
    for name, (_, slope) in outputs.items():
        row, column = (np.array(i) for i in index.blocks[name].jacobian.get_triplet())
        signs = signs_of(index, name)[row]
        slopes = ca.vec(slope.nz[:])
        entries.append(slopes if (signs == 1.0).all() else slopes * np.tile(signs, len(index.knots[name])))
        for k in index.knots[name]:
            rows.append(index.rows[name, k][row])
            columns.append(columns_at(index, k, index.blocks[name].variables)[column])
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
        own = [columns_at(index, k, block.variables) for k in knots]
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
