"""Stored plans as JSON documents, read back into problem and trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.cell import Cell
from planner.errors import FieldError, InvalidProblem
from planner.problem import ThrowProblem
from planner.request import problem_from_request
from planner.trajectory import Trajectory


def plan_from_document(document: Mapping[str, Any], cell: Cell) -> tuple[ThrowProblem, Trajectory]:
    """Returns problem and trajectory of a stored plan, for the executor to certify again with its own cell.

    Args:
        document: as `GET /plans/{id}` returns it.
        cell: the robot station that will execute the plan.

    Raises:
        InvalidProblem: the request does not fit this cell, or the trajectory is malformed.
    """
    cell = _as_the_flight_says(cell, document.get("flight") or {})
    problem = replace(problem_from_request(document["request"], cell), **_window(document))
    problem = aimed_problem(problem, aim_shift(document))
    samples = document["trajectory"]
    arrays = [np.array(samples[name], float) for name in ("positions", "velocities", "accelerations")]
    try:
        trajectory = Trajectory(float(document["sample_rate_hz"]), *arrays, release_index=document["release"]["index"])
    except (ValueError, TypeError) as error:
        raise InvalidProblem([FieldError("trajectory", str(error))]) from error
    return problem, trajectory


def aim_shift(document: Mapping[str, Any]) -> Array:
    """Returns by how much a plan's aim lies off its target (3,) [m], so that a learnt cell hits the target."""
    aim = document.get("aim")
    return np.zeros(3) if aim is None else np.array(aim["shift_m"], float)


def promised_tolerance(document: Mapping[str, Any], problem: ThrowProblem) -> float | None:
    """Returns the landing error that a plan promises not to exceed [m]; None where it promises nothing.

    A window promises its tolerance, a bin its room, and a request what it states; a soonest throw that states none is
    for whoever accepts any landing.

    Args:
        document: the plan.
        problem: read from it.
    """
    target = problem.target
    stated = document["request"].get("landing_tolerance_m")
    if target is None or not (problem.is_robust or stated or target.opening is not None):
        return None
    return problem.landing_tolerance_m or None


def aimed_problem(problem: ThrowProblem, shift: Array) -> ThrowProblem:
    """Returns the problem with its aim, and the mouth that the flight enters, moved by `shift` (3,) [m].

    The bin that the arm keeps out of stays where it stands.
    """
    target = problem.target
    if target is None or not shift.any():
        return problem
    aim = replace(target, p_W=target.p_W + shift)
    return replace(problem, release=problem.release.with_target(aim), aim_shift=problem.aim_shift + shift)


def _as_the_flight_says(cell: Cell, flight: Mapping[str, Any]) -> Cell:
    """Returns the cell with the release speed factor and the drag that a plan was made with.

    Plans of version 0.1 do not state them: their objects leave with the tool's speed, with the cell's drag.
    """
    factor = float(flight.get("release_speed_factor", 1.0))
    drag = float(flight.get("drag_coefficient", cell.object.drag_coefficient))
    if (factor, drag) == (cell.gripper.release_speed_factor, cell.object.drag_coefficient):
        return cell
    gripper = replace(cell.gripper, release_speed_factor=factor)
    thing = replace(cell.object, drag_coefficient=drag)
    return replace(cell, gripper=gripper, object=thing)


def _window(document: Mapping[str, Any]) -> dict[str, float]:
    """Returns the window that the plan was made for, which the cell's defaults of today do not change.

    Plans of version 0.1 do not state it: those without one in their request had none.
    """
    flight = document.get("flight") or {}
    request = document["request"]
    names = ("release_window_s", "landing_tolerance_m")
    return {name: float(flight.get(name, request.get(name)) or 0.0) for name in names}
