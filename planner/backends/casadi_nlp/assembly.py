"""The optimal control problem, put together from blocks in the form that fatrop takes.

Variables: z_0 … z_N, each state then control, the last without a control. Rows, stage by stage: x_{k+1} - F(x_k, u_k),
then the rows of the blocks that apply there. All derivatives are the blocks', mapped over the stages and moved to their
places by constant sparse matrices; nothing of this size is ever differentiated or compiled.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from planner.backends.casadi_nlp.blocks import Block
from planner.backends.casadi_nlp.layout import ARM, BOXES, NX, NZ, RELEASE
from planner.backends.casadi_nlp.stages import COST
from planner.backends.casadi_nlp.table import Shape, Table

MX = Any
PARAMETERS = ARM.size + RELEASE.size + BOXES.size  # before the costs of the stages


def assemble(shape: Shape, blocks: Mapping[str, Block]) -> tuple[dict[str, Any], Table]:
    """Returns the functions f, g and their derivatives of (x, p), and where the rows stand."""
    blocks = {name: block for name, block in blocks.items() if shape.holds(name)}
    table = Table(shape, blocks)
    x, p = ca.MX.sym("x", table.variables), ca.MX.sym("p", PARAMETERS + COST.size * shape.stages)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", table.size)
    f, g, jacobian = _objective(table, x, p), _constraints(table, x, p), _jacobian(table, x, p)
    slope, hessian = _curvature(table, x, p, lam_f, lam_g)
    outputs = {
        "f": ([x, p], [f]),
        "g": ([x, p], [g]),
        "grad_f": ([x, p], [_gradient(table, x, p)]),
        "jac_g": ([x, p], [g, jacobian]),
        "hess_l": ([x, p, lam_f, lam_g], [slope, hessian]),
    }
    return {name: ca.Function(name, *both) for name, both in outputs.items()}, table


def _columns(table: Table, x: MX) -> MX:
    """Returns the stages as columns (NZ, N + 1)."""
    return ca.reshape(ca.vertcat(x, ca.MX.zeros(NZ - NX)), NZ, table.shape.stages + 1)


def _parameters(table: Table, name: str, p: MX) -> MX:
    arm, boxes = p[: ARM.size], p[ARM.size + RELEASE.size : PARAMETERS]
    return {
        "motion": ca.MX(0, 1),
        "release": p[: ARM.size + RELEASE.size],
        "boxes": ca.vertcat(arm, boxes),
        "boxes_middle": ca.vertcat(arm, boxes),
        "cost": ca.reshape(p[PARAMETERS:], COST.size, table.shape.stages),
    }.get(name, p[: ARM.size])


def _mapped(table: Table, name: str, kind: str, x: MX, p: MX, *more: MX) -> tuple[MX, ...]:
    """Returns the outputs of a block's function, a column a stage."""
    knots = table.shape.knots(name)
    function = getattr(table.blocks[name], kind)
    common = [] if name == "cost" else [1]
    mapped = function.map(f"{function.name()}_{len(knots)}", "serial", len(knots), common, [])
    result = mapped(_columns(table, x)[:, knots.start : knots.stop], _parameters(table, name, p), *more)
    return tuple(result) if isinstance(result, (list, tuple)) else (result,)


def _rowed(table: Table) -> list[str]:
    return [name for name in table.blocks if name != "cost"]


def _objective(table: Table, x: MX, p: MX) -> MX:
    return ca.sum2(_mapped(table, "cost", "value", x, p)[0])


def _gradient(table: Table, x: MX, p: MX) -> MX:
    block, steps = table.blocks["cost"], table.shape.stages
    nonzeros = ca.vec(_mapped(table, "cost", "slope", x, p)[1].nz[:])
    _, columns = block.jacobian.get_triplet()
    places = np.concatenate([k * NZ + np.array(columns) for k in range(steps)])
    return ca.densify(_scatter(places, 1.0, table.variables) @ nonzeros)


def _constraints(table: Table, x: MX, p: MX) -> MX:
    g = _next_states(table) @ x
    for name in _rowed(table):
        values = _mapped(table, name, "value", x, p)[0]
        g += _scatter(_places(table, name), _signs(table, name), table.size) @ ca.vec(values)
    return g


