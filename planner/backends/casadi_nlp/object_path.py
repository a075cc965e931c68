"""The object's path as parameters of the rows: where it is aimed at, and where the braking arm keeps off it.

The path follows from the release, which in a throw to a target is part of the solution: the object's position and
velocity there are states of the stages from then on. What drag adds to the path and to the time of the landing is that
of the initial guess, or of the solution before.
"""

from __future__ import annotations

import math

import numpy as np

from planner.backends.casadi_nlp.layout import ARM_CAPSULES, OBJECT_PATH, PATH_TERMS, STANDING, Vector
from planner.backends.casadi_nlp.tuning import LEAVING
from planner.flight import fly, path, touchdown_s
from planner.geometry import body_model, tool_state
from planner.problem import ThrowProblem

NODES = np.linspace(0.0, 1.0, PATH_TERMS)  # [-] of the flight's duration at which the polynomial is the path
SHORTEST_S = 1e-3  # [s] keeps a flight that ends at once from having no polynomial


def leaving_time(problem: ThrowProblem) -> float:
    """Returns how long an object may take out of the grip [s]: longer than in free fall beside a tool at rest."""
    return LEAVING * math.sqrt(2.0 * problem.cell.object.way_out_m / problem.gravity)


def thrown_state(problem: ThrowProblem, q: Vector, qd: Vector) -> tuple[Vector, Vector]:
    """Returns position [m] and velocity [m/s] (3,) of an object that is released at q, qd (6,)."""
    tool = tool_state(problem.cell, q, qd)
    return tool.p_WT, problem.release_speed_factor * tool.v_WT


def path_parameters(problem: ThrowProblem, q: Vector, qd: Vector, room_m: float, carried: bool) -> Vector:
    """Returns the `OBJECT_PATH` vector; zeros for a move to rest.

    Args:
        problem: the problem.
        q, qd: joint positions and velocities (6,) at the release.
        room_m: between object and arm, beyond the flight clearance.
        carried: whether position and velocity of the object are variables, so that they are not part of the path.
    """
    if problem.ends_at_rest:
        return np.zeros(OBJECT_PATH.size)
    p, v = thrown_state(problem, q, qd)
    landing_s = touchdown_s(p, v, problem.plane_z, problem.landing_radius_m, problem.gravity, problem.drag)
    until_s = max(landing_s or 0.0, SHORTEST_S)
    places = path(p, v, until_s * NODES, problem.gravity, problem.drag)
    coefficients = np.linalg.solve(np.vander(NODES, increasing=True), places)
    coefficients /= until_s ** np.arange(PATH_TERMS)[:, None]
    ground, without_drag_s = _landing_without_drag(problem, p, v) if carried else (problem.plane_z, None)
    if carried:
        coefficients[0] -= p
        coefficients[1] -= v
    return OBJECT_PATH.pack(
        {
            "path": coefficients,
            "landing": until_s - (without_drag_s or 0.0),
            "lands": float(without_drag_s is not None),
            "ground": ground,
            "gravity": problem.gravity,
            "fall": problem.gravity + problem.drag * float(v @ v),
            "reach": problem.cell.object.radius_m + _clearances(problem) + room_m,
            "share": problem.release_speed_factor,
        }
    )


def standing_parameters(problem: ThrowProblem, room_m: float) -> Vector:
    """Returns the `STANDING` vector, with `room_m` [m] between the object and what never moves of the arm.

    The room is beyond the flight clearance.
    """
    first, last, radii = body_model(problem.cell).base_shapes
    return STANDING.pack(
        {
            "capsules": np.column_stack([first, last, radii]),
            "reach": problem.cell.object.radius_m + problem.flight_clearances[1] + room_m,
            "ground": problem.plane_z + problem.landing_radius_m,
            "gravity": problem.gravity,
            "share": problem.release_speed_factor,
        }
    )


def _clearances(problem: ThrowProblem) -> Vector:
    """Returns the flight clearance of each link but the base [m]: none where the object is gripped beside it."""
    body = body_model(problem.cell)
    beside = {body.names[i] for i in body.beside_object}
    usual = problem.cell.surroundings.flight_clearance_m
    return np.array([0.0 if name in beside else usual for name in ARM_CAPSULES if name != "base"])


def _landing_without_drag(problem: ThrowProblem, p: Vector, v: Vector) -> tuple[float, float | None]:
    """Returns where the object's centre is when its flight without drag ends, its height [m], and when [s] or None."""
    for ground in (problem.plane_z + problem.landing_radius_m, problem.plane_z):
        flight = fly(p, v, ground, problem.gravity)
        if flight is not None:
            return ground, flight.time_of_flight_s
    return problem.plane_z, None
