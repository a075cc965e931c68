"""The object's path as parameters of the rows: where it is aimed at, and where the braking arm keeps off it.

The path follows from the release, which in a throw to a target is part of the solution; a stage after it knows its own
state alone. So the path is that of the solution before, and where it moves, the problem is solved again.
"""

from __future__ import annotations

import numpy as np

from planner.backends.casadi_nlp.layout import OBJECT_PATH, PATH_TERMS, Vector
from planner.flight import fly, path, touchdown_s
from planner.geometry import tool_state
from planner.problem import PointRelease, TargetRelease, ThrowProblem
from planner.seeds import Candidate

NODES = np.linspace(0.0, 1.0, PATH_TERMS)  # [-] of the flight's duration at which the polynomial is the path
SHORTEST_S = 1e-3  # [s] keeps a flight that ends at once from having no polynomial


def path_parameters(problem: ThrowProblem, q: Vector, qd: Vector, room_m: float) -> Vector:
    """Returns the `OBJECT_PATH` vector.

    Args:
        problem: the problem, of a throw.
        q, qd: joint positions and velocities (6,) at the release.
        room_m: between object and arm.
    """
    tool, radius = tool_state(problem.cell, q, qd), problem.cell.object.radius_m
    p, v = tool.p_WT, problem.release_speed_factor * tool.v_WT
    landing_s = touchdown_s(p, v, problem.plane_z, radius, problem.gravity, problem.drag)
    until_s = max(landing_s or 0.0, SHORTEST_S)
    places = path(p, v, until_s * NODES, problem.gravity, problem.drag)
    coefficients = np.linalg.solve(np.vander(NODES, increasing=True), places)
    coefficients /= until_s ** np.arange(PATH_TERMS)[:, None]
    fall = problem.gravity + problem.drag * float(v @ v)
    return OBJECT_PATH.pack({"path": coefficients, "landing": until_s, "fall": fall, "reach": radius + room_m})


def initial_aim(problem: ThrowProblem, candidate: Candidate) -> Vector:
    """Returns the landing point of the drag-free flight (3,) [m]; for a target, as from the candidate."""
    release = problem.release
    if isinstance(release, PointRelease):
        p, v = release.p_WT, release.v_WT
    else:
        tool = tool_state(problem.cell, candidate.q, candidate.qd)
        p, v = tool.p_WT, tool.v_WT
    if isinstance(release, TargetRelease):
        return drag_free_aim(problem, release.p_W, p, v)
    flight = None if problem.ends_at_rest else fly(p, v, problem.plane_z, problem.gravity_at_tool_speed)
    return np.array([p[0], p[1], problem.plane_z]) if flight is None else flight.landing_point


def drag_free_aim(problem: ThrowProblem, goal: Vector, p: Vector, v: Vector) -> Vector:
    """Returns the landing point of the drag-free flight whose real counterpart, with drag, lands on `goal` (3,) [m].

    Args:
        problem: its drag and gravity.
        goal: landing point (3,) [m].
        p: release position (3,) [m].
        v: release velocity (3,) [m/s].
    """
    if problem.drag <= 0.0:
        return goal
    ideal = fly(p, v, float(goal[2]), problem.gravity_at_tool_speed)
    real = fly(p, v, float(goal[2]), problem.gravity_at_tool_speed, problem.drag)
    if ideal is None or real is None:
        return goal
    return goal + ideal.landing_point - real.landing_point
