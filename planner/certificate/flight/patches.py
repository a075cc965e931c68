"""Lower bounds on the object's distance from what it can meet, over patches of flights.

A patch is an interval of release times and an interval of times. The surface x(r, t) deviates from the bilinear
interpolation of its four corners by at most sup|x_rr| dr^2/8 + sup|x_tt| dt^2/8. From the nearest point of a convex
obstacle to the patch's centre, in the direction n to the centre, the distance of a point is at least n . (x - nearest):
linear, so its least value over the interpolation is at a corner. For a link of the moving arm, x is taken in the frame
of the link.

With s = t - r, bounds A and J on the tool's acceleration and jerk over the releases, and V on the object's speed,

    x_tt = -g - k |x_t| x_t,  |x_tt| <= g + k V^2
    x_rr = j s - (a - x_tt)                                              without drag,
    |x_rr| <= 3 A + g + k V^2 + J s + k A^2 s^2                          with drag: the flight's velocity depends on the
                                                                         release's without growth, d|w|/dt <= 0
    |y_tt| <= |x_tt| + 2 W V + (A_L + W^2) l                             in the frame of a link

where W and A_L are sums of |qd| and |qdd| of the joints that move the link, and l bounds the distance of the object
from their axes. Source: repeated differentiation, as in `bounds`.

A point at the distance a from the centre of a body moves beside that by a u. With bounds W and B on the tool's angular
velocity and acceleration, F on the body's angular velocity in flight and g(s) of `planner.spin.growth`: |u_t| <= F,
|u_tt| <= (1 + 1/sqrt(3)) F^2, as no coefficient of Euler's equations exceeds 1, and |u_r| <= (B + W^2) g(s), as in
`planner.certificate.touchdown`. By that, u deviates from what is between two releases by at most |u_r| dr/2.
Of a round body the axis u turns about its momentum with a constant rate P: |u_tt| <= k W^2, with the largest moment
over that across the axis k, or 1. With J bounding the rate of the tool's angular acceleration, |P_r| <= P1 := k (B +
W^2) and |P_rr| <= P2 := k (J + 4 B W + W^3), so that |u_rr| <= P1 + P2 s + (P1 s)^2: the least of both bounds counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Index, Mask
from planner.cell import nearest_on_cores
from planner.certificate.bounds import joint_rates
from planner.certificate.flight.flights import TINY_M, Flights
from planner.certificate.flight.separation import mean
from planner.certificate.flight.shapes import BallPatches, core_gaps
from planner.kinematics import dot
from planner.native import loops
from planner.spin import fastest_turn, growth, round_axis, spin_ratio


class Patches(NamedTuple):
    """k patches, each with the obstacle it is compared with.

    Attributes:
        item: number of the obstacle (k,).
        r0, r1: interval of release times (k,) [s].
        t0, t1: interval of times (k,) [s].
        w, a: sums of the joint speeds and accelerations that move the obstacle, at most (k,) [rad/s, rad/s^2].
        allowed_m: the least gap that is no fault (k,) [m].
    """

    item: Index
    r0: Array
    r1: Array
    t0: Array
    t1: Array
    w: Array
    a: Array
    allowed_m: Array

    def keep(self, chosen: Mask | Index) -> Patches:
        """Returns the `chosen` patches."""
        return Patches._make(values[chosen] for values in self)

    def parts(self, with_spread: bool) -> Patches:
        """Returns the parts of every patch: both halves in time, and with a spread both halves of each of them."""
        middle = 0.5 * (self.t0 + self.t1)
        parts = [self._replace(t1=middle), self._replace(t0=middle)]
        if with_spread:
            middle = 0.5 * (self.r0 + self.r1)
            parts = [half for part in parts for half in (part._replace(r1=middle), part._replace(r0=middle))]
        return Patches._make(np.concatenate(values) for values in zip(*parts, strict=True))


class Evaluated(NamedTuple):
    """Patches evaluated.

    Attributes:
        lower: lower bounds on the gap (k,) [m]; infinite where no flight is in the patch.
        sampled: gaps at the corners (4, k) [m]; infinite where the object is not in flight.
        r, t: of the corners (4, k) [s].
    """

    lower: Array
    sampled: Array
    r: Array
    t: Array


@dataclass(frozen=True, eq=False)
class PatchBounds:
    """Bounds on the derivatives of the flights, and the lower bounds that follow from them.

    Attributes:
        flights: the flights.
        height: of the centre at which the flights end [m], as of `Flights.end`.
        first_speed: bound on the object's speed at the release [m/s].
        tool: bounds on acceleration and jerk of the tool over the releases, as they count [m/s^2, m/s^3].
        spacing_s: largest interval of release times [s].
        spin: bounds on the rotation of a body.
        away_m: distance of a ball of it from its centre [m].
    """

    flights: Flights
    height: float
    first_speed: float
    tool: tuple[float, float]
    spacing_s: float
    spin: SpinBounds
    away_m: float = 0.0

    def of_ball(self, place_m: float) -> PatchBounds:
        """Returns the bounds of a ball of the body at a place along its axis [m]."""
        return replace(self, away_m=abs(place_m))

    @property
    def _is_on_axis(self) -> bool:
        """Whether the point is the centre of a ball of the hull, on the axis of a body that may be round."""
        return self.away_m <= self.flights.reach_m

    @property
    def gravity(self) -> float:
        """Gravity [m/s^2]."""
        return self.flights.motion.problem.gravity

    @property
    def drag(self) -> float:
        """Drag constant of the object [1/m]."""
        return self.flights.motion.problem.drag

    def speed(self, s: Array) -> Array:
        """Returns bounds [m/s] on the object's speed up to `s` [s] before or after the release."""
        return self.first_speed + (self.gravity + self.drag * self.first_speed**2) * s + self.away_m * self.spin.rate

    def time_bend(self, s: Array, h: Array) -> Array:
        """Returns bounds [m] on the deviation of a flight within `h` [s], up to `s` [s] from the release."""
        bend = self.spin.axis_turn if self._is_on_axis else self.spin.bend
        return (self.gravity + self.drag * self.speed(s) ** 2 + self.away_m * bend) * (h * h / 8.0)

    def release_bend(self, s: Array, h: Array) -> Array:
        """Returns bounds [m] on the deviation of flights between releases `h` [s] apart, up to `s` [s] from them.

        Without drag x = p + f v s - g s^2/2 with s = t - r, and its second derivative by r is (1 - 2f) a + f j s - g.
        """
        (a, j) = self.tool
        drag = self.drag
        most = a + self.gravity + j * s
        if drag > 0.0:
            # Before the release a flight is a parabola whose acceleration depends on the release's velocity.
            v = self.speed(s)
            most = most + 2.0 * a + drag * (v * v + a * a * s * s + 4.0 * v * a * s + (a * a + v * j) * s * s)
        if self.away_m == 0.0:
            return most * (h * h / 8.0)
        turned = self.spin.growing * self.spin.grown(np.asarray(s)) * (h / 2.0)
        if self._is_on_axis:
            bend = np.where(h > 0.0, self.spin.axis_bend(s), 0.0)  # of bodies that are not round there is no bound
            turned = np.minimum(turned, bend * (h * h / 8.0))
        return most * (h * h / 8.0) + self.away_m * turned

    def bend(self, s: Array, dr: Array, h: Array) -> Array:
        """Returns how far flights deviate over intervals of releases `dr` and of time `h`, up to `s` after them [m]."""
        return self.release_bend(s, dr) + self.time_bend(s, h)

    def apexes(self, r: Array, v: Array) -> Array:
        """Returns times [s] from which flights released at `r` with velocities `v` (3, ...) surely fall."""
        slack = self.tool[1] * self.spacing_s**2 / 8.0
        return r + np.maximum(v[2] + slack, 0.0) / self.gravity

    @cached_property
    def reach(self) -> Array:
        """Largest distance of the origins of the joints before each frame from that of the base (7,) [m]."""
        robot = self.flights.motion.problem.cell.robot
        steps = np.cumsum(np.hypot(robot.a, robot.d))
        return np.concatenate([[0.0, 0.0], steps[:-1]])

    def turn_bend(self, far: Array, s: Array, frame: Index, rates: tuple[Array, Array], h: Array) -> Array:
        """Returns what the turning of a link adds to the deviation [m] of a flight in the link's frame.

        Args:
            far: distance of the object from the origin of the base, at most [m].
            s: time from the release, at most [s].
            frame: of the link.
            rates: sums of the joint speeds and accelerations that move it.
            h: interval of time [s].
        """
        w, a = rates
        return (2.0 * w * self.speed(s) + (a + w * w) * (far + self.reach[frame])) * (h * h / 8.0)

    def evaluate(self, patches: Patches) -> Evaluated:
        """Returns bounds and samples of patches."""
        flights = self.flights
        (item, r0, r1, t0, t1, *_) = patches
        r = np.stack([r0, r0, r1, r1])
        t = np.stack([t0, t1, t0, t1])
        released = flights.releases(np.concatenate([r0, r1]))
        p, v = (np.repeat(state.reshape(3, 2, -1), 2, axis=1) for state in released)
        corners = flights.flown(p, v, t - r)
        apexes = self.apexes(r, v)
        falling = t0 >= apexes.max(axis=0)
        s = np.maximum(t1 - r0, r1 - t0)
        h = t1 - t0
        across = self.release_bend(s, r1 - r0)
        bend = across + self.time_bend(s, h)
        fallen = t >= apexes
        end = flights.over_below(item, flights.lowest_at(_corners(corners), list(t), bend))
        over = falling & (corners[2, ::2].max(axis=0) + across < end)
        ended = fallen & (corners[2] < flights.over_below(item, flights.lowest_at([corners], [t])))
        bounds = []
        gaps = []
        places, lowest = flights.places(corners, r, t)
        below = None
        landings = flights.landings_of_body
        if landings is not None and lowest is not None:
            farthest = self.of_ball(landings.thing.outer_radius_m)
            below = lowest.min(axis=0) - farthest.release_bend(s, r1 - r0) - farthest.time_bend(s, h)
            carries = flights.carriers[item]
            over = landings.spans(r0, r1).is_over(carries, t0, t1)
            ended = landings.spans(r.ravel(), r.ravel()).is_over(np.tile(carries, 4), t.ravel(), t.ravel())
            ended = ended.reshape(t.shape)
        for place_m, y in zip(flights.balls_m, places, strict=True):
            ball = self.of_ball(place_m)
            ball_bend = bend if place_m == 0.0 else ball.bend(s, r1 - r0, h)
            seen = BallPatches(_corners(corners), list(t), bend, _corners(y), ball_bend, falling, below)
            lower, sampled = ball._seen(patches, seen, (corners, y, lowest), t, fallen)
            is_over, is_ended = over, ended
            if landings is None:
                beside = flights.beside_bin(y, t)
                is_over = over | ((item == flights.rim) & falling & self.all_in_bin(_corners(beside), ball_bend))
                is_ended = ended | fallen & (item == flights.rim) & flights.in_bin(beside)
            bounds.append(np.where(is_over | (t1 <= r0), np.inf, lower))
            gaps.append(np.where(is_ended | (t < r), np.inf, sampled - flights.thickness[item]))
        return Evaluated(np.min(bounds, axis=0), np.min(gaps, axis=0), r, t)

    def _seen(
        self, patches: Patches, seen: BallPatches, centres: tuple[Array, Array, Array | None], t: Array, fallen: Mask
    ) -> tuple[Array, Array]:
        """Returns lower bounds (k,) on the gaps of a ball over patches, and distances (4, k) of their corners.

        Args:
            patches: the patches.
            seen: the same of the ball.
            centres: of the object and of the ball at the corners (3, 4, k), and heights of the lowest points of a body
                there (4, k) [m].
            t: times of the corners (4, k) [s].
            fallen: which of these are beyond the apex (4, k).
        """
        flights = self.flights
        (item, r0, r1, t0, t1, *rates) = patches
        corners, y, lowest = centres
        s = np.maximum(t1 - r0, r1 - t0)
        far = self.distance_from_base(y).max(axis=0) + seen.ball_bend
        turned = self.turn_bend(far, s, self.frames(item), (rates[0], rates[1]), t1 - t0)
        bound, sampled = self._distances(item, y, t)
        lower = bound - seen.ball_bend - np.where(self.is_capsule(item), turned, 0.0)
        if (is_shape := item < flights.count).any():
            x = corners[:, :, is_shape]
            met = item[is_shape]
            lower[is_shape] = core_gaps(flights, seen.at(is_shape), met)
            lies = flights.lies(x, t[:, is_shape], fallen[:, is_shape])
            x = np.where(lies, flights.lying_at(x), y[:, :, is_shape]) if lies.any() else y[:, :, is_shape]
            sampled[:, is_shape] = _length(x - nearest_on_cores(x, flights.shapes[:, None, met]))
            if lowest is not None:
                above = lowest[:, is_shape] + flights.radius_m - flights.tops[met]
                sampled[:, is_shape] = np.maximum(sampled[:, is_shape], above)
        return lower - flights.thickness[item], sampled

    def is_capsule(self, item: Index) -> Mask:
        """Returns whether obstacles are capsules of arm or tool."""
        return (item >= self.flights.count) & (item < self.flights.rim)

    def frames(self, item: Index) -> Index:
        """Returns the frames in which the obstacles are at rest; 0 for shapes and bins."""
        capsule = np.where(self.is_capsule(item), item - self.flights.count, 0)
        return np.where(self.is_capsule(item), self.flights.motion.body.frames[capsule], 0)

    def _distances(self, item: Index, corners: Array, t: Array) -> tuple[Array, Array]:
        """Returns lower bounds (k,) on the distances of patches from obstacles, and distances (4, k) of corners.

        Shapes are left out (NaN): beside them an object may lie, see `core_gaps`.

        Args:
            item: numbers of the obstacles (k,).
            corners: of the patches (3, 4, k) [m].
            t: their times (4, k) [s].
        """
        flights, count = self.flights, self.flights.count
        is_rim = item == flights.rim
        is_capsule = self.is_capsule(item)
        bound = np.full(len(item), np.nan)
        sampled = np.full(t.shape, np.nan)
        if is_rim.any():
            x = flights.beside_bin(corners[:, :, is_rim], t[:, is_rim])
            bound[is_rim] = self.wall_bound(_corners(x))
            sampled[:, is_rim] = _length(x - flights.nearest_on_wall(x))
        if is_capsule.any():
            body = flights.motion.body
            capsule = item[is_capsule] - count
            poses = flights.motion.distinct_poses(t[:2, is_capsule])
            found = loops.patch_distances(poses, (body.frames[capsule], body.ends[capsule]), corners[:, :, is_capsule])
            bound[is_capsule] = found[0]
            sampled[:, is_capsule] = found[1:]
        return bound, sampled

    def distance_from_base(self, x: Array) -> Array:
        """Returns the distances (...) [m] of points (3, ...) from the origin of the base."""
        origin = self.flights.motion.problem.cell.X_WB[:3, 3]
        return _length(x - origin.reshape(3, *[1] * (x.ndim - 1)))

    def all_in_bin(self, corners: list[Array], bend: Array) -> Mask:
        """Returns whether patches with `corners` (3, ...) are within the bin's wall and below its mouth."""
        within, above = zip(*(self.flights.from_mouth(corner) for corner in corners), strict=True)
        return (np.min(within, axis=0) > bend) & (np.max(above, axis=0) + bend < 0.0)

    def wall_bound(self, corners: list[Array]) -> Array:
        """Returns lower bounds (...) [m] on the distance of patches with `corners` (3, ...) from the bin's wall.

        In the half plane of the distance rho from the axis and the height, the wall is a segment. In an outward
        direction rho is at least the horizontal coordinate in the centre's direction, which is linear; in an inward
        one -rho is concave: either is least at a corner.
        """
        centre = mean(corners)
        near = self.flights.nearest_on_wall(centre)
        axis = self.flights.axis.reshape(2, *[1] * (centre.ndim - 1))
        out = near[:2] - axis
        radius = np.hypot(*out)
        out = out / radius
        along = (out * (centre - near)[:2]).sum(axis=0)
        height = centre[2] - near[2]
        length = np.maximum(np.hypot(along, height), TINY_M)
        least = []
        for corner in corners:
            from_axis = corner[:2] - axis
            rho = np.where(along > 0.0, (out * from_axis).sum(axis=0), np.hypot(*from_axis))
            least.append(along * (rho - radius) + height * (corner[2] - near[2]))
        return np.min(least, axis=0) / length


