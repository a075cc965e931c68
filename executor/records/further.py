"""What became of the objects that other grippers let go than the first, in a motion of several."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from executor.records.landing import Landing
from executor.records.telemetry import RunResult
from planner.certificate import release_flight
from planner.passages import OutputEdge, output_edges
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory


def further_releases(
    problem: ThrowProblem, trajectory: Trajectory, result: RunResult, landings: Mapping[str, Landing | None]
) -> list[dict[str, Any]]:
    """Returns when each other gripper was told to open, and where its object landed, in the order of their releases.

    Args:
        problem, trajectory: of the plan.
        result: end of the run.
        landings: as they were observed, by the names of the grippers.
    """
    sent = dict(_sent(problem, trajectory, result))
    found = []
    for part in (each for each in problem.parts[1:] if each.problem.throws):
        name = part.problem.cell.mounted
        landing = landings.get(name)
        at = None if landing is None else landing.released_at
        opened_s = None if at is None else at - result.timestamp_at_zero
        motion = part.of(trajectory)
        flight = release_flight(part.problem, motion)
        point = None if landing is None else landing.point
        off_m = None
        if point is not None and flight is not None:
            off_m = float(np.linalg.norm(point - flight.landing_point))
        found.append(
            {
                "gripper": name or None,
                "passage": problem.passages[part.release].name,
                "commanded_s": sent.get(part.release),
                "opened_s": opened_s,
                "opened_late_s": None if opened_s is None else opened_s - motion.release_time_s,
                "landing_point": None if point is None else point.tolist(),
                "landing_error_m": off_m,
                "landed_on": None if landing is None else landing.surface,
            }
        )
    return found


def further_words(problem: ThrowProblem, trajectory: Trajectory, result: RunResult) -> list[str]:
    """Returns what became of each of these objects in a run that was stopped."""
    sent = dict(_sent(problem, trajectory, result))
    closed = {each.line for each in result.stop_levels if each.held_until >= 0}
    found = []
    for edge in _edges(problem, trajectory):
        name = f"the object of {problem.passages[edge.passage].name!r}"
        if sent[edge.passage] is None:
            found.append(f"{name} is held")
        elif (edge.switch.output, edge.switch.index) in closed:
            found.append(f"{name} is held: its gripper was told to close again before it left")
        else:
            found.append(f"{name} left")
    return found


def _edges(problem: ThrowProblem, trajectory: Trajectory) -> list[OutputEdge]:
    return [edge for edge in output_edges(problem.cell, problem.passages, trajectory) if edge.lets_go]


def _sent(problem: ThrowProblem, trajectory: Trajectory, result: RunResult) -> Iterator[tuple[int, float | None]]:
    """Yields the passages at which other grippers let go, and when these were told to [s]; None for never."""
    edges = output_edges(problem.cell, problem.passages, trajectory)
    for edge, sent_s in zip(edges, result.switched_s, strict=True):
        if edge.lets_go:
            yield edge.passage, None if math.isnan(sent_s) else sent_s
