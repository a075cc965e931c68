"""Refusal of a release whose flight meets an obstacle whatever the arm does: its place and velocity fix the flight.

Joint, pose and point releases fix where the object leaves and how fast. Keep-out shapes and the arm's base stand still,
so no motion keeps such a flight clear of them.
"""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, Mask
from planner.cell import Solid
from planner.errors import Violation
from planner.flight import fly, path, touchdown_s
from planner.geometry import body_model, footprint, point_segment_distance, segment_shape_distance, tool_state
from planner.problem import ThrowProblem

STEP_S = 0.001  # [s] between the instants that are looked at; a contact in between is left to the certificate
FLIGHT_MAX_S = 10.0  # [s] longer ones begin faster than any arm throws, and are refused for that
COARSE = 16  # [-] steps between the instants that are looked at first: most flights stay far from everything
SLACK_M = 0.002  # [m] depth from which a contact is proven: the certificate lets the release deviate by less


def released_flight_blocked(problem: ThrowProblem) -> Violation | None:
    """Returns the violation by a flight that the request fixes and that meets a shape or the base; None otherwise."""
    if problem.target is not None or not problem.throws:
        return None
    p, v = _release(problem)
    t = _times(problem, p, v)
    if len(t) == 0 or _is_far(problem, p, v, t):
        return None
    x, lies = _centres(problem, p, v, t)
    gaps = _gaps(problem, x, lies)
    name = min(gaps, key=lambda name: float(gaps[name].min(initial=np.inf)), default="")
    if not name or gaps[name].min(initial=np.inf) > -SLACK_M:
        return None
    deepest = int(gaps[name].argmin())
    detail = f"{name}, {t[deepest]:.3f} s after the release, on any flight with this place and velocity"
    around = problem.cell.surroundings
    limit = around.flight_clearance_m
    if name in around.keep_out_names:
        met = around.keep_out_names.index(name)
        limit = float(around.flight_clearances[met])
        if _comes_from_above(around.keep_out[met], x, gaps[name]):
            detail += f"; to land on a {around.keep_out[met].kind}, ask for a target on it"
    return Violation("flight_clearance", float(gaps[name][deepest]), limit, "m", detail=detail, proven=True)


def _comes_from_above(met: Solid, x: Array, gaps: Array) -> bool:
    """Returns whether a flight with centres x (n, 3) and gaps (n,) [m] is over a level top before they touch."""
    last_clear = x[max(int((gaps < 0.0).argmax()) - 1, 0)]
    is_over = met.has_level_top and footprint(met).depth(last_clear) >= 0.0
    return bool(is_over and last_clear[2] > met.upper[2])


def _release(problem: ThrowProblem) -> tuple[Array, Array]:
    """Returns position (3,) [m] and velocity (3,) [m/s] of the object at the release."""
    release = problem.release
    tool = release.tool_state or release.point_state
    if tool is None:
        assert release.joint_state is not None
        tool = tool_state(problem.cell, *release.joint_state)
    return tool.p_WT, problem.release_speed_factor * tool.v_WT


def _times(problem: ThrowProblem, p: Array, v: Array) -> Array:
    """Returns times (n,) [s] from the release until the centre passes the landing plane; none if too late or never.

    Of a body, until it may touch: nothing is known of it after that.
    """
    if problem.body is not None:
        reach = problem.body.outer_radius_m
        touch_s = touchdown_s(p, v, problem.plane_z, reach, problem.gravity, problem.drag)
        return np.zeros(0) if touch_s is None or touch_s > FLIGHT_MAX_S else np.arange(0.0, touch_s, STEP_S)
    flight = fly(p, v, problem.plane_z, problem.gravity, problem.drag)
    if flight is None or flight.time_of_flight_s > FLIGHT_MAX_S:
        return np.zeros(0)
    return np.arange(0.0, flight.time_of_flight_s, STEP_S)


def _centres(problem: ThrowProblem, p: Array, v: Array, t: Array) -> tuple[Array, Mask]:
    """Returns the centres (n, 3) [m] at times (n,) [s], and at which of them the object has touched and lies (n,)."""
    if problem.body is not None:
        return path(p, v, t, problem.gravity, problem.drag), np.zeros(len(t), np.bool_)
    touch_s = touchdown_s(p, v, problem.plane_z, problem.cell.object.radius_m, problem.gravity, problem.drag)
    assert touch_s is not None
    assert problem.lies_z is not None
    x = path(p, v, t, problem.gravity, problem.drag)
    lies = t > touch_s
    x[lies, 2] = problem.lies_z
    return x, lies


def _is_far(problem: ThrowProblem, p: Array, v: Array, t: Array) -> bool:
    """Returns whether a few centres are so far from everything that those at all times `t` (n,) [s] are clear."""
    few = np.append(t[::COARSE], t[-1])
    x, _ = _centres(problem, p, v, few)
    gaps = _gaps(problem, x, np.zeros(len(x), bool))  # as from its place at the touch it may have met the base before
    fall = max(0.0, float(p[2]) - problem.plane_z)
    moved = COARSE / 2 * STEP_S * np.sqrt(v @ v + 2.0 * problem.gravity * fall)  # from the nearest of the few, at most
    return all(gap.min() - moved > -SLACK_M for gap in gaps.values())


def _gaps(problem: ThrowProblem, x: Array, lies: Mask) -> dict[str, Array]:
    """Returns the distances (n,) [m] of the sphere at centres (n, 3) from every shape and every part of the base.

    Of a body that of the largest ball within it, however it is turned.

    Where it `lies` (n,), as the certificate's it keeps clear of shapes alone.
    """
    cell, body = problem.cell, body_model(problem.cell)
    radius = cell.object.inner_radius_m
    stands = zip(cell.surroundings.keep_out_names, cell.surroundings.keep_out, strict=True)
    gaps = {name: segment_shape_distance(x, x, shape) - radius for name, shape in stands}
    for i, start, end, thick in zip(np.flatnonzero(body.frames == 0), *body.base_shapes, strict=True):
        gaps[body.names[i]] = np.where(lies, np.inf, point_segment_distance(x, start, end) - thick - radius)
    return gaps