class SpinBounds(NamedTuple):
    """Bounds on how a body turns, see the module: of a ball none.

    Attributes:
        inertia: its moments (3,) [kg m^2].
        turning: bound W on the tool's angular velocity [rad/s].
        rate: of |u_t| [rad/s].
        bend: of |u_tt| [rad/s^2].
        axis_turn: of |u_tt| of the axis of the hull [rad/s^2].
        growing: B + W^2 [rad/s^2].
        first, second: P1 [rad/s^2] and P2 [rad/s^3]; infinite where the hull is not along the axis of a round body.
    """

    inertia: Array
    turning: float = 0.0
    rate: float = 0.0
    bend: float = 0.0
    axis_turn: float = 0.0
    growing: float = 0.0
    first: float = math.inf
    second: float = math.inf

    def grown(self, s: Array) -> Array:
        """Returns bounds (...) [s] on `planner.spin.growth` up to times (...) [s], which is convex, and 0 at first."""
        most = float(s.max(initial=0.0))
        return s * (growth(self.inertia, self.turning, most) / most) if most > 0.0 else np.zeros_like(s)

    def axis_bend(self, s: Array) -> Array:
        """Returns bounds (...) [rad/s^2] on |u_rr| of the axis of a round body up to times (...) [s]."""
        return self.first + self.second * s + (self.first * s) ** 2


