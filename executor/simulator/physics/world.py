"""The world around the arm: objects in flight and their landings; all releases and landings are recorded.

An object is a point, its centre. It lands where its centre comes down through a surface: the plane of
`sim.landing_height_m`, the top of a keep-out box (a table, a bin), or the floor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from planner.cell import Cell
from planner.flight import drag_constant

BOUNCES_MAX = 20  # a bouncing object is at rest after this many
BOUNCE_SPEED_MIN = 0.1  # [m/s] vertical speed below which an object does not bounce any more
RECORDS_MAX = 10000  # releases kept, and landings kept
FALL_MAX_M = 50.0  # [m] an object this far below every surface is forgotten
BISECTIONS = 40  # of the contact time; a cycle divided by 2^40 is far below rounding
CLEAR_OF_SURFACE_M = 1e-9  # [m] height above the surface at which a bouncing object starts again

State = tuple[float, ...]  # x y z vx vy vz in the world [m, m/s]


@dataclass(frozen=True)
class Surface:
    """A horizontal surface: height and, for the top of a box, extent [m]."""

    name: str
    z_m: float
    lower: Sequence[float] = (-math.inf, -math.inf)
    upper: Sequence[float] = (math.inf, math.inf)

    def meets(self, x: float, y: float) -> bool:
        """Whether the point (x, y) lies above or below this surface."""
        return self.lower[0] <= x <= self.upper[0] and self.lower[1] <= y <= self.upper[1]


@dataclass
class FlyingObject:
    """One object in the air, with the number of its bounces so far."""

    number: int
    state: State
    bounces: int = 0


class World:
    """Objects, surfaces and gravity: everything that is not the robot."""

    def __init__(self, cell: Cell, restitution: float) -> None:
        self.gravity = cell.surroundings.gravity_m_s2
        thrown = cell.object
        self.drag = drag_constant(thrown.mass_kg, thrown.radius_m, thrown.drag_coefficient)
        self.restitution = restitution
        self.floor_z_m = cell.surroundings.floor_z_m
        self.boxes = [(box.lower.tolist(), box.upper.tolist()) for box in cell.surroundings.keep_out]
        self.surfaces = [Surface("landing plane", cell.sim.landing_height_m), Surface("floor", self.floor_z_m)]
        self.surfaces += [Surface(f"keep_out[{i}]", up[2], low, up) for i, (low, up) in enumerate(self.boxes)]
        self.flights: list[FlyingObject] = []
        self.releases: list[dict[str, Any]] = []
        self.landings: list[dict[str, Any]] = []

    def release(self, number: int, at_s: float, state: State, now_s: float) -> None:
        """Releases object `number` with `state` at `at_s` [s], and advances its flight to `now_s` [s]."""
        record = {"object": number, "t": at_s, "position_m": list(state[:3]), "velocity_m_s": list(state[3:])}
        self.releases.append(record)
        del self.releases[:-RECORDS_MAX]
        flight = FlyingObject(number, state)
        self.flights.append(flight)
        self._fly(flight, at_s, now_s - at_s)

    def cycle(self, t: float, dt: float) -> None:
        """Moves every object from `t` - `dt` to `t` [s]."""
        for flight in list(self.flights):
            self._fly(flight, t - dt, dt)

    def solid_at(self, point: tuple[float, float, float]) -> bool:
        """Whether a point in the world lies in the floor or in a keep-out box."""
        inside = [all(a <= p <= b for a, p, b in zip(lo, point, up, strict=True)) for lo, up in self.boxes]
        return point[2] <= self.floor_z_m or any(inside)

    def _fly(self, flight: FlyingObject, start: float, duration: float) -> None:
        """Advances a flight by `duration` [s], contact by contact."""
        end = start + duration
        while flight in self.flights and start < end:
            after = step(flight.state, end - start, self.gravity, self.drag)
            surface = self._hit(flight.state, after)
            if surface is None:
                flight.state = after
                if after[2] < min(s.z_m for s in self.surfaces) - FALL_MAX_M:
                    self.flights.remove(flight)
                return
            passed = self._crossing(flight.state, end - start, surface)
            start += passed
            flight.state = step(flight.state, passed, self.gravity, self.drag)
            self._touch(flight, surface, start)

    def _hit(self, before: State, after: State) -> Surface | None:
        """Returns the highest surface that the centre came down through."""
        met = [s for s in self.surfaces if before[2] > s.z_m >= after[2] and s.meets(after[0], after[1])]
        return max(met, key=lambda s: s.z_m, default=None)

    def _crossing(self, state: State, duration: float, surface: Surface) -> float:
        """Returns the time until the centre comes down through the surface [s], by bisection."""
        low, high = 0.0, duration
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            if step(state, middle, self.gravity, self.drag)[2] > surface.z_m:
                low = middle
            else:
                high = middle
        return high

    def _touch(self, flight: FlyingObject, surface: Surface, t: float) -> None:
        x, y, _, vx, vy, vz = flight.state
        record = {
            "object": flight.number,
            "t": t,
            "position_m": [x, y, surface.z_m],
            "velocity_m_s": [vx, vy, vz],
            "surface": surface.name,
            "bounce": flight.bounces,
        }
        self.landings.append(record)
        del self.landings[:-RECORDS_MAX]
        up = -self.restitution * vz
        if up < BOUNCE_SPEED_MIN or flight.bounces >= BOUNCES_MAX:
            self.flights.remove(flight)
            return
        flight.bounces += 1
        flight.state = (x, y, surface.z_m + CLEAR_OF_SURFACE_M, vx, vy, up)


def step(state: State, h: float, gravity: float, drag: float) -> State:
    """Returns the state after `h` [s]: exact without drag, else one Runge–Kutta step of fourth order."""
    x, y, z, vx, vy, vz = state
    if drag <= 0.0:
        return (x + vx * h, y + vy * h, z + vz * h - 0.5 * gravity * h * h, vx, vy, vz - gravity * h)
    k1 = _rate(state, gravity, drag)
    k2 = _rate([s + 0.5 * h * k for s, k in zip(state, k1, strict=True)], gravity, drag)
    k3 = _rate([s + 0.5 * h * k for s, k in zip(state, k2, strict=True)], gravity, drag)
    k4 = _rate([s + h * k for s, k in zip(state, k3, strict=True)], gravity, drag)
    return tuple(s + h / 6.0 * (a + 2.0 * b + 2.0 * c + d) for s, a, b, c, d in zip(state, k1, k2, k3, k4, strict=True))


def _rate(state: State | list[float], gravity: float, drag: float) -> tuple[float, ...]:
    _, _, _, vx, vy, vz = state
    k = drag * math.sqrt(vx * vx + vy * vy + vz * vz)
    return (vx, vy, vz, -k * vx, -k * vy, -gravity - k * vz)