def _places(table: Table, name: str) -> np.ndarray:
    return np.concatenate([table.rows[name, k] for k in table.shape.knots(name)])


def _signs(table: Table, name: str) -> np.ndarray:
    ones = np.ones(table.blocks[name].n) * table.sign(name)
    return np.tile(ones, len(table.shape.knots(name)))


def _scatter(places: np.ndarray, values: np.ndarray | float, rows: int) -> Any:
    """Returns the constant matrix (rows, n) that adds entry i, times its value, to row `places[i]`."""
    n = len(places)
    sparsity = ca.Sparsity.triplet(rows, n, [int(i) for i in places], list(range(n)))
    return ca.DM(sparsity, np.broadcast_to(values, n).copy())  # one entry a column: triplet order is kept


def _next_states(table: Table) -> Any:
    """Returns the constant matrix that takes x_{k+1} into the dynamics' rows."""
    rows = np.concatenate(table.dynamics)
    columns = np.concatenate([(k + 1) * NZ + np.arange(NX) for k in range(table.shape.stages)])
    sparsity = ca.Sparsity.triplet(table.size, table.variables, rows.tolist(), columns.tolist())
    return ca.DM(sparsity, 1.0)


def _jacobian(table: Table, x: MX, p: MX) -> MX:
    n = table.shape.stages * NX
    rows = [np.concatenate(table.dynamics)]
    columns = [np.concatenate([(k + 1) * NZ + np.arange(NX) for k in range(table.shape.stages)])]
    signs, entries = [np.ones(n)], [ca.MX(ca.DM.ones(n))]
    for name in _rowed(table):
        entries.append(ca.vec(_mapped(table, name, "slope", x, p)[1].nz[:]))
        row, column = (np.array(i) for i in table.blocks[name].jacobian.get_triplet())
        sign = (np.ones(table.blocks[name].n) * table.sign(name))[row]
        for k in table.shape.knots(name):
            rows.append(table.rows[name, k][row])
            columns.append(k * NZ + column)
            signs.append(sign)
    places = (np.concatenate(rows), np.concatenate(columns))
    return _matrix(places, np.concatenate(signs), ca.vertcat(*entries), table.size, table.variables)


def _matrix(places: tuple[np.ndarray, np.ndarray], signs: np.ndarray, entries: MX, rows: int, columns: int) -> MX:
    """Returns the sparse matrix with `entries` times `signs` at `places`; several at one place add up."""
    inside = places[1] < columns
    key = places[1] * rows + places[0]
    unique, which = np.unique(key[inside], return_inverse=True)
    sparsity = ca.Sparsity.triplet(rows, columns, (unique % rows).tolist(), (unique // rows).tolist())
    gather = ca.DM(
        ca.Sparsity.triplet(len(unique), len(key), which.tolist(), np.flatnonzero(inside).tolist()), signs[inside]
    )
    return ca.MX(sparsity, gather @ entries)


def _curvature(table: Table, x: MX, p: MX, lam_f: MX, lam_g: MX) -> tuple[MX, MX]:
    """Returns gradient and Hessian of the Lagrangian."""
    gradient = _next_states(table).T @ lam_g
    rows, columns, entries = [], [], []
    for name, block in table.blocks.items():
        knots = table.shape.knots(name)
        if name == "cost":
            lam = ca.repmat(lam_f, 1, len(knots))
        else:
            lam = ca.reshape(_scatter(_places(table, name), _signs(table, name), table.size).T @ lam_g, block.n, -1)
        slopes, nonzeros = _mapped(table, name, "curve", x, p, lam)
        inside = np.concatenate([k * NZ + np.arange(NZ) for k in knots])
        inside = np.minimum(inside, table.variables - 1)  # the last stage has no control: its slopes there are zero
        gradient += _scatter(inside, 1.0, table.variables) @ ca.vec(slopes)
        row, column = (np.array(i, int) for i in block.hessian.get_triplet())
        for k in knots:
            rows.append(k * NZ + row)
            columns.append(k * NZ + column)
        entries.append(ca.vec(nonzeros.nz[:]))
    places = (np.concatenate(rows), np.concatenate(columns))
    stacked = ca.vertcat(*entries)
    return ca.densify(gradient), _matrix(places, np.ones(stacked.shape[0]), stacked, table.variables, table.variables)