def spin_bounds(flights: Flights) -> SpinBounds:
    """Returns bounds on the rotation after any release of the spread."""
    motion = flights.motion
    thing = motion.problem.body
    if thing is None:
        return SpinBounds(np.ones(3))
    last = len(motion.trajectory.q) - 1
    rate = motion.trajectory.sample_rate_hz
    first = min(round(motion.gone_from_s * rate), last - 1)
    end = max(min(last, round(motion.held_until_s * rate)), first + 1)
    w, a, j = joint_rates(motion.trajectory, np.array([first, end])).sums[:, -1, 0].tolist()
    # Of the angular velocity's derivatives: each axis is turned by the joints before it.
    jerk = j + 2.0 * a * w + w**3
    a += 0.5 * w * w
    inertia = thing.inertia_kg_m2
    most = fastest_turn(inertia, w)
    bend = (1.0 + 1.0 / math.sqrt(3.0)) * most**2
    bounds = SpinBounds(inertia, w, most, bend, bend, a + w * w)
    axis = round_axis(inertia)
    if axis is None or not thing.hull_axis_O[axis]:
        return bounds
    k = max(1.0, spin_ratio(inertia, axis))
    return bounds._replace(axis_turn=k * w * w, first=k * (a + w * w), second=k * (jerk + 4.0 * a * w + w**3))


