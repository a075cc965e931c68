"""Check of the object's flight: it meets neither the arm, which still moves, nor a shape, the floor or a bin's wall.

The tool, and links beside which the object is gripped, count from the first instant of the grid below at which the
object is clear of them: it usually starts within their capsules, so that these cannot judge how it leaves
(`opening_direction` does). Capsules that a body's hull alone touches, not its shape, do not grip it: into these it gets
no deeper than it was when released, but for 0.1 mm. Releases that follow each other closely are clear of them one soon
after the other; where they are not, one between them comes out, and meets or grazes what it has just left. A target at
which the object does not fit fails, although a flight to it may end before the sphere touches what is there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from planner.arrays import Array, Index, Mask
from planner.cell import CONTACT_M
from planner.certificate.bounds import EVALUATIONS_MAX, ROUNDS
from planner.certificate.certificate import Check, at_least
from planner.certificate.flight.flights import Flights, flights_of, nearest_on_segments
from planner.certificate.flight.patches import (
    PatchBounds,
    Patches,
    corners_on_grid,
    patch_bounds,
)
from planner.certificate.flight.shapes import BallPatches, core_gaps, least_gaps
from planner.certificate.samples import MotionSamples
from planner.flight import time_of_flight
from planner.kinematics import dot
from planner.native import loops

CLOSE_M = 0.03  # [m] a bound below it is refined until it is within `ACCURACY_M` of the least gap found there
ACCURACY_M = 0.01  # [m]
FEW = 16  # [-] parts that are parted once more before they are looked at, which takes less time than another round
RESTING_S = 0.02  # [s] step of the grid when the arm rests: then the path alone bends, by 0.5 mm
RELEASES_S = 0.005  # [s] step of the grid of releases
# [s] Two releases of an interval are clear of the tool so soon after each other, or in neighbouring patches: their
# instants are 8 to 16 ms apart, 20 ms at rest, and a tick beside the release.
TOGETHER_S = 0.016
DEEPER_M = 1e-4  # chosen [m] that an object may get deeper into what it is gripped by: what a proof can tell at once
BEYOND_S = (0.02, 0.1, 0.5)  # [s] by which the grid passes the end of the latest flight known, until all have ended


@dataclass(frozen=True, eq=False)
class Grid:
    """Grid of m + 1 releases and n + 1 instants, or of a single release and n + 1 instants: then m is 1.

    Attributes:
        r0, r1: begins and ends of the intervals of releases (m,) [s].
        released: positions [m] and velocities [m/s] of the releases (2, 3, m + 1) or (2, 3, 1).
        t: the instants (n + 1,) [s].
        x: positions (3, m + 1, n + 1) or (3, 1, n + 1) [m].
        places: those of each ball of the object [m].
        lowest: heights of the lowest points of a body (m + 1, n + 1) or (1, n + 1) [m]; None of a ball.
        X_WL: poses of base and links at the instants (n + 1, 7, 4, 4).
        rates: sums of joint speeds and accelerations that move each frame (2, 7, n).
        bounds: on what is between the corners.
        apexes: times from which the flights of each interval fall (m,) [s].
    """

    r0: Array
    r1: Array
    released: Array
    t: Array
    x: Array
    places: list[Array]
    lowest: Array | None
    X_WL: Array
    rates: Array
    bounds: PatchBounds
    apexes: Array

    @cached_property
    def h(self) -> Array:
        """Lengths of the intervals of time (n,) [s]."""
        return np.diff(self.t)

    @cached_property
    def s(self) -> Array:
        """Longest time from a release of each patch (m, n) [s]."""
        return np.maximum(self.t[1:] - self.r0[:, None], self.r1[:, None] - self.t[:-1])

    @property
    def dr(self) -> Array:
        """Lengths of the intervals of releases (m, 1) [s]."""
        return (self.r1 - self.r0)[:, None]


def flight_clearance(motion: MotionSamples) -> Check | None:
    """Checks that the object keeps its clearance from any release in the spread until it lands: see `Flights.lowest`.

    The value is a proven lower bound on the distance of the object's surface from the obstacle that leaves it least
    beyond what is required, and the limit is what that one requires; up to 3 cm beyond it the value is at most 1 cm too
    small. The landing plane, what lies below it, what the object lands on, and what does not let go of it at once do
    not count in it, only whether the object meets them before. None for a motion that throws nothing.
    """
    name = "flight_clearance"
    problem = motion.problem
    if not problem.throws:
        return None
    flights = flights_of(motion)
    if flights.end is None:
        return at_least(name, math.nan, 0.0, "m", flights.released_s, "never lands")
    if problem.misfit is not None:
        return at_least(name, -problem.misfit.lacking_m, 0.0, "m", flights.end[1], problem.misfit.name)
    found = _released_under_bin(flights) or _missed(flights) or _least_gap(flights)
    value = max(found.value, 0.0) if found.proven else found.value
    required = flights.required_of(found.obstacle)
    return at_least(name, required + value, required, "m", found.at_s, found.obstacle).provided(found.proven)


@dataclass(frozen=True)
class LeastGap:
    """The least gap beyond the clearance: bound or violation [m], its time [s], its obstacle, whether it is proven."""

    value: float
    at_s: float
    obstacle: str
    proven: bool


def _released_under_bin(flights: Flights) -> LeastGap | None:
    """Returns by how much a release is below the bin's bottom and within its wall, None where none is."""
    if flights.opening is None:
        return None
    t, p, _ = _releases(flights, [(-math.inf, math.inf)])
    room = np.where(
        flights.from_mouth(flights.beside_bin(p, t))[0] > 0.0, p[2] - flights.motion.problem.plane_z, np.inf
    )
    worst = int(room.argmin())
    if room[worst] >= 0.0:
        return None
    return LeastGap(float(room[worst]) - flights.radius_m, float(t[worst]), "rim", proven=False)


