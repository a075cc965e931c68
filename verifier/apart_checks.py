"""Checks of several objects together: no two grippers open at once, and in the air the objects keep apart.

Two flights are compared at one instant, for every pair of releases within their spreads. Of releases r within a piece,
of middle m, the place at a time t is x(s) + x'(s) (t - r - s) with s = t - m, and off that by no more than what the
object accelerates, times the square of t - r - s, half. A ball whose release is still to come is followed backwards at
even acceleration. Both fall alike: what bends the one against the other is the air alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np

from verifier.clearance_checks import LENGTH_M
from verifier.drag import releases_of
from verifier.elementary import ROUNDING, Array, Index, Mask
from verifier.finding import Finding, Status, judged, not_covered
from verifier.flight_checks import LOW_M
from verifier.flights import OutsideMotion, Releases, prove_patches, release_pieces
from verifier.landing_place import LandingPlace, landing_place
from verifier.motion_parts import MotionPart
from verifier.solids import lengths_up, shortened, toward
from verifier.taylor import TaylorModel, dot

RELEASES, FLIGHTS = "releases_apart", "flights_apart"
TICK = 1e-6  # [-] of a tick, 2 ns: what is off by less is on it
# [ticks] at which two commands are in ticks of their own: each is on the nearest to its time.
COMMANDS_APART = 1.0 + TICK
STEP_S = 0.032  # [s] of the first patches: two balls that fall alike move evenly against each other


def apart_findings(parts: Sequence[MotionPart]) -> Iterator[Finding]:
    """Returns the findings about several objects that leave; none of one."""
    thrown = sorted((part for part in parts if part.demands.throws), key=_released_at)
    yield from (_in_turn(one, other) for one, other in pairwise(thrown))
    for one, other in combinations(thrown, 2):
        yield _told_apart(one, other)
        turn = _in_turn(one, other)
        if turn.status is Status.PROVEN:
            yield _flown_apart(one, other)
        else:  # pairs of releases are as many as both spreads are long, and the plan is none already
            yield Finding(FLIGHTS, Status.NOT_PROVEN, turn.at_s, f"{_names(one, other)}: may be let go in any order")


def _released_at(part: MotionPart) -> int:
    assert part.motion.release is not None
    return part.motion.release


def _names(one: MotionPart, other: MotionPart) -> str:
    return f"{one.demands.passage} and {other.demands.passage}"


def _in_turn(one: MotionPart, other: MotionPart) -> Finding:
    """Returns whether a gripper may open only once the one before it has, however early or late both are."""
    rate_hz = one.motion.rate_hz
    ticks = _released_at(other) - _released_at(one)
    room = ticks - (one.demands.spread_s + other.demands.spread_s) * rate_hz + TICK
    return judged(RELEASES, room, room, _released_at(other) / rate_hz, f"{_names(one, other)}: ticks between")


def _told_apart(one: MotionPart, other: MotionPart) -> Finding:
    """Returns whether two grippers are told to open in ticks of their own."""
    rate_hz = one.motion.rate_hz
    sooner, later = (_released_at(part) - part.cell.gripper.delay_s * rate_hz for part in (one, other))
    room = abs(later - sooner) - COMMANDS_APART
    return judged(RELEASES, room, room, _released_at(other) / rate_hz, f"{_names(one, other)}: ticks between commands")


@dataclass(frozen=True, eq=False)
class FlyingBall:
    """A ball that leaves within a spread, and what it lands on.

    Attributes:
        releases: it may leave at.
        place: it lands on.
        radius_m: of the ball [m].
        lasts_s: time of the motion by which it has landed [s].
    """

    releases: Releases
    place: LandingPlace
    radius_m: float
    lasts_s: float

    def begins(self, rows: Index) -> Array:
        """Returns the begins (m,) of pieces of its releases [s]."""
        pieces = self.releases.pieces
        return (pieces.tick[rows] + pieces.begin[rows]) / pieces.motion.rate_hz

    def at(self, rows: Index, t: Array) -> tuple[TaylorModel, TaylorModel]:
        """Returns places and velocities (3, m) [m, m/s] at times (m,) of the motion [s], by the release in its piece.

        Where that is no flight yet, the place is one of the flight backwards; the velocity is that at the release.
        """
        released = self.releases.pieces.times[rows]
        s = np.maximum(t - released.c0, 0.0)
        x, w = self.releases.states_at(rows, s)
        later = (-released + t) - s
        most = later.size
        bends = 0.5 * self.releases.bending * most * most * (1.0 + 8.0 * ROUNDING)
        return (x + w * later).widened(bends), w

    @property
    def air_m_s2(self) -> float:
        """Bound on its acceleration beyond that of a free fall [m/s^2]."""
        return self.releases.bending - self.releases.cell.surroundings.gravity_m_s2

    def flies(self, rows: Index, t: Array, x: TaylorModel) -> Mask:
        """Returns where (m,) it surely flies at times (m,) after the middle release of its piece."""
        released = self.releases.pieces.times[rows]
        return (t >= released.c0 + released.r) & (x[2].c0 - x[2].r > self.place.ends_z)

    def may_fly(self, rows: Index, t: Array, x: TaylorModel, w: TaylorModel) -> Mask:
        """Returns where (m,) it may not have landed at times (m,): a ball that is falling and lower has, after all."""
        released = self.releases.pieces.times[rows]
        s = np.maximum(t - released.c0, 0.0)
        falls = w[2].upper + self.releases.bending * (t - s - released).size < 0.0
        return ~(falls & (x[2].upper < self.place.ends_z) & (t > released.upper))


@dataclass(frozen=True, eq=False)
class FlightPairs:
    """m patches of two flights: some releases of both, from one time of the motion to another.

    Attributes:
        one, other: the balls.
        rows, others: piece of the releases of each (m,).
        t0, t1: times of the motion [s] (m,).
    """

    one: FlyingBall
    other: FlyingBall
    rows: Index
    others: Index
    t0: Array
    t1: Array

    @property
    def middle_s(self) -> Array:
        """Times (m,) in the motion of the middles [s]."""
        return 0.5 * (self.t0 + self.t1)

    def chosen(self, which: Mask) -> FlightPairs:
        """Returns some of the patches."""
        rows, others = self.rows[which], self.others[which]
        return FlightPairs(self.one, self.other, rows, others, self.t0[which], self.t1[which])

    def halves(self, of_releases: bool) -> FlightPairs:
        """Returns both halves of every patch in time, and of both its releases too."""
        middle = self.middle_s
        rows, others = np.tile(self.rows, 2), np.tile(self.others, 2)
        t0, t1 = np.concatenate([self.t0, middle]), np.concatenate([middle, self.t1])
        if not of_releases:
            return FlightPairs(self.one, self.other, rows, others, t0, t1)
        one, rows = _halved(self.one, rows)
        other, others = _halved(self.other, np.tile(others, 2))
        return FlightPairs(one, other, np.tile(rows, 2), others, np.tile(t0, 4), np.tile(t1, 4))


def _halved(ball: FlyingBall, rows: Index) -> tuple[FlyingBall, Index]:
    """Returns a ball whose pieces of releases are the halves of some (m,), and which these are (2 m,)."""
    used, where = np.unique(rows, return_inverse=True)
    releases = ball.releases.of(ball.releases.pieces.chosen(used).halves())
    return replace(ball, releases=releases), np.concatenate([where, where + len(used)])


def _flown_apart(one: MotionPart, other: MotionPart) -> Finding:
    """Returns whether two objects in the air keep the flight clearance, until one of them has landed."""
    try:
        balls = [_flying(part) for part in (one, other)]
    except OutsideMotion as error:
        return not_covered(FLIGHTS, str(error))
    first, second = balls
    until_s = min(first.lasts_s, second.lasts_s)
    names = _names(one, other)
    if not np.isfinite(until_s):
        return Finding(FLIGHTS, Status.NOT_PROVEN, None, f"{names}: one of them may never land")
    pieces = (np.arange(len(ball.releases.pieces.tick)) for ball in balls)
    rows, others = (x.ravel() for x in np.meshgrid(*pieces, indexing="ij"))
    begins = np.maximum(first.begins(rows), second.begins(others))
    count = max(int(np.ceil((until_s - float(begins.min())) / STEP_S)), 1)
    steps = np.float64(STEP_S) * np.arange(count, dtype=np.float64)
    t0 = (begins[:, None] + steps).ravel()
    patches = FlightPairs(first, second, np.repeat(rows, len(steps)), np.repeat(others, len(steps)), t0, t0 + STEP_S)
    clearance_m = one.cell.surroundings.flight_clearance_m
    return prove_patches(FLIGHTS, patches, lambda each: _rooms(each, clearance_m), [names])


def _flying(part: MotionPart) -> FlyingBall:
    """Returns the object that leaves in a part of a motion."""
    releases = releases_of(part.cell, release_pieces(part.motion, part.demands.spread_s))
    place = landing_place(part.cell, part.demands)
    flown_s = releases.falls_to(min(place.plane_z, place.ends_z) - LOW_M)
    lasts_s = float((releases.pieces.times.upper + flown_s.upper).max())
    return FlyingBall(releases, place, part.cell.object.radius_m, lasts_s)


def _rooms(patches: FlightPairs, clearance_m: float) -> tuple[Array, Array]:
    """Returns what two balls are farther from each other than they must be [m]: along where they are nearest."""
    one, other = patches.one, patches.other
    (a, v), (b, w) = one.at(patches.rows, patches.t0), other.at(patches.others, patches.t0)
    c, d = (ball.at(rows, patches.t1)[0] for ball, rows in ((one, patches.rows), (other, patches.others)))
    before, after = a.c0 - b.c0, c.c0 - d.c0
    n = toward(_nearest_to_origin(before, after))
    least = np.minimum(_lower(n, a, b), _lower(n, c, d))
    h = patches.t1 - patches.t0
    bend = (one.air_m_s2 + other.air_m_s2) * h * h / 8.0 * (1.0 + 8.0 * ROUNDING)
    thick = one.radius_m + other.radius_m + clearance_m - LENGTH_M
    room = shortened(least - bend * lengths_up(n), n) - thick
    may_fly = one.may_fly(patches.rows, patches.t0, a, v) & other.may_fly(patches.others, patches.t0, b, w)
    unsure = (a.r + b.r + 64.0 * ROUNDING * (a.size + b.size)).sum(axis=0)
    most = np.sqrt((before * before).sum(axis=0)) * (1.0 + 1e-12) + unsure - thick
    flies = one.flies(patches.rows, patches.t0, a) & other.flies(patches.others, patches.t0, b)
    return np.where(may_fly, room, np.inf)[None], np.where(flies, most, np.inf)[None]


def _nearest_to_origin(x: Array, y: Array) -> Array:
    """Returns the points (3, m) between points (3, m) that are nearest to the origin, to rounding."""
    along = y - x
    share = -(x * along).sum(axis=0) / np.maximum((along * along).sum(axis=0), 1e-30)
    return x + np.clip(share, 0.0, 1.0) * along


def _lower(n: Array, x: TaylorModel, y: TaylorModel) -> Array:
    """Returns lower bounds (m,) on n . (x - y), whose variables are of two releases."""
    more, less = dot(n, x).lower, dot(n, y).upper
    return more - less - 4.0 * ROUNDING * (np.abs(more) + np.abs(less))
