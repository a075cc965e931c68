"""Symbolic clearance formulas: distances between capsules, floor and shapes, each kind folded into one smooth row.

The minimum of many distances has kinks; -w log sum exp(-d / w) has none and is never larger than the minimum, so a
bound on it bounds them all. The closest points of two segments move with the arm, but the distance depends on that
movement in second order only. Of two links they are frozen while the derivatives are taken; beside a flight and a
shape, where that keeps solves from converging, their movement is part of the derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca

from planner.backends.casadi_nlp.layout import CAPSULE_FRAMES, PAIRS, SHAPE
from planner.backends.casadi_nlp.symbols.arm import ArmFrames
from planner.backends.casadi_nlp.symbols.terms import Terms

SX = Any

WIDTH = 0.002  # [m] width of the soft minimum: for two equal distances it is 1.4 mm smaller
PROJECTIONS = 2
NEWTON_STEPS = 2  # [-] for the point of a segment nearest to a shape: within 0.1 mm
STIFF = 1e-6  # [m^2] keeps the closest points of parallel segments from moving without bound
TINY = 1e-9  # [m^2] keeps the length of a segment and a distance away from zero


@dataclass(frozen=True)
class CapsuleSlots:
    """End points (3,) of every capsule slot in S [m], and radii [m]."""

    starts: list[SX]
    ends: list[SX]
    radii: list[SX]


def capsules_in_s(arm: ArmFrames, capsules: SX) -> CapsuleSlots:
    """Returns the capsules in S. `capsules` holds seven numbers for each slot of `CAPSULE_FRAMES`."""
    rows = [capsules[7 * i : 7 * i + 7] for i in range(len(CAPSULE_FRAMES))]
    slots = list(zip(CAPSULE_FRAMES, rows, strict=True))
    return CapsuleSlots(
        [arm.point(frame, row[:3]) for frame, row in slots],
        [arm.point(frame, row[3:6]) for frame, row in slots],
        [row[6] for row in rows],
    )


def capsules_in_world(body: CapsuleSlots, R_WS: SX, p_WS: SX) -> CapsuleSlots:
    """Returns capsules in S as capsules in the world, for the pose of S."""
    starts, ends = ([R_WS @ point + p_WS for point in points] for points in (body.starts, body.ends))
    return CapsuleSlots(starts, ends, body.radii)


def self_distance(body: CapsuleSlots, added: SX, terms: Terms) -> SX:
    """Returns the soft minimum of the distances [m] between the surfaces of `PAIRS`, each increased by its `added`."""
    gaps = [
        segment_distance_at_fixed_points(body.starts[i], body.ends[i], body.starts[j], body.ends[j], terms)
        - body.radii[i]
        - body.radii[j]
        + added[k]
        for k, (i, j) in enumerate(PAIRS)
    ]
    return soft_minimum(gaps, terms)


def segment_distance_at_fixed_points(p1: SX, p2: SX, q1: SX, q2: SX, terms: Terms) -> SX:
    """Returns the distance [m] between two segments, whose closest points are constant while derivatives are taken.

    source: Ericson, Real-Time Collision Detection, 5.1.9.
    """
    u = p2 - p1
    v = q2 - q1
    s, t = (terms.freeze(share) for share in _closest(p1, u, q1, v))
    return _length(p1 - q1 + s * u - t * v)


def segment_distance_at_moving_points(p1: SX, p2: SX, q1: SX, q2: SX, terms: Terms) -> SX:
    """Returns the same distance [m] with exact second derivatives: its closest points move."""
    u = p2 - p1
    v = q2 - q1
    s, t = (terms.freeze(share) for share in _closest(p1, u, q1, v))
    gap = p1 - q1 + s * u - t * v
    ds, dt = _moved(gap, u, v, s, t, terms)
    return _length(gap + ds * u - dt * v)


def chords_distance(p1: SX, p2: SX, points: list[SX], terms: Terms) -> SX:
    """Returns the soft minimum of a segment's distances [m] from the chords between `points`.

    Its first derivatives are exact. The second ones have the links' movement alone: not how directions turn, closest
    points move and the soft minimum changes from chord to chord.
    """
    apart = []
    lengths = []
    for q1, q2 in pairwise(points):
        u = p2 - p1
        v = q2 - q1
        s, t = (terms.freeze(share) for share in _closest(p1, u, q1, v))
        apart.append(p1 - q1 + s * u - t * v)
        lengths.append(_length(apart[-1]))
    row = ca.vertcat(*lengths)
    nearness = ca.exp((ca.mmin(row) - row) / WIDTH)
    least = ca.mmin(row) - WIDTH * ca.log(ca.sum1(nearness))
    pull = terms.freeze(ca.horzcat(*apart) @ ca.diag(nearness / ca.sum1(nearness) / row))
    moved = sum(ca.dot(pull[:, i], gap) for i, gap in enumerate(apart))
    return terms.freeze(least - moved) + moved


def _closest(p: SX, u: SX, q: SX, v: SX) -> tuple[SX, SX]:
    """Returns the shares [-] of u and v at which the segments from p along u and from q along v are closest."""
    w = p - q
    a = ca.dot(u, u) + TINY
    b = ca.dot(u, v)
    e = ca.dot(v, v) + TINY
    c = ca.dot(u, w)
    f = ca.dot(v, w)
    s = _unit((b * f - c * e) / (a * e - b * b + TINY))
    t = _unit((b * s + f) / e)
    return _unit((b * t - c) / a), t


def _moved(gap: SX, u: SX, v: SX, s: SX, t: SX, terms: Terms) -> tuple[SX, SX]:
    """Returns what the closest points' shares lack, with its derivatives: a step of Newton's iteration for them.

    It is 0 and 0 up to rounding. By the implicit function theorem its derivatives are those of the shares.
    """
    s_moves = terms.freeze(_is_within(s))
    t_moves = terms.freeze(_is_within(t))
    a = ca.dot(u, u) + STIFF
    b = ca.dot(u, v) * s_moves * t_moves
    e = ca.dot(v, v) + STIFF
    det = a * e - b * b
    along_u = ca.dot(u, gap)
    along_v = -ca.dot(v, gap)
    return -s_moves * (e * along_u + b * along_v) / det, -t_moves * (b * along_u + a * along_v) / det


def _length(vector: SX) -> SX:
    return ca.sqrt(ca.dot(vector, vector) + TINY)


def _is_within(share: SX) -> SX:
    """Returns 1 where a point is within its segment and moves along it, 0 where it is an end."""
    return (share > 0) * (share < 1)


def _unit(x: SX) -> SX:
    return ca.fmax(0, ca.fmin(1, x))


def lowest_heights(body: CapsuleSlots, up_S: SX, base_height: SX, first: int) -> list[SX]:
    """Returns the heights in the world [m] of the lowest points of the capsules from slot `first` on.

    Args:
        body: the capsules.
        up_S: the world's upward direction in S (3,).
        base_height: height of the base's origin [m].
        first: the first slot that can move.
    """
    return [
        ca.dot(up_S, end) + base_height - body.radii[i]
        for i in range(first, len(CAPSULE_FRAMES))
        for end in (body.starts[i], body.ends[i])
    ]


def shape_distances(in_s: CapsuleSlots, R_WS: SX, p_WS: SX, slots: SX, terms: Terms) -> list[SX]:
    """Returns a lower bound on the distance [m] of each capsule from each shape, capsule 0 (the base) excepted.

    Args:
        in_s: the capsules in S.
        R_WS, p_WS: pose of S in the world.
        slots: `layout.SHAPE` of each shape, in one vector.
        terms: collects the terms that derivatives take as constants.
    """
    gaps = []
    for k in range(slots.size1() // SHAPE.size):
        shape = SHAPE.split(slots[SHAPE.size * k : SHAPE.size * (k + 1)])
        R_CW = ca.reshape(shape["rotation"], 3, 3)
        body = capsules_in_world(in_s, R_CW @ R_WS, R_CW @ (p_WS - shape["origin"]))
        for i in range(1, len(CAPSULE_FRAMES)):
            point = _nearest(body.starts[i], body.ends[i], shape, terms)
            gaps.append(_beyond_faces(point, shape, terms) - body.radii[i] - shape["further"] + shape["added"][i])
    return gaps


def depths(point: SX, slots: SX, terms: Terms) -> list[SX]:
    """Returns a lower bound on the depth [m] of a point of the world (3,) in each shape, less its clearance.

    Args:
        point: the point.
        slots: `layout.SHAPE` of each shape, in one vector.
        terms: collects the terms that derivatives take as constants.
    """
    shapes = (SHAPE.split(slots[first : first + SHAPE.size]) for first in range(0, slots.size1(), SHAPE.size))
    return [
        -_beyond_faces(ca.reshape(shape["rotation"], 3, 3) @ (point - shape["origin"]), shape, terms) - shape["further"]
        for shape in shapes
    ]


def _nearest(start: SX, end: SX, shape: dict[str, SX], terms: Terms) -> SX:
    """Returns the point of a segment nearest to a shape's core.

    By alternating projections (source: von Neumann 1950), which are slow where a segment is nearly parallel to a face,
    and steps of Newton's iteration from there. One more step, whose value is 0, has the derivatives of its movement.
    """
    along = end - start
    square = ca.dot(along, along) + TINY
    s = ca.SX(0.5)
    for _ in range(PROJECTIONS):
        s = _unit(ca.dot(_projection(start + s * along, shape) - start, along) / square)
    for _ in range(NEWTON_STEPS):
        point = start + s * along
        s = _unit(s - _excess(point, along, _sides(point, shape), shape))
    s = terms.freeze(s)
    point = start + s * along
    sides = Sides(*(terms.freeze(side) for side in _sides(point, shape)))
    return point - terms.freeze(_is_within(s)) * _excess(point, along, sides, shape) * along


def _projection(point: SX, shape: dict[str, SX]) -> SX:
    """Returns the point of a core nearest to a point (3,)."""
    in_box = ca.fmax(shape["lower"], ca.fmin(shape["upper"], point))
    inwards = ca.fmin(1, shape["upper"][0] / _from_axis(point))
    return in_box + shape["is_round"] * ca.vertcat(inwards * point[:2] - in_box[:2], 0)


class Sides(NamedTuple):
    """On which sides of a core a point is, as 1 or 0: of each face of its box (3,), and of a cylinder's wall."""

    below: SX
    above: SX
    off_wall: SX