def _missed(flights: Flights) -> LeastGap | None:
    """Returns by how much a body touches the floor, or the edge of what it is to land on; None where none does."""
    landings = flights.landings_of_body
    if landings is None or landings.missed is None:
        return None
    value, at_s, name = landings.missed
    return LeastGap(value, at_s, name, proven=False)


def _least_gap(flights: Flights) -> LeastGap:
    """Returns the least gap of the flights."""
    begun = _begin(flights, ())
    if begun is not None and begun.apart.any():
        grid = begun.grid
        apart = begun.apart
        begun = _begin(flights, list(zip(grid.r0[apart], grid.r1[apart], strict=True)))
    if begun is None:
        return LeastGap(math.nan, flights.released_s, "never lands", False)
    grid = begun.grid
    lower = begun.lower
    judged = begun.judged
    only_judged = np.asarray(~begun.counted.all(axis=(1, 2)))
    undecided = judged & (lower < np.where(only_judged, -CONTACT_M, CLOSE_M)[:, None, None])
    least = np.where(begun.counted & judged & ~undecided, lower, np.inf)
    allowed = np.full(len(lower), -CONTACT_M)
    allowed[flights.gripped] = np.minimum(flights.gaps_at_release, 0.0) - DEEPER_M
    sinks = begun.held & (lower < allowed[:, None, None])
    item, _, column = np.unravel_index(int(least.argmin()), lower.shape)
    found = LeastGap(float(least.min()), float(grid.t[column]), flights.names[item], True)
    patches = _patches(grid, undecided | sinks)
    if not patches.item.size:
        return found
    is_held = sinks[undecided | sinks]
    patches = patches._replace(allowed_m=np.where(is_held, allowed[patches.item], -CONTACT_M))
    return _refined(found, flights, grid.bounds, patches, only_judged)


