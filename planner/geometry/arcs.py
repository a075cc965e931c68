"""Drag-free flights of a sphere against shapes and the mouth of a bin, for many flights at once.

These steer the search; the certificate judges one flight with drag, arm and release window.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from planner.arrays import Array, Mask
from planner.cell import Solid
from planner.flight import time_of_flight
from planner.geometry.distances import segment_shape_distance
from planner.geometry.surfaces import Surface

INSTANTS = np.linspace(0.0, 1.0, 24)  # [-] compared with a shape while a flight passes the box that bounds it


@dataclass(frozen=True, eq=False)
class Arcs:
    """Flights p + v t - g t^2/2 e_z of a sphere, from the release until it touches the landing plane, or passes it.

    Attributes:
        p: positions of the centre at the release (..., 3) [m].
        v: velocities at the release (..., 3) [m/s].
        until_s: end of each flight (...,) [s].
        gravity: along -z [m/s^2].
        radius_m: of the sphere [m].
    """

    p: Array
    v: Array
    until_s: Array
    gravity: float
    radius_m: float

    @staticmethod
    def onto(p: Array, v: Array, plane_z: float, gravity: float, radius_m: float) -> Arcs:
        """Returns the flights that end where the sphere first touches the plane z = `plane_z` on its way down.

        A flight that starts closer to the plane ends where its centre passes the plane, at once if it never does.
        """
        touched = time_of_flight(p[..., 2] - plane_z - radius_m, v[..., 2], gravity)
        passed = time_of_flight(p[..., 2] - plane_z, v[..., 2], gravity)
        until_s = np.where(np.isnan(touched), passed, touched)
        return Arcs(p, v, np.nan_to_num(until_s), gravity, radius_m)

    def of(self, chosen: Mask) -> Arcs:
        """Returns the flights of a mask (...,)."""
        p = np.broadcast_to(self.p, self.v.shape)
        return replace(self, p=p[chosen], v=self.v[chosen], until_s=self.until_s[chosen])

    def until_landed(self, plane_z: float, surfaces: Sequence[Surface]) -> Arcs:
        """Returns the flights until the sphere touches a surface, or else until its centre passes the plane.

        At once where it never does.

        Args:
            plane_z: height of the plane [m].
            surfaces: on which it lands.
        """
        until_s = np.nan_to_num(time_of_flight(self.p[..., 2] - plane_z, self.v[..., 2], self.gravity))
        for surface in surfaces:
            height = self.p[..., 2] - surface.height_m - self.radius_m
            touched = np.nan_to_num(time_of_flight(height, self.v[..., 2], self.gravity), nan=np.inf)
            there = np.moveaxis(self.at(np.minimum(touched, until_s)), -1, 0)
            until_s = np.where((touched < until_s) & (surface.depth(there) >= 0.0), touched, until_s)
        return replace(self, until_s=until_s)

    def beside(self, v_W: Array, plane_z: float) -> Arcs:
        """Returns the flights as they are beside what moves at `v_W` (3,) [m/s], and is met on the plane.

        In its frame, in which it stands, a flight without drag is one too.
        """
        lands_s = np.nan_to_num(time_of_flight(self.p[..., 2] - plane_z, self.v[..., 2], self.gravity))
        return replace(self, p=self.p + lands_s[..., None] * v_W, v=self.v - v_W)

    def until_over(self, lower: Array, upper: Array) -> Arcs:
        """Returns the flights, those that end over a box until they come over it.

        Args:
            lower, upper: corners of the box (3,) [m].
        """
        begin = np.zeros_like(self.until_s)
        end = np.full_like(self.until_s, np.inf)
        for axis in (0, 1):
            enter, leave = self._between(axis, lower[axis], upper[axis])
            begin = np.maximum(begin, enter)
            end = np.minimum(end, leave)
        ends_over = (begin <= self.until_s) & (self.until_s <= end)
        return replace(self, until_s=np.where(ends_over, begin, self.until_s))

    def at(self, t: Array) -> Array:
        """Returns the centres (..., 3) [m] at times `t` (...,) [s]."""
        fall = 0.5 * self.gravity * t * t
        return self.p + self.v * t[..., None] - fall[..., None] * np.array([0.0, 0.0, 1.0])

    def height_at(self, t: Array) -> Array:
        """Returns the centres' heights (...,) [m] at times `t` (...,) [s]."""
        return self.p[..., 2] + self.v[..., 2] * t - 0.5 * self.gravity * t * t

    def room_beside_shape(self, shape: Solid, gap_m: float = 0.0, ground_z: float = -np.inf) -> Array:
        """Returns how far a shape the flights pass (...,) [m], beyond what is required.

        Of a box along the axes as `room_beside_box` does. Of another shape so do the flights that pass the box that
        bounds it; the others have the least distance found while they pass that.

        Args:
            shape: the shape.
            gap_m: required between sphere and shape [m].
            ground_z: height of the ground [m].
        """
        room = self.room_beside_box(shape.lower, shape.upper, gap_m, ground_z)
        near = room < 0.0
        if shape.core is None or not near.any():
            return room
        begin, end = (ends[near] for ends in self._over(shape.lower, shape.upper, self.radius_m + gap_m))
        x = self.of(near).at(begin + INSTANTS[:, None] * (end - begin))
        room[near] = segment_shape_distance(x, x, shape).min(axis=0) - self.radius_m - gap_m
        return room

    def _over(self, lower: Array, upper: Array, grown_m: float) -> tuple[Array, Array]:
        """Returns the times (...,) [s] between which the flights are over or under a box that is grown [m]."""
        begin = np.zeros_like(self.until_s)
        end = self.until_s
        for axis in (0, 1):
            enter, leave = self._between(axis, lower[axis] - grown_m, upper[axis] + grown_m)
            begin = np.maximum(begin, enter)
            end = np.minimum(end, leave)
        return begin, end

    def room_beside_box(self, lower: Array, upper: Array, gap_m: float = 0.0, ground_z: float = -np.inf) -> Array:
        """Returns how far above or below a box the flights pass (...,) [m], beyond what is required.

        Negative where they come too close: by so much they would have to be higher or lower. Infinite for flights past
        its sides. Exact for the box grown by radius and gap as a cube, so a flight past an edge or a corner may count
        as one that comes too close.

        Args:
            lower, upper: corners of the box (3,) [m].
            gap_m: required between sphere and box [m].
            ground_z: height of the ground [m]: no flight passes below a box under which there is no room above it.
        """
        grown = self.radius_m + gap_m
        begin, end = self._over(lower, upper, grown)
        crossed = begin <= end
        begin = np.where(crossed, begin, 0.0)
        end = np.where(crossed, end, 0.0)
        least = np.minimum(self.height_at(begin), self.height_at(end))
        most = self.height_at(np.clip(self.v[..., 2] / self.gravity, begin, end))
        room = least - (upper[2] + grown)
        if lower[2] - grown >= ground_z + self.radius_m:
            room = np.maximum(room, lower[2] - grown - most)
        return np.where(crossed, room, np.inf)

    def _between(self, axis: int, low: float, high: float) -> tuple[Array, Array]:
        """Returns the times (...,) [s] between which a coordinate is within [low, high]; empty if never."""
        p = self.p[..., axis]
        v = self.v[..., axis]
        moving = np.abs(v) > 1e-12
        speed = np.where(moving, v, 1.0)
        a = (low - p) / speed
        b = (high - p) / speed
        inside = (p >= low) & (p <= high)
        enter = np.where(moving, np.minimum(a, b), np.where(inside, -np.inf, np.inf))
        return enter, np.where(moving, np.maximum(a, b), np.where(inside, np.inf, -np.inf))

    def room_in_mouth(self, centre: Array, radius_m: float, rim_height_m: float) -> Array:
        """Returns the room (...,) [m] with which the flights enter a round bin through its mouth.

        Negative where they touch its wall or pass it by: by what they lack. Of those that do not rise to the mouth that
        is in height, or aside, where they are highest.

        The sphere passes the rim's edge at a distance r if its straight path there, at an angle d below the horizontal,
        crosses the mouth's plane r / sin d inside the edge. It must not start closer than r to rim or wall, nor below
        the rim inside.

        Args:
            centre: of the bin's bottom (3,) [m].
            radius_m: of the mouth [m].
            rim_height_m: height of the rim above the bottom [m].
        """
        rim = centre[2] + rim_height_m
        thick = self.radius_m
        height = self.p[..., 2] - rim
        down = time_of_flight(height, self.v[..., 2], self.gravity)
        enters = np.isfinite(down)
        down = np.where(enters, down, 0.0)
        inside = radius_m - thick / self._sine_of_descent(down) - self._from_axis(centre, down)
        apex = np.maximum(self.v[..., 2] / self.gravity, 0.0)
        below = np.minimum(self.height_at(apex) - rim, radius_m - self._from_axis(centre, apex)) - thick
        start = self._from_axis(centre, np.zeros_like(down)) - radius_m
        off_rim = np.hypot(start, np.maximum(height, 0.0)) - thick
        rising = 2.0 * self.v[..., 2] / self.gravity - down  # when it passes the rim's height on its way up
        outside = self._from_axis(centre, np.maximum(rising, 0.0)) - (radius_m + thick)
        room = np.minimum(np.where(enters, inside, below), off_rim)
        return np.where(height >= 0.0, room, np.minimum(room, outside))

    def _sine_of_descent(self, t: Array) -> Array:
        fall = np.maximum(self.gravity * t - self.v[..., 2], 1e-9)
        return fall / np.sqrt(fall**2 + self.v[..., 0] ** 2 + self.v[..., 1] ** 2)

    def _from_axis(self, centre: Array, t: Array) -> Array:
        x = self.at(t)
        return np.hypot(x[..., 0] - centre[0], x[..., 1] - centre[1])