def _sides(point: SX, shape: dict[str, SX]) -> Sides:
    flat = 1 - shape["is_round"] * ca.DM([1, 1, 0])
    off_wall = shape["is_round"] * (shape["upper"][0] < _from_axis(point))
    return Sides(flat * (point < shape["lower"]), flat * (shape["upper"] < point), off_wall)


def _excess(point: SX, along: SX, sides: Sides, shape: dict[str, SX]) -> SX:
    """Returns the share of `along` by which a point on it is beyond the one nearest to a core [-]."""
    apart = sides.below * (point - shape["lower"]) + sides.above * (point - shape["upper"])
    # beside a cylinder's wall: how far `along` goes away from it, and how that changes along the segment
    inwards = shape["upper"][0] / _from_axis(point)
    across = ca.dot(point[:2], along[:2])
    away = sides.off_wall * (1 - inwards) * across
    change = sides.off_wall * ((1 - inwards) * ca.sumsqr(along[:2]) + inwards * (across / _from_axis(point)) ** 2)
    faces = ca.dot(along * (sides.below + sides.above), along)
    return (ca.dot(along, apart) + away) / (faces + change + STIFF)


def _from_axis(point: SX) -> SX:
    """Returns a point's distance from the z axis [m]."""
    return ca.sqrt(ca.sumsqr(point[:2]) + TINY)


def _beyond_faces(point: SX, shape: dict[str, SX], terms: Terms) -> SX:
    """Returns the soft maximum of a point's distances [m] beyond the planes of a shape's faces, off its round part."""
    below, above = (terms.freeze(side) for side in (point[2] < -shape["reach"], shape["reach"] < point[2]))
    z = below * (point[2] + shape["reach"]) + above * (point[2] - shape["reach"])
    within = shape["radius"] - ca.sqrt(ca.sumsqr(point[:2]) + z**2 + TINY)
    inside = ca.vertcat(point - shape["lower_faces"], shape["upper_faces"] - point, within)
    return -soft_minimum(ca.vertsplit(inside), terms)


def soft_minimum(distances: list[SX], terms: Terms) -> SX:
    """Returns -w log sum exp(-d / w) [m] for w = `WIDTH`."""
    row = ca.vertcat(*distances)
    least = terms.freeze(ca.mmin(row))
    return least - WIDTH * ca.log(ca.sum1(ca.exp((least - row) / WIDTH)))
