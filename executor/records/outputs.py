"""The outputs of a plan's passages in a run: when each was sent, and when it was seen to change.

What an input sees is what the output switches; without one, the controller's own report tells when it obeyed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from executor.records.telemetry import RunResult, Telemetry
from executor.streaming.state_checks import OUTPUT_SHIFT
from planner.cell import Cell
from planner.controller_program import SwitchRow
from planner.passages import OutputEdge, OutputSwitch, output_edges
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

LATE_TICKS = 1.5  # [ticks] from plan to edge without a warning: the controller tells its outputs once a tick
LATE_STD = 3.0  # [-] standard deviations of an output's delay that are no surprise: 3 in 1,000 edges by chance


def switched_outputs(problem: ThrowProblem, trajectory: Trajectory, result: RunResult) -> list[dict[str, Any]]:
    """Returns what became of each output of the passages, in the order of their commands.

    Times are on the plan's clock [s]. An edge is seen with the first state that has the new level; it happened after
    the state before that one. It is None for an output that had that level before, or was never seen to change. What a
    stop switched follows, of no passage. The edge of a gripper is that of its output, one delay before the release.
    """
    cell = problem.cell
    edges = output_edges(problem.cell, problem.passages, trajectory)
    telemetry = Telemetry(result.rows)
    found = []
    for number, (edge, sent_s) in enumerate(zip(edges, result.switched_s, strict=True)):
        until_s = _until_s(edge, edges[number + 1 :], result.switched_s[number + 1 :], problem.dt)
        each = _record(cell, problem.passages[edge.passage].name, edge.switch, sent_s, until_s, telemetry)
        seen_s = each["edge_time_s"]
        planned_s = edge.command_time_s + cell.timing.lag_s if edge.lets_go else edge.edge_time_s
        found.append(each | {"edge_late_s": None if seen_s is None else seen_s - planned_s})
    for level in result.stop_levels:
        found.append(_record(cell, None, level, result.stopped_s, math.inf, telemetry) | {"edge_late_s": None})
    return found


def _record(
    cell: Cell, passage: str | None, switch: OutputSwitch | SwitchRow, sent_s: float, until_s: float, rows: Telemetry
) -> dict[str, Any]:
    """Returns what became of one output that was sent at a plan time, NaN for never, and changed before another [s]."""
    wired_to = cell.digital_output(switch.output, switch.index).sense_input
    bit = OUTPUT_SHIFT[switch.output] + switch.index if wired_to is None else wired_to
    column = "digital_outputs" if wired_to is None else "digital_inputs"
    levels = (rows.scalar(column).astype(np.int64) >> bit & 1) == switch.level
    clock = rows.scalar("clock_s")
    changes = np.flatnonzero(levels[1:] & ~levels[:-1] & (clock[1:] > sent_s) & (clock[1:] < until_s))
    after_s, seen_s = (float(clock[changes[0] + i]) if len(changes) else None for i in (0, 1))
    return {
        "passage": passage,
        "output": switch.output,
        "index": switch.index,
        "level": switch.level,
        "command_time_s": None if math.isnan(sent_s) else sent_s,
        "edge_after_s": after_s,
        "edge_time_s": seen_s,
        "sense_input": wired_to,
    }


def _until_s(edge: OutputEdge, later: Sequence[OutputEdge], sent_s: Sequence[float], dt: float) -> float:
    """Returns the plan time from which a change is no more an edge's, but that of the next of the same output [s]."""
    line = (edge.switch.output, edge.switch.index)
    for each, at_s in zip(later, sent_s, strict=True):
        if (each.switch.output, each.switch.index) == line and not math.isnan(at_s):
            return at_s + each.edge_time_s - each.command_time_s + dt
    return math.inf


def output_warnings(outputs: list[dict[str, Any]], problem: ThrowProblem) -> list[str]:
    """Returns what a person should know of the outputs of a run that reached its end."""
    found = []
    for each in outputs:
        name = f"output {each['output']} {each['index']} at passage {each['passage']!r}"
        late_s = each["edge_late_s"]
        output = problem.cell.digital_output(each["output"], each["index"])
        unseen_s = output.delay_s if output.sense_input is None else 0.0  # nobody sees what happens after the command
        room_s = LATE_TICKS * problem.dt + LATE_STD * output.jitter_s
        if late_s is None:
            found.append(f"{name} was not seen to change")
        elif not -room_s - max(unseen_s, 0.0) <= late_s <= room_s:
            found.append(f"{name} changed {1e3 * abs(late_s):.1f} ms {'late' if late_s > 0.0 else 'early'}")
    return found
