"""Which flights of candidates are clear: of the keep-out shapes, through a bin's mouth, out of the open gripper.

Filters that steer the search towards what the certificate can pass; they do not replace it. Drag is left out.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from planner.arrays import Array, Mask
from planner.cell import CONTACT_M, Solid
from planner.errors import Violation
from planner.geometry import Arcs, body_model, point_segment_distance, segment_shape_distance
from planner.problem import ThrowProblem
from planner.releases import Target

FLIGHT_TIMES = (1.0, 0.8, 1.25, 0.6)  # [-] flight times tried, relative to that of the slowest throw
STEEP_TIMES = (1.5, 1.8, 2.2, 2.6)  # [-] tried too where something may have to be cleared; 2.6: 82 degrees on a plane
BESIDE_BASE_M = 0.1  # [m] a target this near to the arm's base has its flights compared with it
INSTANTS = np.linspace(0.0, 1.0, 8)  # [-] compared with the base, of a flight's last third, or with what it falls past
RIM = "the rim of the bin"
FLIGHT_GAP_M = 0.005  # [m] between object and obstacle beyond what is required: room for release window and drag


def has_flight_obstacles(problem: ThrowProblem) -> bool:
    """Returns whether shapes or a bin's rim may stand in the way of a throw to a target."""
    return bool(flight_obstacles(problem))


def flight_obstacles(problem: ThrowProblem) -> list[str]:
    """Returns the names of what may stand in the way of a throw to a target; none for another release."""
    if problem.target is None:
        return []
    return [*problem.cell.surroundings.keep_out_names, *([RIM] if problem.target.opening is not None else [])]


def flight_times(problem: ThrowProblem) -> tuple[float, ...]:
    """Returns the flight times to try, relative to that of the slowest throw [-]."""
    return FLIGHT_TIMES + STEEP_TIMES if has_flight_obstacles(problem) else FLIGHT_TIMES


def clear_flights(problem: ThrowProblem, target: Target, p: Array, v: Array) -> Mask:
    """Returns the mask (...,) of the drag-free flights that meet no keep-out shape, nor the target's bin, nor the base.

    Args:
        problem: its cell.
        target: of the throw.
        p: release positions (..., 3) [m].
        v: release velocities (..., 3) [m/s].
    """
    return np.asarray(least_room(problem, target, p, v) >= -CONTACT_M)


def _rooms(problem: ThrowProblem, target: Target, p: Array, v: Array) -> Iterator[tuple[str, Array]]:
    """Yields what a flight may meet, and the room (...,) [m] beyond the flight clearance; negative where it lacks.

    Infinite beside a shape whose bounding box no part of the flight comes near to; most shapes are far from most.
    """
    around = problem.cell.surroundings
    beside_base = _lands_beside_base(problem, target)
    if not beside_base and not has_flight_obstacles(problem):
        return
    p = np.broadcast_to(p, v.shape)
    arcs = Arcs.onto(p, v, problem.plane_z, problem.gravity_at_tool_speed, problem.cell.object.inner_radius_m)
    whole = arcs.until_landed(problem.plane_z, problem.surfaces)
    required, _ = problem.flight_clearances
    lowest, highest = _bounds(problem, target, arcs, whole)
    for name, shape, gap_m in zip(around.keep_out_names, around.keep_out, required.tolist(), strict=True):
        near = _comes_near(shape, lowest, highest, arcs.radius_m + gap_m + FLIGHT_GAP_M + CONTACT_M)
        if near.any():
            room = np.full(near.shape, np.inf)
            room[near] = _room_beside(problem, target, shape, gap_m, arcs.of(near), whole.of(near))
            yield name, room
    if target.opening is not None:
        mouth = target.opening
        beside = arcs if problem.moving is None else arcs.beside(problem.moving.v_W, problem.plane_z)
        yield RIM, beside.room_in_mouth(target.p_W, mouth.radius_m, mouth.rim_height_m)
    if beside_base:
        yield "the arm's base", _room_beside_base(problem, whole)


def _bounds(problem: ThrowProblem, target: Target, arcs: Arcs, whole: Arcs) -> tuple[Array, Array]:
    """Returns corners (3, ...) [m] of boxes about flights, and about where the object lies down and to which it rolls.

    The upper corner's height is not that of the apex.
    """
    places = [arcs.p, arcs.at(np.maximum(arcs.until_s, whole.until_s))]
    if problem.lies_z is not None:
        touched = whole.at(whole.until_s) - problem.aim_shift
        touched[..., 2] = problem.lies_z
        places += [touched, np.broadcast_to(target.p_W - problem.aim_shift, touched.shape)]
    every = np.moveaxis(np.array(places), -1, 0)
    return every.min(axis=1), every.max(axis=1)


def _comes_near(shape: Solid, lowest: Array, highest: Array, reach_m: float) -> Mask:
    """Returns which boxes (3, ...) come within a reach [m] of the box about a shape, from beside it or from above."""
    near = lowest[2] < shape.upper[2] + reach_m
    for axis in (0, 1):
        near &= (lowest[axis] < shape.upper[axis] + reach_m) & (highest[axis] > shape.lower[axis] - reach_m)
    return np.asarray(near)


def _room_beside(problem: ThrowProblem, target: Target, shape: Solid, gap_m: float, arcs: Arcs, whole: Arcs) -> Array:
    """Returns the room (n,) [m] beyond `gap_m` between a shape and flights, until these touch the plane and end."""
    ground_z = problem.cell.surroundings.floor_z_m
    if shape.upper[2] <= problem.plane_z + CONTACT_M:
        room = arcs.room_beside_shape(shape, gap_m, ground_z)
        room = np.minimum(room, _room_beside_lower_shape(shape, arcs, whole) - gap_m)
    else:
        wider_m = gap_m + _spare_gap(problem, target, shape, gap_m)
        room = arcs.room_beside_shape(shape, wider_m, ground_z)
        room = np.minimum(room, whole.room_beside_shape(shape, gap_m, ground_z))
    return np.minimum(room, _room_lying(problem, target, shape, whole) - gap_m)