@dataclass(frozen=True, eq=False)
class Begun:
    """What a proof begins with: a grid, and its patches.

    Attributes:
        grid: the grid.
        lower: lower bounds on the gaps over the patches (items, m, n) [m]; infinite without one.
        judged, counted, held, apart: as `_decided` returns them.
    """

    grid: Grid
    lower: Array
    judged: Mask
    counted: Mask
    held: Mask
    apart: Mask


def _begin(flights: Flights, closely: Sequence[tuple[float, float]]) -> Begun | None:
    """Returns what a proof begins with, None where some flight does not land.

    Args:
        flights: the flights.
        closely: as for `_releases`.
    """
    covers = _covers if flights.landings_of_body is None else (lambda _: True)  # a body's grid ends as the last lands
    grid = next((grid for beyond in BEYOND_S if covers(grid := _grid(flights, beyond, closely))), None)
    if grid is None:
        return None
    lower = _lower_bounds(flights, grid)
    return Begun(grid, lower, *_decided(flights, grid, lower))


def _grid(flights: Flights, beyond_s: float, closely: Sequence[tuple[float, float]]) -> Grid:
    """Returns the grid on which a proof starts; it ends `beyond_s` after the latest flight known [s].

    Its instants are the motion's knots, then others while the arm rests. Its releases are those of `_releases`.
    """
    motion = flights.motion
    end = flights.end
    (r, p, v) = _releases(flights, closely)
    assert end is not None
    first = int(np.searchsorted(motion.at_knots.t, motion.gone_from_s - CONTACT_M))
    t = motion.at_knots.t[first:]
    last = _latest_end(flights, r, p, v) + beyond_s
    moving = 1 + min(int(np.searchsorted(t, last)), len(t) - 1)  # instants while the arm moves
    resting = math.ceil(max(0.0, last - t[moving - 1]) / RESTING_S)
    t = np.concatenate([t[:moving], t[moving - 1] + RESTING_S * np.arange(1, resting + 1)])
    poses = motion.at_knots.X_WL[first : first + moving]
    rates = np.zeros((2, 7, len(t) - 1))
    rates[:, 1:, : moving - 1] = motion.rates.sums[:2, :, first : first + moving - 1]
    spacing = float(np.diff(r).max(initial=0.0))
    several = slice(min(1, len(r) - 1), None)
    bounds = patch_bounds(flights, end[0], spacing, v)
    apexes = bounds.apexes(r, v)
    x = flights.flown_on_grid(p, v, t - r[:, None])
    places, lowest = flights.places(x, r[:, None], t)
    return Grid(
        r0=r[: max(1, len(r) - 1)],
        r1=r[several],
        released=np.array([p, v]),
        t=t,
        x=x,
        places=places,
        lowest=lowest,
        X_WL=np.concatenate([poses, np.repeat(poses[-1:], resting, axis=0)]),
        rates=rates,
        bounds=bounds,
        apexes=np.maximum(apexes[: max(1, len(r) - 1)], apexes[several]),
    )


def _releases(flights: Flights, closely: Sequence[tuple[float, float]]) -> tuple[Array, Array, Array]:
    """Returns times (m,) [s], positions and velocities (3, m) of the releases of the grid.

    Args:
        flights: the flights.
        closely: intervals in which all releases belong to it that the other checks have evaluated, a millisecond apart.
    """
    if flights.spread_s == 0.0:
        p, v = flights.nominal
        return np.array([flights.released_s]), p[:, None], v[:, None]
    arm = flights.motion.in_spread
    count = 1 + math.ceil(2.0 * flights.spread_s / RELEASES_S)
    rows = np.linspace(0, len(arm.t) - 1, count).round().astype(int)
    within = [np.flatnonzero((arm.t > begin) & (arm.t < end)) for begin, end in closely]
    rows = np.unique(np.concatenate([rows, *within]))
    return arm.t[rows], arm.p_WT[:, rows], flights.leaving(arm.v_WT[:, rows])


