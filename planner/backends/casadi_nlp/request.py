"""One request in the form of an assembled problem: parameters, bounds, first guess."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.backends.casadi_nlp import bounds as bound
from planner.backends.casadi_nlp import buffered, numbers, window
from planner.backends.casadi_nlp.layout import NZ, QD, QDD, TIME, TIME_SCALE, Q
from planner.backends.casadi_nlp.margins import CLOSE, Margins
from planner.backends.casadi_nlp.stages import COST
from planner.backends.casadi_nlp.table import GROUPS, Shape, Table
from planner.cell import Limits
from planner.problem import JointRelease, PointRelease, PoseRelease, TargetRelease, ThrowProblem
from planner.seeds.candidates import Candidate

Vector = NDArray[np.float64]

LAUNCH_STAGES, BRAKE_STAGES = 8, 3  # source: measured; a jerk-optimal motion has few switches, braking is not hurried
FINE_LAUNCH_STAGES, FINE_BRAKE_STAGES = 12, 4  # where the motion between two looks at it came too near to something
BRAKE_WEIGHT = 0.05  # [-] of a second of braking against a second of launch
JERK_WEIGHT = 1e-3  # [-] of the mean squared jerk share: takes the play out of joints that have time
THIN_RAD = 1e-3  # [rad] a narrower range of elevations is stated as an equality: it has no interior to solve in
STEP_WEIGHT = 6e-2  # [-] of the mean squared deviation of a step from its first guess: keeps steps from collapsing


def whole_shape(problem: ThrowProblem, fine: bool = False) -> Shape:
    """Returns the stages that the problem needs, with every group of rows that applies."""
    groups = GROUPS if problem.cell.surroundings.keep_out else GROUPS[:-1]
    launch, brake = (FINE_LAUNCH_STAGES, FINE_BRAKE_STAGES) if fine else (LAUNCH_STAGES, BRAKE_STAGES)
    if problem.ends_at_rest:
        return Shape(launch, 0, 0, groups)
    extra = window.stages(problem)
    return Shape(launch + extra, brake + extra, extra, groups)


@dataclass(frozen=True)
class Request:
    """A problem, one candidate for its release, and what to aim at.

    Attributes:
        problem: what is asked.
        candidate: where the release is thought to be; `joint` and `pose` are held to it.
        limits: of the joints, less what the tick grid needs.
        aim: where the drag-free flight is to land (3,) [m].
        margins: kept free.
        shift: by how much the landings of the window's knots are taken for farther off than they are (2 n + 1, 2) [m].
    """

    problem: ThrowProblem
    candidate: Candidate
    limits: Limits
    aim: Vector
    margins: Margins
    shift: Vector | float = 0.0


@dataclass(frozen=True)
class Start:
    """A first guess: variables (N + 1, NZ), and the steps (N,) [s] that the solution is kept near."""

    z: Vector
    steps: Vector
    times: tuple[float, float] | None = None  # release and end [s], where they are fixed


def arguments(request: Request, table: Table, start: Start) -> dict[str, Any]:
    """Returns what a solver is called with."""
    problem, b = request.problem, bound.free_bounds(table)
    bound.set_limits(b, table, request.limits, request.margins.position_rad, _given(request))
    bound.set_groups(b, table, (request.margins.torque, request.margins.tcp_speed), _spare(request, table))
    bound.set_spots(b, table, request.margins.spots, start.steps)
    bound.fix_ends(b, table, problem.start)
    bound.set_steps(b, table, start.steps)
    if not problem.ends_at_rest:
        distance = request.margins.singularity * request.limits.singularity_distance_min
        bound.set_singularity(b, table, numbers.singular_sides(problem.cell.robot, request.candidate.q), distance)
    _set_release(b, table, request)
    if problem.is_robust:
        window.hold(b, table, problem, request.margins.window, request.shift)
    if start.times is not None:
        b.x[:, table.shape.launch, TIME] = start.times[0] / TIME_SCALE
        b.x[:, -1, TIME] = start.times[1] / TIME_SCALE
    n = table.variables
    return {
        "x0": start.z.ravel()[:n],
        "p": _parameters(request, table, start),
        "lbx": b.x[0].ravel()[:n],
        "ubx": b.x[1].ravel()[:n],
        "lbg": b.g[0],
        "ubg": b.g[1],
    }


def _parameters(request: Request, table: Table, start: Start) -> Vector:
    cell = request.problem.cell
    return np.concatenate(
        [
            numbers.arm_numbers(cell, request.limits, request.margins),
            numbers.release_numbers(request.problem, request.aim),
            numbers.box_numbers(cell, request.margins.box_m),
            _costs(table, start),
        ]
    )


def _spare(request: Request, table: Table) -> dict[str, Vector]:
    """Returns by group the least values that the clearances need to have (3,) and (1,) [m]: 0, or what is given.

    The optimiser's distances are smaller than the true ones by some millimetres: where the start, or a release that is
    asked for, is nearer than that to something, the way between is not held to more, whatever the margins have become.
    """
    cell, given, margins = request.problem.cell, _given(request), request.margins
    arm = numbers.arm_numbers(cell, request.limits, margins)
    numbers_of = {"space": arm, "boxes": np.concatenate([arm, numbers.box_numbers(cell, margins.box_m)])}
    room = {"space": [CLOSE.self_m, CLOSE.floor_m, CLOSE.keep_in_m], "boxes": [CLOSE.box_m]}
    spare = {}
    for group in (group for group in numbers_of if table.shape.holds(group)):
        value, parameters = table.blocks[group].value, numbers_of[group]
        values = [buffered.evaluate(value, _standing(q), parameters)[0].ravel() for q in given]
        spare[group] = np.minimum(np.min(values, axis=0) + room[group], 0.0)
    return spare


def _given(request: Request) -> list[Vector]:
    """Returns the joint positions (6,) that are not the optimiser's to choose [rad]."""
    fixed = isinstance(request.problem.release, JointRelease | PoseRelease)
    return [request.problem.start, request.candidate.q] if fixed else [request.problem.start]


