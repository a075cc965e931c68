"""Symbolic clearance formulas: distances between capsules, floor and boxes, each kind folded into one smooth row.

The minimum of many distances has kinks; -w log sum exp(-d / w) has none and is never larger than the minimum, so a
bound on it bounds them all. The closest points of two segments move with the arm, but the distance depends on that
movement in second order only. Of two links they are frozen while the derivatives are taken; beside a flight and a box,
where that keeps solves from converging, their movement is part of the derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca

from planner.backends.casadi_nlp.layout import CAPSULE_FRAMES, PAIRS
from planner.backends.casadi_nlp.symbols.arm import ArmFrames
from planner.backends.casadi_nlp.symbols.terms import Terms

SX = Any

WIDTH = 0.002  # [m] width of the soft minimum: for two equal distances it is 1.4 mm smaller
PROJECTIONS = 2
NEWTON_STEPS = 2  # [-] for the point of a segment nearest to a box: within 0.1 mm
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


def box_distances(body: CapsuleSlots, boxes: SX, terms: Terms) -> list[SX]:
    """Returns a lower bound on the distance [m] of each capsule from each box, capsule 0 (the base) excepted.

    Args:
        body: the capsules, in the frame of the boxes.
        boxes: lower (3) and upper (3) corner of each, in one vector.
        terms: collects the terms that derivatives take as constants.
    """
    corners = [(boxes[6 * k : 6 * k + 3], boxes[6 * k + 3 : 6 * k + 6]) for k in range(boxes.size1() // 6)]
    return [
        _beyond_faces(_nearest(body.starts[i], body.ends[i], *box, terms), *box, terms) - body.radii[i]
        for box in corners
        for i in range(1, len(CAPSULE_FRAMES))
    ]


def _nearest(start: SX, end: SX, lower: SX, upper: SX, terms: Terms) -> SX:
    """Returns the point of a segment nearest to a box.

    By alternating projections (source: von Neumann 1950), which are slow where a segment is nearly parallel to a face,
    and steps of Newton's iteration from there. One more step, whose value is 0, has the derivatives of its movement.
    """
    along = end - start
    square = ca.dot(along, along) + TINY
    s = ca.SX(0.5)
    for _ in range(PROJECTIONS):
        inside = ca.fmax(lower, ca.fmin(upper, start + s * along))
        s = _unit(ca.dot(inside - start, along) / square)
    for _ in range(NEWTON_STEPS):
        point = start + s * along
        s = _unit(s - _excess(point, along, *_sides(point, lower, upper), lower, upper))
    s = terms.freeze(s)
    point = start + s * along
    below, above = (terms.freeze(side) for side in _sides(point, lower, upper))
    return point - terms.freeze(_is_within(s)) * _excess(point, along, below, above, lower, upper) * along


def _sides(point: SX, lower: SX, upper: SX) -> tuple[SX, SX]:
    """Returns in which coordinates a point is below and above a box (3,), as 1 or 0."""
    return point < lower, upper < point


def _excess(point: SX, along: SX, below: SX, above: SX, lower: SX, upper: SX) -> SX:
    """Returns the share of `along` by which a point on it is beyond the one nearest to a box [-]."""
    apart = below * (point - lower) + above * (point - upper)
    return ca.dot(along, apart) / (ca.dot(along * (below + above), along) + STIFF)


def _beyond_faces(point: SX, lower: SX, upper: SX, terms: Terms) -> SX:
    """Returns the soft maximum of a point's distances [m] beyond the planes of a box's faces."""
    return -soft_minimum(ca.vertsplit(ca.vertcat(point - lower, upper - point)), terms)


def soft_minimum(distances: list[SX], terms: Terms) -> SX:
    """Returns -w log sum exp(-d / w) [m] for w = `WIDTH`."""
    row = ca.vertcat(*distances)
    least = terms.freeze(ca.mmin(row))
    return least - WIDTH * ca.log(ca.sum1(ca.exp((least - row) / WIDTH)))
