"""The object's flights, one for each instant at which the gripper may open, and what they can meet.

A flight that begins at the time r is at x(r, t) at the time t, both on the trajectory's clock: p(r) + f v(r) s + g
s^2/2 with s = t - r, and the release speed factor f. The object is a sphere: it keeps clear of a shape's core, of a
capsule's axis or of a bin's wall by its radius (and theirs), until it first touches a surface on which it lands, the
floor or the level top of a shape; a flight that never rises as high until its centre passes the landing plane. In the
air, where there is no surface, that is so for all. On a surface the object lies from its touch on, and keeps clear of
the shapes that are higher until its centre would be at the target.

A body is a row of such balls, at x + a u for places a along the axis u of its hull, which turns with it. Each keeps
clear until the body has landed (`planner.touchdown`): of what it lands on until it may have, of all else until it has.
What lies below its lowest point, it is clear of.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache

import numpy as np

from planner.arrays import Array, Index, Mask
from planner.cell import nearest_on_cores, shape_of
from planner.certificate.flight.body import BodyLandings
from planner.certificate.samples import MotionSamples
from planner.flight import fly, paths, positions_after
from planner.geometry import Surface
from planner.kinematics import dot
from planner.releases import Opening
from planner.rotations import pose

POINTS_ALONG = 33  # of a segment in each round: each leaves a sixteenth of it
ROUNDS_ALONG = 5

# [m] of an object in flight: of a point the distance from a wall without thickness, or within a box, is never below 0
LEAST_RADIUS_M = 1e-5
TINY_M = 1e-12  # [m] a distance below which there is no direction


class Flights:
    """The flights of a motion, and the obstacles around them.

    Obstacles are numbered: first the keep-out shapes, then the capsules of arm and tool, then a bin's wall. Arrays over
    k points have the coordinates on their first axis and the points on their last.

    Attributes:
        motion: the motion.
        spread_s: largest deviation of the release time [s]: how early or late the gripper may open.
        released_s: time of the nominal release [s].
        radius_m: of the object or of each ball of its hull, at least `LEAST_RADIUS_M` [m].
        balls_m: places of the balls along its axis [m]: of an object that is a ball its centre alone.
        reach_m: distance of the outermost one from the centre [m].
        shapes: rows of the b shapes (20, b), see `Solid.row`.
        tops: heights of the b shapes (b,), without the radius about their cores [m].
        names: of the obstacles.
        clearance_m: distance that the object keeps from most obstacles [m].
        required: distance that it keeps from each obstacle [m]: none for what it is gripped beside and lands on, and
            for a bin's wall that stands; less beside the target, see `ThrowProblem.flight_clearances`.
        target: the target, if it moves, with its bin.
        thickness: distance of the object's centre from each obstacle's core at which the two are as near as they may be
            [m]: radii and what is required. "Gaps" are what is left beyond it.
    """

    def __init__(self, motion: MotionSamples) -> None:
        problem = motion.problem
        body = motion.body
        self.motion = motion
        self.spread_s = problem.opening_spread_s
        self.released_s = motion.trajectory.release_time_s
        surroundings = problem.cell.surroundings
        around = surroundings.keep_out
        heights = np.array([shape.upper[2] for shape in around])
        radius = max(problem.cell.object.radius_m, LEAST_RADIUS_M)
        self.radius_m = radius
        self.balls_m = problem.cell.object.balls_m
        self.reach_m = problem.cell.object.reach_m
        self.shapes = surroundings.keep_out_rows.T
        self.tops = heights - self.shapes[-1]
        capsules = slice(0, body.object)
        self.names = (*surroundings.keep_out_names, *body.names[capsules], "rim")
        self.clearance_m = surroundings.flight_clearance_m
        of_shapes, of_base = problem.flight_clearances
        of_links = np.full(body.object, self.clearance_m)
        of_links[body.frames[capsules] == 0] = of_base
        of_links[self._beside_release()] = 0.0
        self.required = np.concatenate([of_shapes, of_links, [problem.start_slack_m]])
        radii = np.concatenate([self.shapes[-1], body.radii[capsules], [0.0]])
        self.thickness = radius + radii + self.required
        self.target = problem.moving

    def _beside_release(self) -> Index:
        """Returns the capsules that the object is gripped by or beside, nearer than the clearance when released."""
        return self.motion.body.beside_object[self.gaps_at_release < self.clearance_m]

    @cached_property
    def gaps_at_release(self) -> Array:
        """Gaps to the capsules that the object is gripped by or beside when it is released on time (k,) [m]."""
        body = self.motion.body
        X_WL = self.motion.at_knots.X_WL[self.motion.release_knot : self.motion.release_knot + 1]
        ends = body.end_points(X_WL)[..., 0]
        beside = body.beside_object
        p0, p1 = ends[body.object]
        x = p0[:, None] + np.linspace(0.0, 1.0, len(self.balls_m)) * (p1 - p0)[:, None]
        apart = x[..., None] - nearest_on_segments(x[..., None], ends[beside, 0].T[:, None], ends[beside, 1].T[:, None])
        return np.sqrt(dot(apart, apart)).min(axis=0) - body.radii[beside] - self.radius_m

    @cached_property
    def shape_is_beside(self) -> Mask:
        """Which of these capsules a body's own shape is clear of when it is released on time (k,); none of a ball's.

        What its hull alone touches does not grip it.
        """
        body = self.motion.body
        if self.landings_of_body is None:
            return np.zeros(len(body.beside_object), np.bool_)
        at = np.array([self.released_s])
        thing = self.landings_of_body.thing
        X_WO = pose(self.nominal[0], self.landings_of_body.axes(at, at)[0])
        round_m = np.array([0.5 * thing.size_m[0], thing.size_m[2] - thing.size_m[0] * (thing.kind == "capsule")])
        shape = shape_of(thing.kind, X_WO, thing.size_m if thing.kind == "box" else round_m).row
        k = self.motion.release_knot
        ends = body.end_points(self.motion.at_knots.X_WL[k : k + 1])[..., 0][body.beside_object]
        gaps = [segment_gap(start, end, shape) for start, end in ends]
        return np.array(gaps) > body.radii[body.beside_object]

    def required_of(self, obstacle: str) -> float:
        """Returns the distance that the object keeps from an obstacle [m]; 0 for a name that is none."""
        return float(self.required[self.names.index(obstacle)]) if obstacle in self.names else 0.0

    @property
    def rim(self) -> int:
        """Number of the bin's wall among the obstacles."""
        return len(self.names) - 1

    @property
    def gripped(self) -> Index:
        """Obstacles beside which the object is gripped."""
        return self.motion.body.beside_object + self.count

    @property
    def count(self) -> int:
        """Number of the keep-out shapes, and of the first capsule among the obstacles."""
        return len(self.tops)

    @property
    def opening(self) -> Opening | None:
        """The bin's mouth; None where there is no bin."""
        return self.motion.problem.opening

    @cached_property
    def nominal(self) -> tuple[Array, Array]:
        """Position (3,) [m] and velocity (3,) [m/s] of the object at the nominal release."""
        arm = self.motion.at_knots
        k = self.motion.release_knot
        return arm.p_WT[:, k], self.leaving(arm.v_WT[:, k])

    @cached_property
    def landings_of_body(self) -> BodyLandings | None:
        """When a body has landed; None of a ball."""
        return None if self.motion.problem.body is None else BodyLandings(self.motion, self.spread_s)

    @cached_property
    def end(self) -> tuple[float, float] | None:
        """Height of the centre below which nothing counts [m], time of the nominal end [s]; None: it never lands."""
        problem = self.motion.problem
        if self.landings_of_body is not None:
            return self.landings_of_body.end
        height = self.lowest if self.lies_at_m is None else problem.plane_z
        flight = fly(*self.nominal, height, problem.gravity, problem.drag)
        return None if flight is None else (height, self.released_s + flight.time_of_flight_s)

    def _ends_over(self, surface: Surface) -> float:
        """Returns the height of the centre at which a flight ends over a surface [m], the plane's if it never rises."""
        problem = self.motion.problem
        touching = surface.height_m + self.radius_m
        rises = fly(*self.nominal, touching, problem.gravity, problem.drag) is not None
        return touching if rises else problem.plane_z

    @cached_property
    def lowest(self) -> float:
        """Height of the falling centre below which a flight is over, wherever it is [m]; what is higher counts on."""
        everywhere = [each for each in self.motion.problem.surfaces if np.isinf(each.lower).all()]
        everywhere = everywhere if self.opening is None else []  # only within a bin's wall
        return max(map(self._ends_over, everywhere), default=self.motion.problem.plane_z)

    @cached_property
    def landings(self) -> list[tuple[Surface, float]]:
        """Surfaces over which flights end higher than that, with the height of the centre [m]."""
        found = [(surface, self._ends_over(surface)) for surface in self.motion.problem.surfaces]
        return [(surface, height) for surface, height in found if height > self.lowest]

    @cached_property
    def higher(self) -> Mask:
        """Which obstacles (items,) an object that lies at its target can meet: shapes higher than what it lies on."""
        higher = np.zeros(len(self.names), np.bool_)
        higher[: self.count] = self.motion.problem.is_met_lying(self.tops + self.shapes[-1])
        return higher

    @cached_property
    def carriers(self) -> Mask:
        """Which obstacles (items,) are shapes that carry a surface on which the object lands, or lie below one."""
        carriers = np.zeros(len(self.names), np.bool_)
        carriers[: self.count] = self.motion.problem.carriers
        return carriers

    @cached_property
    def lies_at_m(self) -> float | None:
        """Height of the centre of an object that lies at its target [m]; None where it can meet nothing there."""
        return self.motion.problem.lies_z if self.higher.any() else None

    def beside_bin(self, x: Array, t: Array) -> Array:
        """Returns points (3, ...) [m] at times `t` (...) [s] as they are beside a bin that moves, as that is met.

        The bin is where its axis says at the landing of the nominal release; before that it is on its way there.
        """
        if self.target is None or self.opening is None:
            return x
        return np.asarray(x - self.target.v_W.reshape(3, *[1] * (x.ndim - 1)) * (t - self.lands_s))

    @cached_property
    def lands_s(self) -> float:
        """Time of the landing of the nominal release on the target's plane [s]."""
        problem = self.motion.problem
        flight = fly(*self.nominal, problem.plane_z, problem.gravity, problem.drag)
        return np.nan if flight is None else self.released_s + flight.time_of_flight_s

    def lowest_at(self, corners: Sequence[Array], times: Sequence[Array], bend: Array | float = 0.0) -> Array:
        """Returns the heights (...) [m] of the falling centre below which a flight is over, on a surface or below all.

        Args:
            corners: of patches of flights, each (3, ...) [m].
            times: of the corners, each (...) [s].
            bend: deviation of the flights from what is between the corners (...) [m].
        """
        lowest = np.full(corners[0].shape[1:], self.lowest)
        for surface, height in self.landings:
            depths = [self._depth_within(surface, x, t) for x, t in zip(corners, times, strict=True)]
            within = np.min(depths, axis=0) > bend
            lowest = np.where(within, np.maximum(lowest, height), lowest)
        return lowest

    def highest_end_at(self, corners: Sequence[Array], bend: Array) -> Array:
        """Returns the largest heights (...) [m] at which a flight in the patches may be over; see `lowest_at`."""
        ends = np.full(corners[0].shape[1:], self.lowest)
        places = [corner[:2] for corner in corners]
        least = np.min(places, axis=0) - bend
        most = np.max(places, axis=0) + bend
        for surface, height in self.landings:
            lower, upper = (corner.reshape(2, *[1] * ends.ndim) for corner in (surface.lower, surface.upper))
            meets = ((least <= upper) & (most >= lower)).all(axis=0)
            ends = np.where(meets, np.maximum(ends, height), ends)
        return ends

    def over_below(self, item: Index, end: Array) -> Array:
        """Returns the heights (..., k) [m] of the falling centre below which obstacles `item` (k,) no longer count.

        Args:
            item: numbers of the obstacles.
            end: heights at which the flights are over (..., k) [m].
        """
        return np.where(self.higher[item], self.motion.problem.plane_z, end)

    def lies(self, x: Array, t: Array, fallen: Mask) -> Mask:
        """Returns where the object lies (...), rather than flies.

        Args:
            x: centres of the flights (3, ...) [m].
            t: their times (...) [s].
            fallen: which of them are beyond the apex (...).
        """
        return np.asarray(fallen & (self.lies_at_m is not None) & (x[2] < self.lowest_at([x], [t])))

    def lying_at(self, x: Array) -> Array:
        """Returns the centres (3, ...) [m] of an object that lies where a flight is at `x` (3, ...).

        A learnt flight that lands beside its aim is as far off there as at the target.
        """
        shift = self.motion.problem.aim_shift
        height_m = self.lies_at_m
        return np.stack([x[0] - shift[0], x[1] - shift[1], np.full_like(x[2], height_m)])

    def _depth_within(self, surface: Surface, x: Array, t: Array) -> Array:
        """Returns how far within a surface, and the bin's wall, points (3, ...) are at times `t` (...) [m]."""
        depth = surface.depth(x)
        return depth if self.opening is None else np.minimum(depth, self.from_mouth(self.beside_bin(x, t))[0])

    def releases(self, r: Array) -> tuple[Array, Array]:
        """Returns positions and velocities (3, k) of the object at release times `r` (k,) [s] of the spread.

        Without a spread there is one release, the nominal one.
        """
        if self.spread_s == 0.0:
            arm = self.motion.at_knots
            where = np.full(len(r), self.motion.release_knot)
        else:
            distinct, where = np.unique(r, return_inverse=True)
            arm = self.motion.at(distinct)
        return arm.p_WT[:, where], self.leaving(arm.v_WT[:, where])

    def places(self, x: Array, r: Array, t: Array) -> tuple[list[Array], Array | None]:
        """Returns the centres (3, ...) [m] of the balls of objects at `x` (3, ...), and their lowest points (...) [m].

        None instead of the lowest point of a ball.

        Args:
            x: centres of the flights [m].
            r: releases (...) [s].
            t: times (...) [s].
        """
        if self.landings_of_body is None:
            return [x], None
        thing = self.landings_of_body.thing
        r, t = np.broadcast_arrays(r, t)
        R_WO = self.landings_of_body.axes(r.ravel(), t.ravel())
        u = (R_WO @ thing.hull_axis_O).T.reshape(x.shape)
        return [x + place * u for place in self.balls_m], x[2] - thing.below(R_WO).reshape(x.shape[1:])

    def leaving(self, v_WT: Array) -> Array:
        """Returns the velocities (3, ...) [m/s] with which the object leaves a tool at `v_WT` (3, ...) [m/s]."""
        return self.motion.problem.release_speed_factor * v_WT

    def positions(self, r: Array, t: Array) -> Array:
        """Returns the positions (3, k) [m] at times `t` (k,) of flights that began at times `r` (k,) [s]."""
        return self.flown(*self.releases(r), t - r)

    def flown(self, p: Array, v: Array, s: Array) -> Array:
        """Returns positions (3, ...) [m] `s` (...) [s] after releases at `p` with velocities `v`, both (3, ...).

        Before its release a flight is extended by its acceleration at the release.
        """
        gravity = self.motion.problem.gravity
        drag = self.motion.problem.drag
        x = self._extended(p, v, s)
        if drag > 0.0:
            late = s > 0.0
            x[:, late] = positions_after(p[:, late].T, v[:, late].T, s[late], gravity, drag).T
        return x

    def flown_on_grid(self, p: Array, v: Array, s: Array) -> Array:
        """Returns positions (3, m, n) [m] of `flown` at increasing times (m, n) [s] after m releases, both (3, m)."""
        gravity = self.motion.problem.gravity
        drag = self.motion.problem.drag
        x = self._extended(p[:, :, None], v[:, :, None], s)
        if drag > 0.0:
            flown = paths(p.T, v.T, np.maximum(s, 0.0), gravity, drag).transpose(2, 0, 1)
            x = np.where(s > 0.0, flown, x)
        return x

    def _extended(self, p: Array, v: Array, s: Array) -> Array:
        """Returns positions (3, ...) [m] without drag, before a release with its acceleration at the release."""
        gravity = self.motion.problem.gravity
        drag = self.motion.problem.drag
        x = p + v * s
        x[2] -= 0.5 * gravity * s * s
        return np.where(s <= 0.0, x - 0.5 * drag * np.sqrt(dot(v, v)) * s * s * v, x) if drag > 0.0 else x

    def nearest(self, item: Index, x: Array, t: Array) -> Array:
        """Returns the point (3, k) [m] of obstacle `item[i]` at the time `t[i]` that is nearest to `x[:, i]`."""
        count = self.count
        near = np.empty_like(x)
        is_shape = item < count
        is_rim = item == self.rim
        if is_shape.any():
            near[:, is_shape] = nearest_on_cores(x[:, is_shape], self.shapes[:, item[is_shape]])
        if is_rim.any():
            beside = self.beside_bin(x[:, is_rim], t[is_rim])
            near[:, is_rim] = self.nearest_on_wall(beside) + (x[:, is_rim] - beside)
        rest = ~is_shape & ~is_rim
        if rest.any():
            ends = self.motion.body.end_points_of(item[rest] - count, self.motion.poses_at(t[rest]))
            near[:, rest] = nearest_on_segments(x[:, rest], ends[:, 0].T, ends[:, 1].T)
        return near

    @property
    def axis(self) -> Array:
        """Horizontal place (2,) of the bin's axis [m]."""
        target = self.motion.problem.target
        assert target is not None
        return target.p_W[:2]

    def nearest_on_wall(self, x: Array) -> Array:
        """Returns the points of the bin's wall nearest to `x` (3, ...) [m]; infinitely far where there is no bin.

        The wall goes on below the bottom: what comes from there would pass through the bottom.
        """
        if self.opening is None:
            return np.full_like(x, np.inf)
        (x0, y0) = self.axis
        rim = self.motion.problem.plane_z + self.opening.rim_height_m
        rho = np.hypot(x[0] - x0, x[1] - y0)
        off = rho > TINY_M
        length = np.maximum(rho, TINY_M)
        out_x = np.where(off, (x[0] - x0) / length, 1.0)
        out_y = np.where(off, (x[1] - y0) / length, 0.0)
        return np.stack([x0 + self.opening.radius_m * out_x, y0 + self.opening.radius_m * out_y, np.minimum(x[2], rim)])

    def from_mouth(self, x: Array) -> tuple[Array, Array]:
        """Returns how far within the bin's wall and how high above its mouth points (3, ...) are [m]."""
        if self.opening is None:
            return np.full(x.shape[1:], -np.inf), np.full(x.shape[1:], np.inf)
        within = self.opening.radius_m - np.hypot(x[0] - self.axis[0], x[1] - self.axis[1])
        return within, x[2] - self.motion.problem.plane_z - self.opening.rim_height_m

    def in_bin(self, x: Array) -> Mask:
        """Returns whether points (3, ...) are below the mouth's plane and within the wall."""
        within, above = self.from_mouth(x)
        return (within > 0.0) & (above < 0.0)

    def gaps_along(self, x: Array, t: Array) -> Array:
        """Returns the gaps to every obstacle (items, n) [m] along one flight; infinite where they no longer count.

        Args:
            x: successive centres (3, n) [m] after the nominal release.
            t: their times (n,) [s].
        """
        falls = is_falling(x)
        places, lowest = self.places(x, np.full(len(t), self.released_s), t)
        gaps = np.min([self._gaps_of_ball(x, y, falls, t) for y in places], axis=0)
        if self.landings_of_body is None or lowest is None:
            return gaps
        above = lowest - (self.tops + self.shapes[-1])[:, None] - self.required[: self.count, None]
        gaps[: self.count] = np.maximum(gaps[: self.count], above)
        if self.end is not None:
            gaps[:, t >= self.end[1]] = np.inf
        return gaps

    def _gaps_of_ball(self, x: Array, y: Array, falls: Mask, t: Array) -> Array:
        """Returns what `gaps_along` does for a ball at places `y` (3, n) of the object at `x` (3, n) [m]."""
        items = np.arange(len(self.names))
        lies = self.lies(x, t, falls)
        centres = np.repeat(y[:, None], len(items), axis=1)
        if lies.any():
            centres[:, : self.count] = np.where(lies, self.lying_at(x), y)[:, None]
        every = np.repeat(items, len(t))
        times = np.tile(t, len(items))
        gaps = self.gaps_at(every, centres.reshape(3, -1), times).reshape(len(items), -1)
        if self.landings_of_body is None:
            gaps[falls & (x[2] < self.over_below(items[:, None], self.lowest_at([x], [t])) - TINY_M)] = np.inf
            gaps[self.rim, self.in_bin(self.beside_bin(y, t))] = np.inf
        return gaps

    def gaps_at(self, item: Index, x: Array, t: Array) -> Array:
        """Returns the distances (k,) [m] of a sphere's surface at `x` (3, k) from obstacle `item[i]` at `t[i]`.

        Beyond the clearance required of each.
        """
        apart = x - self.nearest(item, x, t)
        return np.sqrt(dot(apart, apart)) - self.thickness[item]