def patch_bounds(flights: Flights, height: float, spacing_s: float, v: Array) -> PatchBounds:
    """Returns the bounds of flights with release velocities `v` (3, m) at releases at most `spacing_s` apart."""
    motion = flights.motion
    tool = (0.0, 0.0)
    if flights.spread_s > 0.0:
        rate = motion.trajectory.sample_rate_hz
        ticks = np.array([round(t * rate) for t in (motion.gone_from_s, motion.held_until_s)])
        rates = joint_rates(motion.trajectory, ticks)
        _, a, j, _ = (motion.body.tool_lever @ rates.by_derivative)[:, 0].tolist()
        most = max(1.0, 2.0 * motion.problem.release_speed_factor - 1.0)  # no less than f and |1 - 2f|
        tool = most * a, most * j
    first = math.sqrt(float(dot(v, v).max())) + tool[1] * spacing_s**2 / 8.0
    return PatchBounds(flights, height, first, tool, spacing_s, spin_bounds(flights))


def corners_on_grid(x: Array) -> list[Array]:
    """Returns the corners of patches, (..., m, n) each, of values (..., m + 1, n + 1) or (..., 1, n + 1)."""
    if x.shape[-2] == 1:
        return [x[..., :-1], x[..., 1:]]
    return [x[..., :-1, :-1], x[..., :-1, 1:], x[..., 1:, :-1], x[..., 1:, 1:]]


def _corners(stacked: Array) -> list[Array]:
    """Returns the corners (3, k) of an array (3, c, k)."""
    return list(stacked.swapaxes(0, 1))


def _length(apart: Array) -> Array:
    """Returns the lengths (...) of vectors (3, ...)."""
    return np.sqrt(dot(apart, apart))
