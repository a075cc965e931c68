"""What a cell's executions have shown: throws with their recordings and landings, read from the store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import orjson

from learning.hit_evidence import TargetOutcome
from learning.release import ObservedThrow
from learning.streamed_arm import StreamedArm
from learning.throws import ThrowTable, table_times, throw_table
from planner.answer import aim_shift, aimed_problem, plan_from_document
from planner.arrays import Array
from planner.cell import Cell
from planner.certificate import release_flight
from planner.errors import PlannerError
from planner.problem import ThrowProblem
from planner.releases import Target
from planner.trajectory import Trajectory, columns_at
from store import ExecutionRow, LandingRow, Store

THROWS_MAX = 60  # newest throws of a cell that count: a fit of them takes a second, and drift makes older ones useless
SMOOTHING_S = 0.010  # [s] half width of the mean over recorded deviations: shorter than a launch's shape
# [rad/s] of a recorded joint speed beyond its noise; source: chosen, a fifth of the scatter of a real UR5
SPEED_STD_RAD_S = 0.005
UNRECORDED_RAD_S = 0.022  # [rad/s] of a joint speed that was not recorded; source: residual of a real UR5
UNKNOWN_STD_M = 0.010  # [m] of a position that was reported without one: by eye, with a tape
LEAST_STD_M = 0.001  # [m] of a position that claims to be exact: the model is no better
COUNTED = ("completed", "late")  # outcomes of throws whose gripper opened at a known time on a known motion
WITHOUT_TARGET = "a hit, edge or miss counts only with a target and the radius of a hit"
IN_THE_WAY = ("keep_out", "bin")  # beginnings of what an object may land on instead of the plane
BOTTOM = "bin"  # of the plan's own bin: it lies in the plan's plane, unlike the top of its wall and any other bin


@dataclass(frozen=True, eq=False)
class ThrowEvidence:
    """One execution that threw.

    Attributes:
        execution_id, landing_ids: where the evidence is.
        landing: where the plan was to land: its target, else where its flight ends (2,) [m].
        planned_qd: joint speeds planned at the release (6,) [rad/s].
        deviation: recorded less what the arm's lag and gains make of the plan (6,) [rad/s]; None without a recording.
        observed: where it landed; None where no position was reported.
        outcome: whether it hit; None where a position was reported, or nothing.
        opened: between which times after its command the gripper opened, by its own reports [s]; None without any.
        unused: why what was reported of its landing does not count; None where it counts, or nothing was reported.
    """

    execution_id: str
    landing_ids: tuple[str, ...]
    landing: Array
    planned_qd: Array
    deviation: Array | None
    observed: ObservedThrow | None
    outcome: TargetOutcome | None
    unused: str | None = None
    opened: tuple[float, float] | None = None


@dataclass(frozen=True)
class UnusedThrow:
    """An execution with a reported landing that teaches nothing, and why."""

    execution_id: str
    reason: str


def throw_evidence(store: Store, cell: Cell, arm: StreamedArm) -> tuple[list[ThrowEvidence], list[UnusedThrow]]:
    """Returns the throws of a cell, oldest first, and those with a reported landing that do not count.

    Args:
        store: with executions, recordings and landings.
        cell: as its file says.
        arm: lag and gains, whose part in the deviations is no scatter.
    """
    found: list[ThrowEvidence] = []
    unused: list[UnusedThrow] = []
    for row in store.executions_of_cell(cell.name):
        try:
            found.append(_evidence(store, cell, arm, row))
            reason = found[-1].unused
        except _Unusable as error:
            reason = str(error) if store.landings(row.id) else None
        if reason is not None:
            unused.append(UnusedThrow(row.id, reason))
        if len(found) == THROWS_MAX:
            break
    return found[::-1], unused[::-1]


class _Unusable(Exception):
    """The execution teaches nothing; the text says why."""


def _evidence(store: Store, cell: Cell, arm: StreamedArm, row: ExecutionRow) -> ThrowEvidence:
    """Returns what an execution teaches.

    A gripper's command that was late is no fault here: its time is known, and the arm's motion is recorded.
    """
    numbers = row.metrics or {}
    sent = numbers.get("gripper_commanded_s")
    if row.dry_run or sent is None:
        raise _Unusable("the gripper was not commanded to open")
    if row.outcome not in COUNTED:
        raise _Unusable(f"its outcome is {row.outcome}")
    document, problem, trajectory = _plan(store, cell, row)
    if problem.cell.mounted:
        raise _Unusable("another gripper than the cell's own let go first")
    recording = store.recording(row.id)
    columns = {} if recording is None else _columns(*recording.table)
    if row.outcome != "completed" and not (columns and columns["clock"][-1] >= trajectory.duration_s):
        raise _Unusable(f"its outcome is {row.outcome}, and its recording ends before the motion")
    off = _deviations(columns, trajectory) if columns else None
    reported = store.landings(row.id)
    asked = aimed_problem(problem, -aim_shift(document))
    stopped = _in_the_way(numbers, asked.target)
    landings = [] if stopped else reported
    observed = outcome = unused = deviation = None
    if landings:
        told_place = _position(landings) is not None  # in the world; otherwise whether the target was hit
        table = throw_table(problem, trajectory, off, beside_target=not told_place)
        lead = trajectory.release_time_s - float(sent)
        observed, outcome = _seen(table, lead, asked.target, landings, is_recorded=bool(columns))
    if reported and observed is None and outcome is None:
        unused = f"the object landed on {numbers['landed_on']}" if stopped else WITHOUT_TARGET
    if off is not None and row.outcome == "completed":  # lost ticks say nothing of gains
        deviation = off[1][len(off[1]) // 2] - _expected(arm, cell, trajectory, numbers)
    ids = tuple(x.id for x in landings)
    landing = _planned_landing(asked, trajectory)
    qd = trajectory.qd[trajectory.release_index]
    opened = _opened(cell, numbers, float(sent))
    return ThrowEvidence(row.id, ids, landing, qd, deviation, observed, outcome, unused, opened)


def _opened(cell: Cell, numbers: Mapping[str, Any], sent: float) -> tuple[float, float] | None:
    """Returns between which times after its command the gripper opened [s]; a register may be as old as its period."""
    moved = numbers.get("gripper_moved_s")
    if moved is None:
        return None
    period_s = 0.0 if cell.gripper.link is None else cell.gripper.link.quantum_s
    return max(moved[0] - period_s - sent, 0.0), moved[1] - sent


def _seen(
    table: ThrowTable, lead_s: float, target: Target | None, landings: Sequence[LandingRow], is_recorded: bool
) -> tuple[ObservedThrow | None, TargetOutcome | None]:
    """Returns what the reported landings say: a position, else whether the throw hit; None twice where neither."""
    std = SPEED_STD_RAD_S if is_recorded else UNRECORDED_RAD_S
    position = _position(landings)
    if position is not None:
        return ObservedThrow(table, lead_s, *position, np.full(6, std**2)), None
    return None, _outcome(table, lead_s, target, landings, std)


def _plan(store: Store, cell: Cell, row: ExecutionRow) -> tuple[dict[str, Any], ThrowProblem, Trajectory]:
    """Returns document, problem and trajectory of an execution's plan."""
    if row.joined:
        raise _Unusable("it went on with another plan")
    plan = store.plan(row.plan_id)
    if plan is None:
        raise _Unusable("its plan is gone")
    if plan.cell_sha256 != cell.sha256:
        raise _Unusable("it was planned for another version of the cell file")
    document = orjson.loads(plan.document)
    try:
        return document, *plan_from_document(document, cell)
    except (PlannerError, KeyError, TypeError) as error:
        raise _Unusable("its plan is of an earlier version of Fling") from error