def _standing(q: Vector) -> Vector:
    z = np.zeros(NZ)
    z[Q] = q
    return z


def _costs(table: Table, start: Start) -> Vector:
    """Returns the `COST` numbers of every stage; with fixed times only the jerk and the steps are left to choose."""
    shape, n = table.shape, table.shape.stages
    time = np.where(np.arange(n) < shape.launch, 1.0, BRAKE_WEIGHT)
    rows = np.stack(
        [
            time if start.times is None else np.zeros(n),
            np.full(n, JERK_WEIGHT / n / 6),
            np.full(n, STEP_WEIGHT / n),
            start.steps / TIME_SCALE,
        ]
    )
    assert len(rows) == COST.size
    return rows.T.ravel()


def _set_release(b: bound.Bounds, table: Table, request: Request) -> None:
    release = request.problem.release
    if isinstance(release, JointRelease | PoseRelease):
        bound.fix_release_state(b, table, request.candidate.q, request.candidate.qd)
    elif isinstance(release, PointRelease):
        b.g[:, bound.release_row(table, "position")] = release.p_WT
        if request.problem.ends_at_rest:
            b.x[:, table.shape.launch, QD] = 0.0
        else:
            b.g[:, bound.release_row(table, "velocity")] = release.v_WT
            bound.free_tool_speed(b, table)
    else:
        _set_target(b, table, release)
    if request.problem.ends_at_rest:
        b.x[:, table.shape.launch, QDD] = 0.0


def _set_target(b: bound.Bounds, table: Table, release: TargetRelease) -> None:
    b.g[:, bound.release_row(table, "landing")] = 0.0
    b.g[0, bound.release_row(table, "falls")] = window.FALL_MIN
    low, high = bound.release_row(table, "elevation")
    above, below = release.min_elevation_rad > -np.pi / 2, release.max_elevation_rad < np.pi / 2
    if above and below and release.max_elevation_rad - release.min_elevation_rad < THIN_RAD:
        b.g[:, low] = 0.0
    else:
        b.g[0, low] = 0.0 if above else -np.inf
        b.g[1, high] = 0.0 if below else np.inf
    if np.isfinite(release.max_speed_m_s):
        b.g[1, bound.release_row(table, "speed")] = release.max_speed_m_s**2
    if release.min_horizontal_distance_m > 0.0:
        b.g[0, bound.release_row(table, "distance")] = release.min_horizontal_distance_m**2
    if release.release_position is not None:
        b.g[:, bound.release_row(table, "position")] = release.release_position


def guess(table: Table, problem: ThrowProblem, at: Mapping[str, Any]) -> Start:
    """Returns the first guess from a motion.

    Args:
        table: of the assembled problem.
        problem: for its window.
        at: "release_s", "end_s" [s] and "state", a function of times (k,) that gives q, qd, qdd (k, 6).
    """
    shape, release, end = table.shape, at["release_s"], at["end_s"]
    inner = table.shape.window
    around = problem.release_window_s if inner else 0.0
    first, last = max(release - around, release / 2), min(release + around, (release + end) / 2)
    launch = np.linspace(0.0, first, shape.launch - inner + 1)
    before, after = np.linspace(first, release, inner + 1), np.linspace(release, last, inner + 1)
    brake = np.linspace(last, end, shape.brake - inner + 1)
    t = np.concatenate([launch, before[1:], after[1:], brake[1:]])
    return Start(bound.variables(t, at["state"](t)), np.diff(t))
