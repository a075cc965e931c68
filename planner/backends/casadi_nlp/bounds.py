"""Bounds on variables and rows, and the first guess: what makes one assembled problem this request's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.backends.casadi_nlp import throw
from planner.backends.casadi_nlp.layout import (
    JERK,
    JERK_SCALE,
    NX,
    NZ,
    QD,
    QD_SCALE,
    QDD,
    QDD_SCALE,
    STEP,
    TIME,
    TIME_SCALE,
    Q,
)
from planner.backends.casadi_nlp.margins import LOCAL, Spot
from planner.backends.casadi_nlp.table import WATCHED, Table
from planner.cell import Limits

Vector = NDArray[np.float64]

STEP_SHARES = (0.15, 2.5)  # [-] of a first guess's step: a step may not collapse, nor swallow its neighbours
WATCH_S = 0.052  # [s] that the watched stages before the release last at least: the certificate looks 0.05 s back
SPOT_STAGES = 1.0  # either side of where a margin was lacking
THIN = 1e-3  # [-] of a limit: bounds that leave less room than this between them are stated as an equality
TINY_S = 1e-9  # [s] of a brake that there is none of


@dataclass
class Bounds:
    """Lower and upper bounds of variables (NZ a stage, the last padded) and of rows."""

    x: Vector  # (2, N + 1, NZ)
    g: Vector  # (2, rows)


def free_bounds(table: Table) -> Bounds:
    """Returns bounds that hold the dynamics and nothing else."""
    n = table.shape.stages + 1
    infinite = np.array([-np.inf, np.inf])
    g = np.tile(infinite[:, None], (1, table.size))
    g[:, np.concatenate(table.dynamics)] = 0.0
    return Bounds(np.tile(infinite[:, None, None], (1, n, NZ)), g)


def set_limits(bounds: Bounds, table: Table, limits: Limits, room: float, given: Sequence[Vector]) -> None:
    """Bounds joint position, velocity, acceleration and jerk, on the knots and on what lies between.

    Args:
        bounds: to be narrowed.
        table: of the assembled problem.
        limits: of the joints.
        room: kept free of the position limits [rad], …
        given: … but for positions (6,) that are asked for and lie nearer [rad].
    """
    x = bounds.x
    lower = np.min([limits.q_lower + room, *given], axis=0)
    upper = np.max([limits.q_upper - room, *given], axis=0)
    x[0, :, Q], x[1, :, Q] = lower, upper
    for rows, limit in ((QD, limits.qd_max / QD_SCALE), (QDD, limits.qdd_max / QDD_SCALE)):
        x[0, :, rows], x[1, :, rows] = -limit, limit
    x[0, :, JERK], x[1, :, JERK] = -limits.jerk_max / JERK_SCALE, limits.jerk_max / JERK_SCALE
    for k in table.shape.knots("motion"):
        bend = table.rows["motion", k][NX : NX + 6]
        bounds.g[0, bend], bounds.g[1, bend] = -limits.qd_max / QD_SCALE, limits.qd_max / QD_SCALE
        middle = table.rows["motion", k][NX + 6 :]
        bounds.g[0, middle], bounds.g[1, middle] = lower, upper


def set_groups(bounds: Bounds, table: Table, shares: tuple[float, float], least: Mapping[str, Vector]) -> None:
    """Bounds torque and tool speed to `shares` of their limits, clearances to `least`, at knots and middles."""
    for name in ("effort", "effort_middle"):
        for k in table.shape.knots(name) if table.shape.holds(name) else ():
            rows = table.rows[name, k]
            bounds.g[0, rows[:6]], bounds.g[1, rows[:6]] = -shares[0], shares[0]
            bounds.g[1, rows[6]] = shares[1] ** 2
    for group, values in least.items():
        for name in (group, f"{group}_middle"):
            bounds.g[0, table.rows_of(name)] = np.tile(values, len(table.shape.knots(name)))


def set_spots(bounds: Bounds, table: Table, spots: Iterable[Spot], steps: Vector) -> None:
    """Keeps more free at the knots and middles within a stage of each spot; stages last `steps` (n,) [s]."""
    launch = table.shape.launch
    t = np.append(0.0, np.cumsum(steps))
    shares = np.append(t[:launch] / t[launch], 1.0 + (t[launch:] - t[launch]) / max(t[-1] - t[launch], TINY_S))
    for spot in spots:
        group, first, last = LOCAL[spot.check]
        stage = np.interp(spot.share, shares, np.arange(len(shares)))
        for name, offset in ((group, 0.0), (f"{group}_middle", 0.5)):
            for k in table.shape.knots(name):
                if abs(k + offset - stage) > SPOT_STAGES:
                    continue
                rows = table.rows[name, k][first:last]
                if group == "effort":
                    bounds.g[1, rows] -= spot.amount
                if spot.check != "tcp_speed":
                    bounds.g[0, rows] += spot.amount


def set_singularity(bounds: Bounds, table: Table, signed: Vector, distance: float) -> None:
    """Keeps the arm `distance` from the singularities around the release, on the side given by `signed` (3,)."""
    for name in ("singular", "singular_middle"):
        for k in table.shape.knots(name):
            rows = table.rows[name, k]
            bounds.g[0, rows] = np.where(signed > 0.0, distance, -np.inf)
            bounds.g[1, rows] = np.where(signed > 0.0, np.inf, -distance)


def fix_ends(bounds: Bounds, table: Table, start: Vector) -> None:
    """Fixes the start at rest and the end at rest."""
    bounds.x[:, 0, Q] = start
    bounds.x[:, 0, QD] = bounds.x[:, 0, QDD] = bounds.x[:, 0, TIME] = 0.0
    bounds.x[:, -1, QD] = bounds.x[:, -1, QDD] = 0.0
    bounds.x[0, -1, NX:], bounds.x[1, -1, NX:] = -np.inf, np.inf


def set_steps(bounds: Bounds, table: Table, steps: Vector) -> None:
    """Bounds each step around the first guess's (N,) [s]; those that watch the singularities last long enough.

    The stages of a release window are watched, too: with three before them that is long enough in all but few cases,
    which the certificate finds. Asking for more released up to 3 % later.
    """
    least, most = (share * steps for share in STEP_SHARES)
    if not table.shape.window:
        watched = slice(table.shape.launch - WATCHED, table.shape.launch)
        least[watched] = np.minimum(np.maximum(least[watched], WATCH_S / WATCHED), 0.5 * most[watched])
    bounds.x[0, :-1, STEP], bounds.x[1, :-1, STEP] = least / TIME_SCALE, most / TIME_SCALE


def fix_release_state(bounds: Bounds, table: Table, q: Vector, qd: Vector) -> None:
    """Fixes joint positions and velocities at the release; its acceleration stays free within its limits.

    Rows that depend on these alone are freed: no variable is left to satisfy them, and the certificate checks them.

    A joint released at its velocity limit can only have zero acceleration there: more would exceed the limit just
    after the release, less just before it. As two inequalities that leaves an interior-point method no interior, so it
    is stated as what it is, an equality, and the inequalities it implies are freed.
    """
    k = table.shape.launch
    reached = np.abs(qd) >= (1.0 - THIN) * bounds.g[1, table.rows["motion", k - 1][NX : NX + 6]] * QD_SCALE
    for stage in (k - 1, k):
        if stage < table.shape.stages:
            bend = table.rows["motion", stage][NX : NX + 6][reached]
            bounds.g[0, bend], bounds.g[1, bend] = -np.inf, np.inf
    bounds.x[:, k, QDD][:, reached] = 0.0
    bounds.x[:, k, Q] = q
    bounds.x[:, k, QD] = qd / QD_SCALE
    free_tool_speed(bounds, table)
    for name in ("space", "boxes", "singular"):
        rows = table.rows.get((name, k), np.zeros(0, int))
        bounds.g[0, rows], bounds.g[1, rows] = -np.inf, np.inf


def free_tool_speed(bounds: Bounds, table: Table) -> None:
    """Frees the tool speed at the release, where the request fixes it."""
    rows = table.rows.get(("effort", table.shape.launch), np.zeros(0, int))[6:]
    bounds.g[0, rows], bounds.g[1, rows] = -np.inf, np.inf


def release_row(table: Table, name: str, offset: int = 0) -> np.ndarray:
    """Returns the problem's rows of one entry of `throw.ROWS`, `offset` knots from the release."""
    return throw.ROWS.split(table.rows["release", table.shape.launch + offset])[name]


def variables(t: Vector, states: tuple[Vector, Vector, Vector]) -> Vector:
    """Returns the variables (N + 1, NZ) that pass the states q, qd, qdd (N + 1, 6) at times `t` (N + 1,) [s]."""
    q, qd, qdd = states
    steps = np.diff(t)
    z = np.zeros((len(t), NZ))
    z[:, Q], z[:, QD], z[:, QDD], z[:, TIME] = q, qd / QD_SCALE, qdd / QDD_SCALE, t / TIME_SCALE
    z[:-1, JERK] = np.diff(qdd, axis=0) / steps[:, None] / JERK_SCALE
    z[:-1, STEP] = steps / TIME_SCALE
    return z