def _latest_end(flights: Flights, r: Array, p: Array, v: Array) -> float:
    """Returns when the last flight released at one of `r` ends [s]; with drag, when the nominal one does."""
    assert flights.end is not None
    (height, nominal) = flights.end
    problem = flights.motion.problem
    if flights.landings_of_body is not None:
        return flights.landings_of_body.last_s
    if flights.spread_s == 0.0 or problem.drag > 0.0:
        return nominal + flights.spread_s
    times = time_of_flight(p[2] - height, v[2], problem.gravity)
    return max(nominal, float(np.nan_to_num(r + times).max()))


def _covers(grid: Grid) -> bool:
    """Returns whether all flights have ended at the last instant of a grid."""
    last = grid.t[-1]
    across = grid.bounds.release_bend(np.maximum(last - grid.r0, 0.0), grid.r1 - grid.r0)
    heights = grid.x[2, :, -1]
    highest = np.maximum(heights[: len(grid.r0)], heights[-len(grid.r1) :]) + across
    return bool(((last >= grid.apexes) & (highest < grid.bounds.height)).all())


def _lower_bounds(flights: Flights, grid: Grid) -> Array:
    """Returns lower bounds on the gaps to obstacles over the patches of a grid (items, m, n) [m]; infinite without one.

    The bin's wall is among the obstacles only where there is one. Shapes that are too far to decide have no bounds.
    """
    places = zip(flights.balls_m, grid.places, strict=True)
    lowest = None
    if grid.lowest is not None and flights.landings_of_body is not None:
        farthest = grid.bounds.of_ball(flights.landings_of_body.thing.outer_radius_m)
        lowest = np.min(corners_on_grid(grid.lowest), axis=0) - farthest.bend(grid.s, grid.dr, grid.h)
    return np.min([_bounds_of_ball(flights, grid, *place, lowest) for place in places], axis=0)


def _bounds_of_ball(flights: Flights, grid: Grid, place_m: float, y: Array, below: Array | None) -> Array:
    """Returns the bounds of `_lower_bounds` for a ball of the object.

    Args:
        flights, grid: as given.
        place_m: its place along the object's axis [m].
        y: where it is [m].
        below: heights that no point of a body is below over the patches (m, n) [m]; None of a ball.
    """
    bounds = grid.bounds
    ball = bounds.of_ball(place_m)
    x = corners_on_grid(grid.x)
    across = bounds.release_bend(grid.s, grid.dr)
    bend = across + bounds.time_bend(grid.s, grid.h)
    ball_bend = bend if place_m == 0.0 else ball.bend(grid.s, grid.dr, grid.h)
    falling = grid.t[:-1] >= grid.apexes[:, None]
    highest = np.max([corner[2] for corner in x[::2]], axis=0) + across
    times = corners_on_grid(np.broadcast_to(grid.t, grid.x.shape[1:]))
    lowest = flights.lowest_at(x, times, bend)
    patches = BallPatches(x, times, bend, corners_on_grid(y), ball_bend, falling, below)
    landings = flights.landings_of_body
    spans = None if landings is None else landings.spans(grid.r0, grid.r1).in_rows()

    def in_flight(item: Index, gaps: Array) -> Array:
        if spans is not None:
            carries = flights.carriers[item, None, None]
            over = spans.is_over(carries, grid.t[:-1], grid.t[1:]) | (grid.t[1:] <= grid.r0[:, None])
        else:
            ends = flights.over_below(item[:, None, None], lowest)
            over = (falling & (highest < ends)) | (grid.t[1:] <= grid.r0[:, None])
        return np.where(over, np.inf, gaps - flights.thickness[item, None, None])

    def of_shapes(item: Index) -> Array:
        each = patches._replace(
            corners=[corner[:, None] for corner in x],
            times=[t[None] for t in times],
            places=[corner[:, None] for corner in patches.places],
        )
        return in_flight(item, core_gaps(flights, each, item[:, None, None]))

    gaps = np.full((flights.count, *bend.shape), np.inf)
    if flights.count:
        near = _near_shapes(flights, least_gaps(flights, patches), of_shapes)
        gaps[near] = of_shapes(near)
    others = [_capsule_distances(flights, grid, ball, y) - ball_bend]
    if flights.opening is not None:
        beside = [flights.beside_bin(place, t) for place, t in zip(patches.places, times, strict=True)]
        rim = bounds.wall_bound(beside) - ball_bend
        is_in = falling & bounds.all_in_bin(beside, ball_bend) & (landings is None)
        others.append(np.where(is_in, np.inf, rim)[None])
    found = np.concatenate(others)
    return np.concatenate([gaps, in_flight(flights.count + np.arange(len(found)), found)])


