"""The outputs of a plan's passages in a run: when each was sent, and when it was seen to change."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from executor.records.telemetry import RunResult, Telemetry
from executor.streaming.state_checks import OUTPUT_SHIFT
from planner.controller_program import SwitchRow
from planner.passages import OutputEdge, OutputSwitch, output_edges
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

LATE_TICKS = 1.5  # [ticks] from plan to edge without a warning: the controller tells its outputs once a tick


def switched_outputs(problem: ThrowProblem, trajectory: Trajectory, result: RunResult) -> list[dict[str, Any]]:
    """Returns what became of each output of the passages, in the order of their commands.

    Times are on the plan's clock [s]. An edge is seen with the first state that has the new level, up to a tick after
    it happened; it is None for an output that had that level before, or was never seen to change. What a stop switched
    follows, of no passage.
    """
    edges = output_edges(problem.cell, problem.passages, trajectory)
    telemetry = Telemetry(result.rows)
    found = []
    for number, (edge, sent_s) in enumerate(zip(edges, result.switched_s, strict=True)):
        until_s = _until_s(edge, edges[number + 1 :], result.switched_s[number + 1 :], problem.dt)
        seen_s = None if math.isnan(sent_s) else _seen_s(edge.switch, sent_s, until_s, telemetry)
        found.append(
            {
                "passage": problem.passages[edge.passage].name,
                "output": edge.switch.output,
                "index": edge.switch.index,
                "level": edge.switch.level,
                "command_time_s": None if math.isnan(sent_s) else sent_s,
                "edge_time_s": seen_s,
                "edge_late_s": None if seen_s is None else seen_s - edge.edge_time_s,
            }
        )
    for each in result.stop_levels:
        found.append(
            {
                "passage": None,
                "output": each.output,
                "index": each.index,
                "level": each.level,
                "command_time_s": None if math.isnan(result.stopped_s) else result.stopped_s,
                "edge_time_s": _seen_s(each, result.stopped_s, math.inf, telemetry),
                "edge_late_s": None,
            }
        )
    return found


def _until_s(edge: OutputEdge, later: Sequence[OutputEdge], sent_s: Sequence[float], dt: float) -> float:
    """Returns the plan time from which a change is no more an edge's, but that of the next of the same output [s]."""
    line = (edge.switch.output, edge.switch.index)
    for each, at_s in zip(later, sent_s, strict=True):
        if (each.switch.output, each.switch.index) == line and not math.isnan(at_s):
            return at_s + each.edge_time_s - each.command_time_s + dt
    return math.inf


def _seen_s(switch: OutputSwitch | SwitchRow, sent_s: float, until_s: float, telemetry: Telemetry) -> float | None:
    """Returns the plan time of the first state between two times in which an output changes to its level [s]."""
    bit = OUTPUT_SHIFT[switch.output] + switch.index
    levels = (telemetry.scalar("digital_outputs").astype(np.int64) >> bit & 1) == switch.level
    clock = telemetry.scalar("clock_s")
    changes = levels[1:] & ~levels[:-1] & (clock[1:] > sent_s) & (clock[1:] < until_s)
    return float(clock[1:][changes][0]) if changes.any() else None


def output_warnings(outputs: list[dict[str, Any]], problem: ThrowProblem) -> list[str]:
    """Returns what a person should know of the outputs of a run that reached its end."""
    found = []
    for each in outputs:
        name = f"output {each['output']} {each['index']} at passage {each['passage']!r}"
        late_s = each["edge_late_s"]
        if late_s is None:
            found.append(f"{name} was not seen to change")
        elif abs(late_s) > LATE_TICKS * problem.dt:
            found.append(f"{name} changed {1e3 * abs(late_s):.1f} ms {'late' if late_s > 0.0 else 'early'}")
    return found
