"""A motion on the controller's ticks: the rows that are streamed, or compiled to a program of the controller."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.approach import Brakes
from planner.cell import Cell
from planner.controller_program import ROWS_MAX, STRIDE_MAX_S, ControllerProgram, GripperEdge, NoProgram, SwitchRow
from planner.passages import OutputEdge, output_edges
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

LEAD_IN_S = 0.020  # [s] at rest before the plan begins: the stream is running smoothly by then
SETTLE_S = 0.060  # [s] at rest after it: the measured motion, one lag behind, comes to its end; outputs are seen to


@dataclass(frozen=True)
class StreamRows:
    """A motion sampled on the controller's ticks.

    Attributes:
        first_clock_s: plan time of row 0 [s].
        q, qd, qdd: (M, 6) [rad, rad/s, rad/s^2].
        reference_q, reference_qd: (M, 6) one lag earlier [rad, rad/s].
        release_row: row nearest to the release.
        output_row: row with which the gripper's output is switched; -1 for a motion that throws nothing.
        switches: the outputs of the passages, in the order of the edges.
    """

    first_clock_s: float
    q: Vector
    qd: Vector
    qdd: Vector
    reference_q: Vector
    reference_qd: Vector
    release_row: int
    output_row: int
    switches: tuple[SwitchRow, ...] = ()


def sample_rows(
    cell: Cell,
    trajectory: Trajectory,
    throws: bool,
    edges: Sequence[OutputEdge] = (),
    first_clock_s: float | None = None,
) -> StreamRows:
    """Samples a motion, at rest before and after, so that one command falls on a tick exactly.

    That is the gripper's; without a throw, the first of the outputs about the passages. Other outputs are switched with
    the nearest row. Rows are on the plan's clock, on which the motion is measured; a row is sent one lag earlier, and
    so is an output's command: the gripper's at release - delay - lag, the plan's `command_time_s` (docs/conventions.md,
    Time).

    Args:
        cell: the robot station.
        trajectory: of the motion.
        throws: whether the gripper opens.
        edges: of the outputs about the passages.
        first_clock_s: plan time of row 0 [s]; None: as early as the first command asks for.
    """
    dt = trajectory.dt
    lag = cell.timing.lag_s
    opens, told = _told(cell, trajectory, edges)
    first = first_clock_s
    if first is None:
        first = _first_clock_s(cell, trajectory, throws, edges)
    seen = [edge.edge_time_s + lag + SETTLE_S for edge in edges]
    last = max(trajectory.duration_s + lag + SETTLE_S, *seen, 0.0)
    count = math.ceil((last - first) / dt) + 1
    clock = first + np.arange(count) * dt
    q, qd, qdd = trajectory.at(clock)
    still = (clock <= 0.0) | (clock >= trajectory.duration_s)
    qd[still] = 0.0
    qdd[still] = 0.0
    reference_q, reference_qd, _ = trajectory.at(clock - lag)
    release_row = round((trajectory.release_time_s - first) / dt)
    output_row = round((opens - first) / dt) if throws else -1
    switches = []
    for edge, at_s in zip(edges, told, strict=True):
        until = math.ceil((edge.edge_time_s - first + lag) / dt) if edge.lets_go else -1
        line = (edge.switch.output, edge.switch.index, edge.switch.level)
        switches.append(SwitchRow(round((at_s - first) / dt), *line, held_until=until))
    return StreamRows(first, q, qd, qdd, reference_q, reference_qd, release_row, output_row, _one_a_row(switches))


def lead_in_s(problem: ThrowProblem, trajectory: Trajectory) -> float:
    """Returns how long before its start a motion's first row is sent [s]: more where an output is due before that."""
    cell = problem.cell
    edges = output_edges(cell, problem.passages, trajectory)
    return cell.timing.lag_s - _first_clock_s(cell, trajectory, problem.throws, edges)


def _told(cell: Cell, trajectory: Trajectory, edges: Sequence[OutputEdge]) -> tuple[float, list[float]]:
    """Returns plan times at which the gripper's output, and other outputs without a delay, must change [s]."""
    return (
        trajectory.release_time_s - cell.gripper.delay_s,
        [edge.command_time_s + cell.timing.lag_s for edge in edges],
    )


def _first_clock_s(cell: Cell, trajectory: Trajectory, throws: bool, edges: Sequence[OutputEdge]) -> float:
    """Returns the plan time of row 0 [s]: as early as the first command asks for. Arguments as of `sample_rows`."""
    dt = trajectory.dt
    opens, told = _told(cell, trajectory, edges)
    origin = opens if throws else next(iter(told), 0.0)
    return origin - math.ceil((origin - min(origin, 0.0, *told) + cell.timing.lag_s + LEAD_IN_S) / dt) * dt


def controller_program(cell: Cell, rows: StreamRows, brakes: Brakes, thinned: bool = False) -> ControllerProgram:
    """Returns the program that makes a motion inside the controller.

    Args:
        cell: the robot station.
        rows: of the motion.
        brakes: from each of them.
        thinned: leave rows out, and ramp from one to the next, where a program does not hold all: an approach.

    Raises:
        NoProgram: there are too many rows, more than one output opens the gripper, or several grippers open.
    """
    gripper = cell.gripper
    if any(switch.held_until >= 0 for switch in rows.switches):
        raise NoProgram("mode: a program lets go of one object, and this motion of several: use speedj or servoj")
    if rows.output_row >= 0 and (gripper.link is not None or gripper.second is not None):
        how = "more than one output" if gripper.link is None else "no output of the controller"
        raise NoProgram(f"a program opens grippers of one output; gripper.kind {gripper.kind!r} has {how}: use speedj")
    dt = 1.0 / cell.robot.sample_rate_hz
    lag_ticks = cell.timing.lag_s / dt
    stride = 1
    if thinned:
        stride = min(math.ceil(len(rows.q) / ROWS_MAX), max(int(STRIDE_MAX_S / dt), 1))
    own = brakes.row == np.arange(len(rows.q))
    return ControllerProgram(
        start=rows.q[0].tolist(),
        qd=rows.qd[::stride].tolist(),
        brake_ticks=np.where(own, brakes.ticks, -1)[::stride].tolist(),
        dt=dt,
        stride=stride,
        rest_ticks=int(lag_ticks) + 3,
        acceleration=float(np.min(cell.robot.qdd_max)),
        gripper=GripperEdge(
            output=gripper.output,
            index=gripper.index,
            open_level=gripper.open_level,
            row=rows.output_row,
            closes_until=math.ceil(rows.release_row + lag_ticks),
            close_s=gripper.close_s,
        ),
        switches=rows.switches,
    )


def _one_a_row(switches: Sequence[SwitchRow]) -> tuple[SwitchRow, ...]:
    """Returns switches in the order of their rows, with edges of one output that are a tick apart in rows of their own.

    Rounding brings two of them into one row where the ticks fall in the middle between rows. What follows the one that
    is moved on is not before it: switches are made in their order.
    """
    last: dict[tuple[str, int], int] = {}
    found: list[SwitchRow] = []
    row = 0
    for each in switches:
        line = (each.output, each.index)
        row = max(row, each.row, last.get(line, -1) + 1)
        found.append(replace(each, row=row))
        last[line] = row
    return tuple(found)