def _near_shapes(flights: Flights, least: Array, gaps: Callable[[Index], Array]) -> Index:
    """Returns the shapes that can decide the least gap: none of the others has a bound below it, or needs a closer one.

    Args:
        flights: the flights.
        least: a gap (b,) that the bounds of each shape are not below [m].
        gaps: function of shapes (k,) that returns the bounds on their gaps over the patches (k, m, n) [m].
    """
    carries = flights.carriers[: flights.count]  # their gaps do not count
    counted = np.flatnonzero(~carries)
    if not counted.size:
        return np.flatnonzero(carries)
    nearest = counted[[int(least[counted].argmin())]]
    decisive_m = max(CLOSE_M, float(gaps(nearest).min()))
    return np.flatnonzero(carries | ~(least > decisive_m))


def _capsule_distances(flights: Flights, grid: Grid, bounds: PatchBounds, y: Array) -> Array:
    """Returns lower bounds on the distances of the capsules (c, m, n) [m] from a ball at `y`, but for its bend."""
    body = flights.motion.body
    capsules = body.frames[: body.object], body.ends[: body.object]
    moving = np.array([bounds.speed(grid.s), bounds.time_bend(grid.s, grid.h)])
    return loops.capsule_bounds((y, grid.X_WL, grid.h), capsules, grid.rates, bounds.reach, moving)


def _decided(flights: Flights, grid: Grid, lower: Array) -> tuple[Mask, Mask, Mask, Mask]:
    """Returns which patches are judged, count in the value, are held (items, m, n), and which intervals are apart (m,).

    For what the object is gripped by, the patches before the first one in or from which it is clear are not judged. If
    it was not proven clear from the beginning, the others do not count in the value: the distance begins at 0, as it
    ends at 0 where the object lands. Those that are not judged are held, where a body's own shape is clear of it at the
    release: what touches its hull alone does not grip it. Where the two releases of an interval are clear of it far
    apart, the first one decides.
    """
    in_flight = ~np.isposinf(lower)
    gripped = flights.gripped
    judged = in_flight.copy()
    counted = np.ones(lower.shape, np.bool_)
    clear = np.logical_or.accumulate((lower[gripped] >= 0.0) & in_flight[gripped], axis=2)
    at_once = (clear | ~in_flight[gripped]).reshape(len(gripped), -1).all(axis=1)
    counted[gripped] = np.asarray(at_once)[:, None, None]
    counted[flights.carriers[: len(lower)]] = False
    held = in_flight[gripped] & ~clear
    starts = _starts_clear(flights, grid, held)
    both, either = (np.logical_or.accumulate(each, axis=2) for each in (starts.all(axis=0), starts.any(axis=0)))
    between = either & held & ~both
    apart = (between.sum(axis=2) > 1) & ((between * grid.h).sum(axis=2) > TOGETHER_S)
    judged[gripped] &= clear | np.where(apart[:, :, None], either, both)
    still = in_flight & ~judged
    still[flights.gripped] &= flights.shape_is_beside[:, None, None]
    return judged, counted, still, apart.any(axis=0)


