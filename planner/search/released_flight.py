"""Refusal of a release whose flight meets an obstacle whatever the arm does: its place and velocity fix the flight.

Joint, pose and point releases fix where the object leaves and how fast. Keep-out boxes and the arm's base stand still,
so no motion keeps such a flight clear of them.
"""

from __future__ import annotations

import numpy as np

from planner.arrays import Array
from planner.errors import Violation
from planner.flight import fly, path
from planner.geometry import body_model, segment_box_distance, segment_segment_distance, tool_state
from planner.problem import JointRelease, PointRelease, PoseRelease, TargetRelease, ThrowProblem

STEP_S = 0.001  # [s] between the instants that are looked at; a contact in between is left to the certificate
SLACK_M = 0.002  # [m] depth from which a contact is proven: the certificate lets the release deviate by less


def released_flight_blocked(problem: ThrowProblem) -> Violation | None:
    """Returns the violation by a flight that the request fixes and that meets a box or the base; None otherwise."""
    if isinstance(problem.release, TargetRelease) or problem.ends_at_rest:
        return None
    t, x = _centres(problem, *_release(problem))
    gaps = _gaps(problem, x)
    name = min(gaps, key=lambda name: float(gaps[name].min(initial=np.inf)), default="")
    if not name or gaps[name].min(initial=np.inf) > -SLACK_M:
        return None
    deepest = int(gaps[name].argmin())
    detail = f"{name}, {t[deepest]:.3f} s after the release, on every flight with this place and velocity"
    return Violation("flight_clearance", float(gaps[name][deepest]), 0.0, "m", detail=detail, proven=True)


def _release(problem: ThrowProblem) -> tuple[Array, Array]:
    """Returns position (3,) [m] and velocity (3,) [m/s] of the object at the release."""
    match problem.release:
        case JointRelease(q, qd):
            tool = tool_state(problem.cell, q, qd)
            return tool.p_WT, tool.v_WT
        case PoseRelease(X_WT, V_WT):
            return X_WT[:3, 3], V_WT[:3]
        case PointRelease(p_WT, v_WT):
            return p_WT, v_WT
    raise AssertionError("a target does not fix the flight")


def _centres(problem: ThrowProblem, p: Array, v: Array) -> tuple[Array, Array]:
    """Returns times (n,) [s] and centres (n, 3) [m] from the release until the sphere touches the landing plane."""
    for height in (problem.plane_z + problem.cell.object.radius_m, problem.plane_z):
        flight = fly(p, v, height, problem.gravity, problem.drag)
        if flight is not None:
            t = np.arange(0.0, flight.time_of_flight_s, STEP_S)
            return t, path(p, v, t, problem.gravity, problem.drag)
    return np.zeros(0), np.zeros((0, 3))


def _gaps(problem: ThrowProblem, x: Array) -> dict[str, Array]:
    """Returns the distances (n,) [m] of the sphere at centres (n, 3) from every box and every part of the base."""
    cell, body = problem.cell, body_model(problem.cell)
    radius = cell.object.radius_m
    boxes = enumerate(cell.surroundings.keep_out)
    gaps = {f"box {i}": segment_box_distance(x, x, box.lower, box.upper) - radius for i, box in boxes}
    ends = body.end_points(body.link_poses(problem.start[None]))[..., 0]
    for i in np.flatnonzero(body.frames == 0):
        apart = segment_segment_distance(x, x, *ends[i][:, None])
        gaps[body.names[i]] = apart - body.radii[i] - radius
    return gaps
