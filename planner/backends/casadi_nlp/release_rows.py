"""What a release asks of the optimiser: bounds and parameters of its rows, by its demands.

Joint states that are given are fixed as variables and have no rows. Of others each entry of
`RELEASE_ROWS` has bounds; where they are equal, the release is refined until it fulfils them exactly.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from planner.backends.casadi_nlp.layout import RELEASE, Vector
from planner.backends.casadi_nlp.symbols import RELEASE_ROWS
from planner.backends.casadi_nlp.tuning import TOUCHING, WINDOW_STAGES
from planner.flight import fly
from planner.geometry import tool_state
from planner.problem import ThrowProblem

ROUNDING = 1e-9  # [-] of a number of stages
FALL_MIN = 0.05  # [m^2/s^2] least discriminant of a flight: below, the object only grazes the plane
LARGEST_SLOPE_RAD = 1.57  # [rad] elevations beyond have hardly a finite tangent: they are no limits
# [m, m/s, rad] that a solution's release may be off by drag or calibration: its refinement moves it by about as much
ROOM = 3e-3


def window_stages(problem: ThrowProblem) -> int:
    """Returns the number of stages in half the release window, 0 without a window.

    A requested release state or velocity leaves a window little to choose: one stage is enough.
    """
    if not problem.is_robust:
        return 0
    if problem.target is None:
        return 1
    fitting = math.floor(problem.release_window_s / problem.dt + ROUNDING)
    return max(1, min(WINDOW_STAGES, fitting))


def release_bounds(problem: ThrowProblem) -> Vector:
    """Returns lower and upper bounds (2, n) of `RELEASE_ROWS` at the release of a problem whose joint state is free."""
    point = problem.release.point_state
    target = problem.target
    bounds = np.tile([[-np.inf], [np.inf]], RELEASE_ROWS.size)
    at = RELEASE_ROWS.slices
    if point is not None:
        bounds[:, at["position"]] = point.p_WT
        if not problem.ends_at_rest:
            bounds[:, at["velocity"]] = point.v_WT
        return bounds
    assert target is not None
    lowest = target.min_elevation_rad
    highest = target.max_elevation_rad
    bounds[:, at["landing"]] = 0.0
    bounds[0, at["falls"]] = FALL_MIN
    bounds[0, at["elevation"]] = 0.0 if lowest > -LARGEST_SLOPE_RAD else -np.inf, -np.inf
    bounds[1, at["elevation"]] = np.inf, 0.0 if highest < LARGEST_SLOPE_RAD else np.inf
    if highest - lowest < TOUCHING:
        bounds[:, at["elevation"]] = [[0.0, -np.inf], [0.0, np.inf]]
    bounds[1, at["speed"]] = target.max_speed_m_s**2
    if target.min_horizontal_distance_m > 0.0:
        bounds[0, at["distance"]] = target.min_horizontal_distance_m**2
    if target.release_position is not None:
        bounds[:, at["position"]] = target.release_position
    return bounds


def release_parameters(problem: ThrowProblem, aim: Vector) -> Vector:
    """Returns the `RELEASE` vector for an aim (3,) [m]."""
    elevations = (-math.pi / 2, math.pi / 2)
    if problem.target is not None:
        elevations = (problem.target.min_elevation_rad, problem.target.max_elevation_rad)
    slopes = np.tan(np.clip(elevations, -LARGEST_SLOPE_RAD, LARGEST_SLOPE_RAD))
    return RELEASE.pack({"target": aim, "gravity_z": problem.gravity_at_tool_speed, "tan_elevation": slopes})


def with_room(problem: ThrowProblem) -> ThrowProblem:
    """Returns the problem, for a calibrated arm with room in the bounds on the release.

    The refined release keeps what is asked exactly, such as the landing, and moves within this room else.
    """
    target = problem.target
    if problem.cell.robot.fixed is None or target is None:
        return problem
    lowest = target.min_elevation_rad
    highest = target.max_elevation_rad
    room = min(ROOM, max(highest - lowest, 0.0) / 4.0)
    inner = replace(
        target,
        max_speed_m_s=target.max_speed_m_s - min(ROOM, target.max_speed_m_s / 4.0),
        min_elevation_rad=lowest + room if lowest > -math.pi / 2 else lowest,
        max_elevation_rad=highest - room if highest < math.pi / 2 else highest,
        min_horizontal_distance_m=target.min_horizontal_distance_m + ROOM * (target.min_horizontal_distance_m > 0.0),
    )
    return replace(problem, release=problem.release.with_target(inner))


def aim_from(problem: ThrowProblem, q: Vector, qd: Vector) -> Vector:
    """Returns the landing point (3,) [m] that the drag-free flight from joint states q, qd (6,) is to have.

    Where the object is to land somewhere, the flight with drag lands there then. Otherwise that flight's own, about
    which nothing is asked.
    """
    tool = tool_state(problem.cell, q, qd)
    if problem.target is not None:
        return drag_free_aim(problem, problem.target.p_W, tool.p_WT, tool.v_WT)
    flight = None if problem.ends_at_rest else fly(tool.p_WT, tool.v_WT, problem.plane_z, problem.gravity_at_tool_speed)
    return np.append(tool.p_WT[:2], problem.plane_z) if flight is None else flight.landing_point


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
