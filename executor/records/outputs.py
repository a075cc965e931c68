"""The outputs of a plan's passages in a run: when each was sent, and when it was seen to change."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from executor.records.telemetry import RunResult, Telemetry
from executor.streaming.state_checks import OUTPUT_SHIFT
from planner.passages import OutputEdge, output_edges
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

LATE_TICKS = 1.5  # [ticks] from plan to edge without a warning: the controller tells its outputs once a tick


def switched_outputs(problem: ThrowProblem, trajectory: Trajectory, result: RunResult) -> list[dict[str, Any]]:
    """Returns what became of each output of the passages, in the order of their commands.

    Times are on the plan's clock [s]. An edge is seen with the first state that has the new level, up to a tick after
    it happened; it is None for an output that had that level before, or was never seen to change.
    """
    edges = output_edges(problem.cell, problem.passages, trajectory)
    telemetry = Telemetry(result.rows)
    found = []
    for edge, sent_s in zip(edges, result.switched_s, strict=True):
        seen_s = None if math.isnan(sent_s) else _seen_s(edge, sent_s, telemetry)
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
    return found


def _seen_s(edge: OutputEdge, sent_s: float, telemetry: Telemetry) -> float | None:
    """Returns the plan time of the first state after a command in which the output changes to its level [s]."""
    bit = OUTPUT_SHIFT[edge.switch.output] + edge.switch.index
    levels = (telemetry.scalar("digital_outputs").astype(np.int64) >> bit & 1) == edge.switch.level
    clock = telemetry.scalar("clock_s")
    changes = levels[1:] & ~levels[:-1] & (clock[1:] > sent_s)
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
