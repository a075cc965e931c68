"""Parameters of block "flight": the edges, the bin's mouth and the gripper's opening that the object passes.

Edges and mouth are passed by the object that is let go of as early, and as late, as the gripper may open: at the knots
of a release window, and by what the gripper's jitter is longer, before and after.

A box is passed over its top, by one of its sides or below it, between the times at which the flight crosses two of its
vertical planes; one that carries the target is come upon over its edge. So is the box that bounds another shape, where
the flight is clear of it; where it is not, it keeps to its side of the shape when it is nearest. The optimiser cannot
change sides: the candidate's own flight decides.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from planner.backends.casadi_nlp.layout import FLIGHT, FLIGHT_EDGES, Vector
from planner.backends.casadi_nlp.margins import Margins
from planner.cell import CONTACT_M, Solid
from planner.flight import time_of_flight
from planner.geometry import Arcs, segment_shape_distance, tool_state
from planner.problem import ThrowProblem
from planner.seeds import Candidate

UNBOUNDED_RADIUS_M = 1.0e3  # [m] radius where there is no bin
LEAST_SPEED_M_S = 0.05  # [m/s] a flight slower than this along an axis hardly crosses the planes across it
NEAREST = np.linspace(0.0, 1.0, 96)  # [-] of a flight, at which it is compared with a shape that it passes closely
DOWN = (0.0, 0.0, -1.0)

# A half-space in which the flight x(t) has to be at one time, as the parameters of a slot (8,): direction @ x(t) >=
# bound. That time is (offset - normal @ p) / (normal @ v + steady) for a release at p with velocity v, in x and y.
Edge = list[float]


def constrains_flight(problem: ThrowProblem) -> bool:
    """Returns whether block "flight" says anything about a problem: an edge, a mouth or an opening direction."""
    if not problem.throws:
        return False
    has_shapes = problem.target is not None and bool(problem.cell.surroundings.keep_out)
    return has_shapes or problem.opening is not None or problem.cell.gripper.opening_direction is not None


def flight_parameters(problem: ThrowProblem, candidate: Candidate, margins: Margins, aim: Vector) -> Vector:
    """Returns the `FLIGHT` vector.

    Args:
        problem: the problem.
        candidate: whose flight decides how shapes are passed.
        margins: room beside edges and within the opening's cone.
        aim: landing point of the drag-free flight (3,) [m].
    """
    edges: list[Edge] = []
    mouth = [*aim, UNBOUNDED_RADIUS_M, 0.0]
    if problem.target is not None:
        arcs = _flight(problem, candidate)
        edges = _shape_edges(problem, arcs, margins.flight_m)
        if problem.opening is not None:
            rim_z = problem.plane_z + problem.opening.rim_height_m
            x, y = (problem.target.p_W - _way_to_landing(problem, arcs, rim_z))[:2]
            mouth = [x, y, rim_z, problem.opening.radius_m, arcs.radius_m + margins.mouth_m]
    edges += [edge_at(0.0, (0.0, 0.0, 0.0), -1.0)] * (FLIGHT_EDGES - len(edges))  # hold with 1 m to spare
    opening = _opening(problem, margins.opening_rad)
    spread = [problem.opening_spread_s - problem.planned_window_s]  # the window has rows at knots of its own
    return FLIGHT.pack({"edges": np.array(edges), "mouth": mouth, "spread": spread, "opening": opening})


def _flight(problem: ThrowProblem, candidate: Candidate) -> Arcs:
    tool = tool_state(problem.cell, candidate.q, candidate.qd)
    radius = problem.cell.object.radius_m
    arcs = Arcs.onto(tool.p_WT, tool.v_WT, problem.plane_z, problem.gravity_at_tool_speed, radius)
    return arcs.until_landed(problem.plane_z, problem.surfaces)


def _way_to_landing(problem: ThrowProblem, arcs: Arcs, rim_z: float) -> Vector:
    """Returns the way (3,) [m] of a bin that moves while the object falls from its mouth to its bottom."""
    if problem.moving is None:
        return np.zeros(3)
    enters_s, lands_s = time_of_flight(arcs.p[2] - np.array([rim_z, problem.plane_z]), arcs.v[2], arcs.gravity)
    return np.asarray(np.nan_to_num(lands_s - enters_s) * problem.moving.v_W)


def _opening(problem: ThrowProblem, margin_rad: float) -> list[float]:
    """Returns the opening direction in the flange frame, the cosine of the largest angle from it, the way out (5,)."""
    gripper = problem.cell.gripper
    out_m = problem.cell.object.way_out_m
    if gripper.opening_direction is None or gripper.opening_cone_rad is None:
        return [0.0, 0.0, 0.0, -1.0, out_m]
    direction = problem.cell.tool.X_FT[:3, :3] @ gripper.opening_direction
    return [*direction, math.cos(gripper.opening_cone_rad - min(margin_rad, 0.5 * gripper.opening_cone_rad)), out_m]


def _shape_edges(problem: ThrowProblem, arcs: Arcs, room_m: float) -> list[Edge]:
    """Returns the first `FLIGHT_EDGES` edges, two a shape at most, of the shapes that the flight passes most closely.

    The flight leaves at least the room between the boxes about the two, so that most shapes need no closer look.
    """
    around = problem.cell.surroundings
    lowest = max(problem.plane_z - arcs.radius_m, around.floor_z_m + CONTACT_M)
    rooms_m = room_m + problem.flight_clearances[0]
    lower, upper = around.keep_out_bounds
    apex_s = min(max(float(arcs.v[2]) / arcs.gravity, 0.0), float(arcs.until_s))
    x = np.array([arcs.at(np.asarray(t)) for t in (0.0, apex_s, float(arcs.until_s))])
    apart = np.maximum(lower - x.max(axis=0), x.min(axis=0) - upper).max(axis=1) - rooms_m - arcs.radius_m
    passed: list[tuple[float, int, list[Edge]]] = []
    for i in np.argsort(apart, kind="stable").tolist():
        if apart[i] > 0.0 and sum(len(edges) for room, _, edges in passed if room < apart[i]) >= FLIGHT_EDGES:
            break
        if upper[i, 2] > lowest:  # the object comes down above the others
            room, edges = _way_of(problem, around.keep_out[i], arcs, float(rooms_m[i]))
            passed.append((room, i, edges))
    return [edge for _, _, edges in sorted(passed) for edge in edges][:FLIGHT_EDGES]


def _way_of(problem: ThrowProblem, shape: Solid, arcs: Arcs, room_m: float) -> tuple[float, list[Edge]]:
    """Returns the room [m] of the way onto or past a shape that leaves most, and its edges."""
    onto = list(_way_onto(shape, arcs, room_m)) if shape.upper[2] <= problem.plane_z + CONTACT_M else []
    way = max(onto or _ways_past(shape, arcs, room_m), key=lambda way: way[0], default=(math.inf, []))
    is_bound = bool(onto) or shape.core is None or way[0] >= 0.0
    return way if is_bound else _way_beside(shape, arcs, room_m)


def _way_beside(shape: Solid, arcs: Arcs, room_m: float) -> tuple[float, list[Edge]]:
    """Returns the room [m] beside a shape, and the plane that parts it from the flight where the two are nearest."""
    t = float(arcs.until_s) * NEAREST
    x = arcs.at(t)
    gaps = segment_shape_distance(x, x, shape)
    nearest = int(gaps.argmin())
    outside = x[nearest] if gaps[nearest] > 0.0 else x[0]  # a flight into it comes from there
    apart = outside - shape.nearest(outside)
    if not apart.any():
        return math.inf, []
    direction = apart / np.linalg.norm(apart)
    bound = float(direction @ (outside - apart)) + shape.radius_m + arcs.radius_m + room_m
    return float(direction @ x[nearest]) - bound, [edge_at(float(t[nearest]), direction, bound)]


def _ways_past(shape: Solid, arcs: Arcs, room_m: float) -> Iterator[tuple[float, list[Edge]]]:
    """Yields the ways past the box about a shape: the flight's room [m] and the edges; none where it stays away."""
    grown = arcs.radius_m + room_m
    lower = shape.lower - grown
    upper = shape.upper + grown
    for axis in (0, 1):
        speed = float(arcs.v[axis])
        if abs(speed) < LEAST_SPEED_M_S:
            continue
        faces = sorted((lower[axis], upper[axis]), key=lambda face: (face - arcs.p[axis]) / speed)
        times = [float(face - arcs.p[axis]) / speed for face in faces]
        if times[1] < 0.0 or times[0] > arcs.until_s:
            continue
        ends = np.clip(times, 0.0, arcs.until_s)
        crossed = [face for face, t in zip(faces, times, strict=True) if t < arcs.until_s]
        for direction, bound in _sides(axis, lower, upper):
            room = min(float(arcs.at(np.asarray(t)) @ direction) for t in ends) - bound
            yield room, [edge_across(axis, face, speed, direction, bound) for face in crossed]
        edges = [edge_across(axis, face, speed, DOWN, -float(lower[2])) for face in crossed]
        yield _way_below(arcs, float(lower[2]), ends, edges)