def is_falling(x: Array) -> Mask:
    """Returns at which of successive centres (3, n) a flight falls."""
    return np.append(np.diff(x[2]) < 0.0, True)


@lru_cache(maxsize=1)  # for the checks of one motion
def flights_of(motion: MotionSamples) -> Flights:
    """Returns the flights of a motion."""
    return Flights(motion)


def segment_gap(start: Array, end: Array, shape: Array) -> float:
    """Returns the distance of a segment from a shape [m], which is convex along it; to 1e-6 of its length.

    Args:
        start, end: of the segment (3,) [m].
        shape: as of `Solid.row` (20,).
    """
    low, high = 0.0, 1.0
    gaps = np.empty(0)
    for _ in range(ROUNDS_ALONG):
        share = np.linspace(low, high, POINTS_ALONG)
        p = start[:, None] + share * (end - start)[:, None]
        gaps = np.linalg.norm(p - nearest_on_cores(p, shape[:, None]), axis=0) - shape[19]
        least = int(gaps.argmin())
        low, high = share[max(least - 1, 0)], share[min(least + 1, len(share) - 1)]
    return float(gaps.min())


def nearest_on_segments(x: Array, start: Array, end: Array) -> Array:
    """Returns the points (3, ...) of segments that are nearest to `x` (3, ...)."""
    along = end - start
    share = dot(x - start, along) / np.maximum(dot(along, along), TINY_M**2)
    return start + np.minimum(np.maximum(share, 0.0), 1.0) * along
