"""Distances of the arm and its tool in symbols, many of them folded into one smooth row.

The least of many distances has kinks; -w log sum exp(-d / w) does not, and is never larger than the least distance, so
that holding it holds them all. The closest points of two segments move with the arm, but to first order the distance
does not feel it: they are `held` while the derivatives are taken.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from planner.backends.casadi_nlp.arm import Frames
from planner.backends.casadi_nlp.layout import CAPSULE_FRAMES, KEEP_OUT, PAIRS

SX = Any

WIDTH = 0.002  # [m] of the soft minimum: two equal distances count 1.4 mm less
PROJECTIONS = 4  # between segment and box; the nearest point need only be near: its error counts in second order
TINY = 1e-9  # [m^2] keeps the length of a segment and a distance away from zero


@dataclass
class Held:
    """Quantities that derivatives take as constants: symbols, and the expressions they stand for."""

    symbols: list[SX] = field(default_factory=list)
    values: list[SX] = field(default_factory=list)

    def hold(self, value: SX) -> SX:
        """Returns a symbol for `value`."""
        symbol = ca.SX.sym(f"held{len(self.symbols)}", *value.shape)
        self.symbols.append(symbol)
        self.values.append(value)
        return symbol


@dataclass(frozen=True)
class Capsules:
    """Ends (3,) of every capsule slot in S [m], and radii [m]."""

    starts: list[SX]
    ends: list[SX]
    radii: list[SX]


def capsules_in_s(arm: Frames, capsules: SX) -> Capsules:
    """Returns where the capsules stand. `capsules` holds seven numbers a slot of `CAPSULE_FRAMES`."""
    rows = [capsules[7 * i : 7 * i + 7] for i in range(len(CAPSULE_FRAMES))]
    places = list(zip(CAPSULE_FRAMES, rows, strict=True))
    return Capsules(
        [arm.point(frame, row[:3]) for frame, row in places],
        [arm.point(frame, row[3:6]) for frame, row in places],
        [row[6] for row in rows],
    )


def self_distance(body: Capsules, added: SX, held: Held) -> SX:
    """Returns the soft least distance [m] between the surfaces of `PAIRS`, each with its number of `added`."""
    gaps = [
        segment_distance(body.starts[i], body.ends[i], body.starts[j], body.ends[j], held)
        - body.radii[i]
        - body.radii[j]
        + added[k]
        for k, (i, j) in enumerate(PAIRS)
    ]
    return soft_minimum(gaps, held)


def segment_distance(p1: SX, p2: SX, q1: SX, q2: SX, held: Held) -> SX:
    """Returns the distance [m] of two segments. source: Ericson, Real-Time Collision Detection, 5.1.9."""
    u, v, w = p2 - p1, q2 - q1, p1 - q1
    a, b, e = ca.dot(u, u) + TINY, ca.dot(u, v), ca.dot(v, v) + TINY
    c, f = ca.dot(u, w), ca.dot(v, w)
    s = _unit((b * f - c * e) / (a * e - b * b + TINY))
    t = _unit((b * s + f) / e)
    s, t = held.hold(_unit((b * t - c) / a)), held.hold(t)
    gap = w + s * u - t * v
    return ca.sqrt(ca.dot(gap, gap) + TINY)


def _unit(x: SX) -> SX:
    return ca.fmax(0, ca.fmin(1, x))


def lowest_heights(body: Capsules, up_S: SX, base_height: SX, first: int) -> list[SX]:
    """Returns the heights in the world [m] of the lowest points of the capsules from slot `first` on.

    Args:
        body: the capsules.
        up_S: the world's upward direction in S (3,).
        base_height: height of the base's origin [m].
        first: slots before it cannot move.
    """
    return [
        ca.dot(up_S, end) + base_height - body.radii[i]
        for i in range(first, len(CAPSULE_FRAMES))
        for end in (body.starts[i], body.ends[i])
    ]


def box_distances(body: Capsules, boxes: SX, held: Held) -> list[SX]:
    """Returns how far each capsule that can reach a box stays outside of it [m]: no more than the true distance.

    Args:
        body: the capsules, in the frame of the boxes.
        boxes: lower (3) and upper (3) corner of each.
        held: what derivatives take as constant.
    """
    corners = [(boxes[6 * k : 6 * k + 3], boxes[6 * k + 3 : 6 * k + 6]) for k in range(KEEP_OUT)]
    return [
        _beyond_faces(_nearest(body.starts[i], body.ends[i], *box, held), *box, held) - body.radii[i]
        for box in corners
        for i in range(1, len(CAPSULE_FRAMES))
    ]


def _nearest(start: SX, end: SX, lower: SX, upper: SX, held: Held) -> SX:
    """Returns the point of a segment nearest to a box, by projecting to and fro. source: von Neumann 1950."""
    along = end - start
    square = ca.dot(along, along) + TINY
    s = ca.SX(0.5)
    for _ in range(PROJECTIONS):
        inside = ca.fmax(lower, ca.fmin(upper, start + s * along))
        s = _unit(ca.dot(inside - start, along) / square)
    return start + held.hold(s) * along


def _beyond_faces(point: SX, lower: SX, upper: SX, held: Held) -> SX:
    """Returns the soft largest distance [m] of a point beyond the planes of a box's faces."""
    return -soft_minimum(ca.vertsplit(ca.vertcat(point - lower, upper - point)), held)


def soft_minimum(distances: list[SX], held: Held) -> SX:
    """Returns -w log sum exp(-d / w) [m] for w = `WIDTH`."""
    row = ca.vertcat(*distances)
    least = held.hold(ca.mmin(row))
    return least - WIDTH * ca.log(ca.sum1(ca.exp((least - row) / WIDTH)))