def _starts_clear(flights: Flights, grid: Grid, held: Mask) -> Mask:
    """Returns in which of the `held` patches (gripped, m, n) the object begins clear of what it is gripped by.

    It begins where the patch does, or with its release: that of the begin and that of the end of each interval, (2,
    gripped, m, n). A bound on a whole patch can be too small to tell, by millimetres.
    """
    starts = np.zeros((2, *held.shape), np.bool_)
    (item, row, column) = np.nonzero(held)
    several = grid.released.shape[2] > 1
    body = flights.motion.body
    release = np.array([row, row + 1] if several else [row])  # without one, both ends are the same release
    r = np.append(grid.r0, grid.r1[-1])
    X_WL = grid.X_WL
    is_later = grid.t[column] >= r[release]
    p, v = grid.released[:, :, release]
    x = flights.flown(p, v, np.where(is_later, grid.t[column] - r[release], 0.0))
    if not is_later.all():
        X_WL = np.concatenate([X_WL, flights.motion.poses_at(r)])
    instant = np.where(is_later, column, len(grid.t) + release)
    start, end = np.moveaxis(body.end_points(X_WL)[body.beside_object][item, :, :, instant], (2, 3), (0, 1))
    thickness = flights.thickness[flights.gripped[item]]
    is_clear = []
    for y in flights.places(x, r[release], np.maximum(grid.t[column], r[release]))[0]:
        apart = y - nearest_on_segments(y, start, end)
        is_clear.append(np.sqrt(dot(apart, apart)) - thickness > CONTACT_M)
    starts[:, held] = np.all(is_clear, axis=0)
    return starts


def _patches(grid: Grid, chosen: Mask) -> Patches:
    """Returns the patches of a grid (items, m, n) that are `chosen`."""
    item, row, column = np.nonzero(chosen)
    frames = grid.bounds.frames(item)
    w, a = grid.rates[:, frames, column]
    allowed = np.full(len(item), -CONTACT_M)
    return Patches(item, grid.r0[row], grid.r1[row], grid.t[column], grid.t[column + 1], w, a, allowed)


def _refined(found: LeastGap, flights: Flights, bounds: PatchBounds, patches: Patches, only_judged: Mask) -> LeastGap:
    """Returns the least gap with undecided `patches`: their parts are looked at until all are clear, or one is not.

    Args:
        found: the least gap of the others.
        flights, bounds: of the grid.
        patches: to be looked at.
        only_judged: which obstacles (items,) do not count in the value: what lets go of the object, what carries it.
    """
    spent = 0
    nearest = math.inf
    for _ in range(ROUNDS):
        patches = patches.parts(flights.spread_s > 0.0)
        if len(patches.item) <= FEW:
            patches = patches.parts(flights.spread_s > 0.0)
        spent += len(patches.item)
        if spent > EVALUATIONS_MAX:
            break
        seen = bounds.evaluate(patches)
        free = ~only_judged[patches.item]
        spare = seen.sampled - patches.allowed_m
        corner, patch = np.unravel_index(int(spare.argmin()), spare.shape)
        if spare[corner, patch] < 0.0:
            value = float(seen.sampled[corner, patch])
            at_s = float(seen.t[corner, patch])
            return LeastGap(value, at_s, flights.names[patches.item[patch]], False)
        nearest = min(nearest, float(seen.sampled[:, free].min(initial=math.inf)))
        close = max(-CONTACT_M, min(CLOSE_M, nearest - ACCURACY_M))
        undecided = seen.lower < np.where(free, close, patches.allowed_m)
        decided = np.where(free & ~undecided, seen.lower, math.inf)
        least = int(decided.argmin())
        if decided[least] < found.value:
            found = LeastGap(float(decided[least]), float(patches.t0[least]), flights.names[patches.item[least]], True)
        if not undecided.any():
            return found
        patches = patches.keep(undecided)
    return replace(found, proven=False)