def _spare_gap(problem: ThrowProblem, target: Target, shape: Solid, gap_m: float) -> float:
    """Returns the room [m] that flights keep from a shape beyond `gap_m`: no more than there is at the target."""
    centre = target.p_W + np.array([0.0, 0.0, problem.landing_radius_m])
    there = float(segment_shape_distance(centre, centre, shape)) - problem.cell.object.inner_radius_m
    return min(max(there - gap_m - CONTACT_M, 0.0), FLIGHT_GAP_M)


def _room_beside_lower_shape(shape: Solid, arcs: Arcs, whole: Arcs) -> Array:
    """Returns the room (...,) [m] between a shape that ends at the plane or below it and the ends of flights.

    Args:
        shape: on which the object may land.
        arcs: the flights until the sphere touches the plane.
        whole: the same until they end.
    """
    shares = INSTANTS.reshape(-1, *[1] * whole.until_s.ndim)
    x = whole.at(arcs.until_s + shares * np.maximum(whole.until_s - arcs.until_s, 0.0))
    room = segment_shape_distance(x, x, shape).min(axis=0) - arcs.radius_m
    return np.where(whole.until_s > arcs.until_s, room, np.inf)


def _room_lying(problem: ThrowProblem, target: Target, shape: Solid, whole: Arcs) -> Array:
    """Returns the room (...,) [m] beside a shape of an object that lies, from where flights end to the target.

    Infinite for a target in the air or in a bin, and beside a shape no higher than what the object lies on.
    """
    room = np.full(whole.until_s.shape, np.inf)
    radius = whole.radius_m
    if problem.lies_z is None or not problem.is_met_lying(shape.upper[2]):
        return room
    touched = whole.at(whole.until_s) - problem.aim_shift
    rests = target.p_W - problem.aim_shift
    touched[..., 2] = rests[2] = problem.lies_z
    lower = np.minimum(touched, rests) - radius
    upper = np.maximum(touched, rests) + radius
    near = ((lower < shape.upper) & (upper > shape.lower)).all(axis=-1)
    room[near] = segment_shape_distance(touched[near], rests, shape) - radius
    return room


def least_room(problem: ThrowProblem, target: Target, p: Array, v: Array) -> Array:
    """Returns the room (...,) [m] that flights leave what they come closest to; infinite without any such thing."""
    least = np.full(v.shape[:-1], np.inf)
    for _, room in _rooms(problem, target, p, v):
        least = np.minimum(least, room)
    return least


def no_clear_flight(problem: ThrowProblem, target: Target, p: Array, v: Array, tried: int) -> Violation:
    """Returns the violation by the best of flights that all meet something: the one that lacks the least room.

    Args:
        problem: its cell.
        target: of the throw.
        p: release positions (n, 3) [m].
        v: release velocities (n, 3) [m/s].
        tried: flights that were tried.
    """
    beside_base = gap_to_base(problem, target.p_W)
    if beside_base < 0.0:
        detail = "the arm's base, from an object at the target"
        return Violation("flight_clearance", beside_base, 0.0, "m", detail=detail)
    rooms = dict(_rooms(problem, target, p, v))
    best = int(np.min(list(rooms.values()), axis=0).argmax())
    name = min(rooms, key=lambda each: float(rooms[each][best]))
    others = [each for each, room in rooms.items() if each != name and (room < 0.0).any()]
    detail = f"{name}: the best of {tried} flights tried comes so close to it"
    detail += f"; others meet {', '.join(others)}" if others else ""
    of_shapes, of_base = problem.flight_clearances
    limits = dict(zip(problem.cell.surroundings.keep_out_names, of_shapes.tolist(), strict=True))
    limit = limits.get(name, 0.0 if name == RIM else float(of_base.max()))
    return Violation("flight_clearance", limit + float(rooms[name][best]), limit, "m", detail=detail)


def _lands_beside_base(problem: ThrowProblem, target: Target) -> bool:
    """Returns whether a target is so near to the arm's base that flights to it may end there."""
    return gap_to_base(problem, target.p_W) < BESIDE_BASE_M


def gap_to_base(problem: ThrowProblem, p: Array) -> float:
    """Returns the distance [m] of the object at a place (3,) from what the base carries, negative within it."""
    return float(_gaps_to_base(problem, p).min()) - problem.cell.object.inner_radius_m


def _room_beside_base(problem: ThrowProblem, arcs: Arcs) -> Array:
    """Returns the room (...,) [m] between the last part of flights and the shapes that the base carries."""
    x = arcs.at((2.0 + INSTANTS.reshape(-1, *[1] * arcs.until_s.ndim)) / 3.0 * arcs.until_s)
    _, required = problem.flight_clearances
    gaps = _gaps_to_base(problem, x) - required.reshape(-1, *[1] * (x.ndim - 1))
    return gaps.min(axis=(0, 1)) - problem.cell.object.inner_radius_m


def _gaps_to_base(problem: ThrowProblem, x: Array) -> Array:
    """Returns the distances (k, ...) of points (..., 3) from the k shapes that the base carries."""
    shapes = zip(*body_model(problem.cell).base_shapes, strict=True)
    return np.stack([point_segment_distance(x, start, end) - radius for start, end, radius in shapes])