def _way_onto(shape: Solid, arcs: Arcs, room_m: float) -> Iterator[tuple[float, list[Edge]]]:
    """Yields the way onto a shape: room [m] over the edge that the flight comes in by; none where it ends elsewhere."""
    coming = float(arcs.until_over(shape.lower, shape.upper).until_s)
    if coming == arcs.until_s:
        return
    x = arcs.at(np.asarray(coming))
    bound = float(shape.upper[2]) + arcs.radius_m + room_m
    faces = np.where(arcs.v[:2] > 0.0, shape.lower[:2], shape.upper[:2])
    axis = int(np.abs(x[:2] - faces).argmin())
    starts_over = coming == 0.0 or abs(arcs.v[axis]) < LEAST_SPEED_M_S
    up = np.array([0.0, 0.0, 1.0])
    edges = [] if starts_over else [edge_across(axis, float(faces[axis]), float(arcs.v[axis]), up, bound)]
    yield math.inf if starts_over else float(x[2]) - bound, edges


def _way_below(arcs: Arcs, height: float, ends: Vector, edges: list[Edge]) -> tuple[float, list[Edge]]:
    """Returns the room [m] below `height` between two times, and the edges: unlike over a box, the apex is nearest."""
    apex_s = float(arcs.v[2]) / arcs.gravity
    if not ends[0] < apex_s < ends[1]:
        return height - float(arcs.height_at(ends).max()), edges
    return height - float(arcs.height_at(np.asarray(apex_s))), [edge_at(apex_s, DOWN, -height)]


def _sides(axis: int, lower: Vector, upper: Vector) -> Iterator[tuple[Vector, float]]:
    """Yields the half-spaces above and on either side of a grown box that is crossed along `axis`."""
    other = np.eye(3)[1 - axis]
    yield np.array([0.0, 0.0, 1.0]), float(upper[2])
    yield other, float(upper[1 - axis])
    yield -other, -float(lower[1 - axis])


def edge_across(axis: int, face_m: float, speed_m_s: float, direction: Iterable[float], bound_m: float) -> Edge:
    """Returns the edge at the time at which the flight crosses a face along `axis` (0 or 1), at about this speed."""
    normal = [0.0, 0.0]
    normal[axis] = 1.0 / speed_m_s
    return [*normal, 0.0, face_m / speed_m_s, *direction, bound_m]


def edge_at(time_s: float, direction: Iterable[float], bound_m: float) -> Edge:
    """Returns the edge at a time after the release."""
    return [0.0, 0.0, 1.0, time_s, *direction, bound_m]