def _planned_landing(problem: ThrowProblem, trajectory: Trajectory) -> Array:
    """Returns where a plan was to land (2,) [m]; NaN where its object never does."""
    if problem.target is not None:
        return problem.target.p_W[:2]
    flight = release_flight(problem, trajectory)
    return np.full(2, np.nan) if flight is None else flight.landing_point[:2]


def _columns(header: Sequence[str], table: Array) -> dict[str, Array]:
    """Returns clock (n,), positions (n, 6) and speeds (n, 6) of a recording; empty without enough rows."""
    if len(table) < 2:
        return {}
    q, qd = ([header.index(f"{name}_{j}_{unit}") for j in range(6)] for name, unit in (("q", "rad"), ("qd", "rad_s")))
    return {"clock": table[:, header.index("clock_s")], "q": table[:, q], "qd": table[:, qd]}


def _deviations(columns: Mapping[str, Array], trajectory: Trajectory) -> tuple[Array, Array]:
    """Returns recorded less planned positions and speeds (m, 6) at the times of a throw's table."""
    clock = columns["clock"]
    planned = trajectory.at(clock)
    times = table_times(trajectory.release_time_s)
    smooth = [_smoothed(clock, columns[name] - planned[i]) for i, name in enumerate(("q", "qd"))]
    q, qd = (columns_at(times, clock, x) for x in smooth)
    return q, qd


def _smoothed(clock: Array, values: Array) -> Array:
    """Returns the mean (n, 6) over rows within `SMOOTHING_S`."""
    half = max(0, round(SMOOTHING_S / float(np.median(np.diff(clock)))))
    window = np.ones(2 * half + 1)
    count = np.convolve(np.ones(len(clock)), window, mode="same")
    if len(count) != len(clock):
        return values  # the recording is shorter than the window
    return np.stack([np.convolve(column, window, mode="same") / count for column in values.T], axis=1)


def _expected(arm: StreamedArm, cell: Cell, trajectory: Trajectory, numbers: Mapping[str, Any]) -> Array:
    """Returns the deviation of the speeds (6,) that lag and gains cause at the release; none is known of servoj."""
    timing = numbers.get("timing")
    if not timing or timing["mode"] != "speedj":
        return np.zeros(6)
    at = np.array([trajectory.release_time_s])
    return arm.deviation(trajectory, timing["assumed_lag_s"], cell.robot.qd_max, at)[1][0]


def _in_the_way(numbers: Mapping[str, Any], target: Target | None) -> bool:
    """Returns whether an object was stopped before it reached the plan's plane, as far as anybody knows."""
    surface = str(numbers.get("landed_on") or "")
    if surface == BOTTOM and target is not None and target.opening is not None:
        return False
    return surface.startswith(IN_THE_WAY)


def _outcome(
    table: ThrowTable, lead_s: float, target: Target | None, landings: Sequence[LandingRow], speed_std: float
) -> TargetOutcome | None:
    """Returns the first report of whether a throw hit; None where there is no target, or no such report."""
    for seen in landings:
        if seen.result is not None and seen.radius_m and target is not None:
            return TargetOutcome(table, lead_s, target.p_W[:2], seen.radius_m, seen.result, speed_std)
    return None


def _position(landings: Sequence[LandingRow]) -> tuple[Array, float] | None:
    """Returns the observed landing point (2,) and its standard deviation [m]; several reports are averaged."""
    seen = [
        (x.position[:2], UNKNOWN_STD_M if x.std_m is None else max(x.std_m, LEAST_STD_M))
        for x in landings
        if x.position is not None
    ]
    if not seen:
        return None
    points = np.array([x for x, _ in seen], float)
    std = np.array([s for _, s in seen])
    weight = 1.0 / std**2
    return weight @ points / weight.sum(), float(1.0 / np.sqrt(weight.sum()))
