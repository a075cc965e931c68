"""The world around the arm: objects in flight and their landings; all releases and landings are recorded.

A ball lands where its centre comes down through a plane: that of `sim.landing_height_m`, the floor, the bottom of a
bin, or the level top of a keep-out shape that it touched. A body that is no ball turns free of torque as it flies, and
lands where its lowest point comes down to the floor, a bin's bottom or a level top, or its centre through the plane of
`sim.landing_height_m`, where nothing is; it does not bounce. All else of shapes and bins stops both (`obstacles`), a
body where the balls of its hull touch it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from planner.cell import Cell, ThrownBody
from planner.flight import drag_constant
from planner.geometry import LEVEL_M
from simulator.physics.camera import ObservingCamera
from simulator.physics.obstacles import BIN, Contact, Obstacle, Point, RoundBin, SolidShape
from simulator.physics.turning import Turning, TurningBody
from simulator.truth import Truth

BOUNCES_MAX = 20  # a bouncing object is at rest after this many
BOUNCE_SPEED_MIN = 0.1  # [m/s] vertical speed below which an object does not bounce any more
RECORDS_MAX = 10000  # releases kept, and landings kept
FALL_MAX_M = 50.0  # [m] an object this far below every surface is forgotten
BISECTIONS = 40  # of the contact time; a cycle divided by 2^40 is far below rounding
CLEAR_OF_PLANE_M = 1e-9  # [m] height above the plane at which a bouncing object starts again
CONTACT_M = 1e-4  # [m] gap that counts as contact; far below any landing error, and bounds the steps past an obstacle

State = tuple[float, ...]  # x y z vx vy vz in the world [m, m/s]

NO_OTHERS: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class Plane:
    """A horizontal plane on which objects land; a body passes one where nothing is with its centre."""

    name: str
    z_m: float
    is_solid: bool = True


class Attitude(NamedTuple):
    """How an object leaves: pose of the tool in the world, and its angular velocity (3,) there [rad/s]."""

    tool: Sequence[float]
    spin: Sequence[float]


UPRIGHT = Attitude((1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0))


@dataclass
class FlyingObject:
    """One object in the air.

    Attributes:
        number, throw: its own, and that of its throw.
        state: where it is and how it moves.
        turning: how it is turned, and turns; None of a ball.
        bounces: number of its bounces so far.
        caught: what it touched, if it was caught.
        gripper: name of the gripper that let it go; empty: the cell's own.
    """

    number: int
    state: State
    turning: Turning | None = None
    throw: int = 0
    bounces: int = 0
    caught: Contact | None = None
    gripper: str = ""


class World:
    """Objects, obstacles and gravity: everything that is not the robot.

    Attributes:
        placed: the bin in the world, None without one.
        bin: the same, as it stands at the time that is looked at.
        throw: number of the throw that was announced last; objects released from then on belong to it.
        observations: what the camera reports of the landings.
    """

    def __init__(self, cell: Cell, restitution: float, truth: Truth) -> None:
        self.gravity = cell.surroundings.gravity_m_s2
        thrown = cell.object
        self.hull = thrown
        self.body = TurningBody(thrown) if isinstance(thrown, ThrownBody) else None
        self.drag = drag_constant(truth.mass_kg, thrown.drag_radius_m, truth.drag_coefficient)
        self.further = {  # drag and radius of the balls of further grippers
            name: (drag_constant(ball.mass_kg, ball.drag_radius_m, ball.drag_coefficient), ball.radius_m)
            for name, ball in ((name, each.object) for name, each in cell.grippers.items() if name)
        }
        self.camera = ObservingCamera(truth.camera, truth.seed)
        self.throw = 0
        self.observations: list[dict[str, Any]] = []
        self.radius_m = thrown.radius_m
        self.restitution = restitution
        self.floor_z_m = cell.surroundings.floor_z_m
        shapes = enumerate(cell.surroundings.keep_out)
        self.shapes = [SolidShape(f"keep_out[{i}]", shape) for i, shape in shapes]
        self.placed: RoundBin | None = None
        self.bin: RoundBin | None = None
        self.belt = truth.belt
        self.usual_landing_z_m = cell.sim.landing_height_m
        self.planes: list[Plane] = []
        self.planes_of: dict[str, list[Plane]] = {}
        self.expect_throw(self.usual_landing_z_m)
        self.flights: list[FlyingObject] = []
        self.releases: list[dict[str, Any]] = []
        self.landings: list[dict[str, Any]] = []

    def expect_throw(self, landing_z_m: float, of_each: Mapping[str, float] = NO_OTHERS) -> int:
        """Returns the number of the throw that comes next; its objects land on the plane at `landing_z_m` [m].

        Those of the grippers `of_each` on planes of their own [m].
        """
        self.planes = self._floor_and(landing_z_m)
        self.planes_of = {name: self._floor_and(z_m) for name, z_m in of_each.items()}
        self.throw += 1
        return self.throw

    def _floor_and(self, landing_z_m: float) -> list[Plane]:
        return [Plane("floor", self.floor_z_m), Plane("landing plane", landing_z_m, is_solid=False)]

    def release(
        self,
        number: int,
        at_s: float,
        state: State,
        now_s: float,
        attitude: Attitude = UPRIGHT,
        gripper: str = "",
    ) -> None:
        """Releases object `number` with state and attitude at `at_s` [s], and advances its flight to `now_s` [s]."""
        record = {"object": number, "throw": self.throw, "t": at_s}
        record |= {"position_m": list(state[:3]), "velocity_m_s": list(state[3:])}
        turning = None
        if self.body is not None:
            turning = self.body.leaving(np.reshape(attitude.tool, (3, 4))[:, :3], attitude.spin)
        flight = FlyingObject(number, state, turning, self.throw, gripper=gripper)
        record |= {**self._axis(flight), **self._from(flight)}
        self.releases.append(record)
        del self.releases[:-RECORDS_MAX]
        self.flights.append(flight)
        self._fly(flight, at_s, now_s - at_s)

    def cycle(self, t: float, dt: float) -> None:
        """Moves every object from `t` - `dt` to `t` [s]."""
        for flight in list(self.flights):
            self._fly(flight, t - dt, dt)

    def solid_at(self, point: Point) -> bool:
        """Whether a point in the world lies in the floor or in a keep-out shape."""
        return point[2] <= self.floor_z_m or any(shape.holds(point) for shape in self.shapes)

    def _fly(self, flight: FlyingObject, start: float, duration: float) -> None:
        """Advances a flight by `duration` [s], contact by contact."""
        end = start + duration
        while flight in self.flights and start < end:
            self._move_bin(0.5 * (start + end))
            reached = self._reached(flight, end - start)
            until = end - start if reached is None else reached[0]
            touched = self._first_contact(flight, until)
            passed = until if touched is None else touched[0]
            start += passed
            flight.turning = self._turned(flight, passed)
            flight.state = self._after(flight, passed)
            if touched is not None:
                self._touch(flight, self._contact(flight, touched[1]), start)
            elif reached is not None:
                self._land(flight, reached[1], start)
            elif flight.state[2] < min(p.z_m for p in self._planes_below(flight)) - FALL_MAX_M:
                self.flights.remove(flight)

    def place_bin(self, placed: RoundBin | None) -> None:
        """Puts a bin into the world, in place of the one there; a belt of the truth carries it, whatever was told."""
        if placed is not None and self.belt is not None:
            belt = self.belt
            placed = replace(placed, bottom=belt.position_m, velocity=belt.velocity_m_s, at_s=belt.at_s)
        self.placed = placed
        self.bin = placed

    def _move_bin(self, t: float) -> None:
        """Looks at the bin as it stands at a time: in the middle of a cycle, in which it moves by half a millimetre."""
        self.bin = None if self.placed is None else self.placed.at(t)

    def _after(self, flight: FlyingObject, duration: float) -> State:
        drag, _ = self.further.get(flight.gripper, (self.drag, self.radius_m))
        return step(flight.state, duration, self.gravity, drag)

    def _from(self, flight: FlyingObject) -> dict[str, str]:
        """Returns what a record tells of the gripper that let an object go: of the cell's own nothing."""
        return {"gripper": flight.gripper} if flight.gripper else {}

    def _planes_below(self, flight: FlyingObject) -> list[Plane]:
        """Returns floor and landing plane of an object."""
        return self.planes_of.get(flight.gripper, self.planes)

    def _reached(self, flight: FlyingObject, duration: float) -> tuple[float, Plane] | None:
        """Returns time [s] and plane of the first plane that an object comes down through within `duration`."""
        met = []
        for plane in self._planes(flight):
            if self._height(flight, 0.0, plane) >= plane.z_m >= self._height(flight, duration, plane):
                met.append((self._crossing(flight, duration, plane), plane))
        for passed, plane in sorted(met, key=lambda each: (each[0], -each[1].z_m)):
            if self.bin is None or plane.name != BIN or self.bin.spans(self._after(flight, passed)):
                return passed, plane
        return None

    def _planes(self, flight: FlyingObject) -> list[Plane]:
        """Returns the planes on which an object can land; a caught one has only its own, one in a bin the bottom."""
        if flight.caught is not None and flight.caught.lies_at_z_m is not None:
            return [Plane(flight.caught.name, flight.caught.lies_at_z_m)]
        planes = self._planes_below(flight)
        if self.bin is None:
            return planes
        bottom = Plane(BIN, self.bin.bottom[2])
        return [bottom] if self.bin.encloses(flight.state) else [bottom, *planes]

    def _crossing(self, flight: FlyingObject, duration: float, plane: Plane) -> float:
        """Returns the time until an object comes down through the plane [s], by bisection."""
        low = 0.0
        high = duration
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            if self._height(flight, middle, plane) > plane.z_m:
                low = middle
            else:
                high = middle
        return high

    def _height(self, flight: FlyingObject, later_s: float, plane: Plane) -> float:
        """Returns the height [m] of what comes down through a plane, `later_s` [s] from now."""
        z = self._after(flight, later_s)[2]
        turning = self._turned(flight, later_s) if plane.is_solid else None
        return z if self.body is None or turning is None else z - self.body.below(turning)

    def _turned(self, flight: FlyingObject, later_s: float) -> Turning | None:
        """Returns how an object turns `later_s` [s] from now; None of a ball."""
        if self.body is None or flight.turning is None:
            return None
        return self.body.after(flight.turning, later_s)

    def _first_contact(self, flight: FlyingObject, duration: float) -> tuple[float, Obstacle] | None:
        """Returns time [s] and obstacle of the first contact within `duration`, None where the way is free.

        The flight advances by what the nearest gap leaves free at its greatest speed, until the gap is closed. Where
        its centre is lower, the object lies on the floor or on what it touched, and goes on over it.
        """
        lies_on_z = self._carrier(flight)
        obstacles = self._obstacles(flight)
        if not obstacles:
            return None
        fastest = math.hypot(*flight.state[3:]) + self.gravity * duration
        if self.body is not None and flight.turning is not None:
            fastest += self.body.farthest_m * self.body.speed(flight.turning)
        _, radius_m = self.further.get(flight.gripper, (self.drag, self.radius_m))
        passed = 0.0
        while True:
            x, y, z = self._after(flight, passed)[:3]
            if self.body is None:
                p = (x, y, max(z, lies_on_z + radius_m))
                gaps = [(o.gap(p, radius_m), o) for o in obstacles]
            else:
                gaps = self._gaps_of_body(flight, obstacles, passed)
            gap, nearest = min(gaps, key=lambda pair: pair[0])
            if gap < CONTACT_M:
                return passed, nearest
            passed += gap / fastest
            if passed >= duration:
                return None

    def _gaps_of_body(
        self, flight: FlyingObject, obstacles: list[Obstacle], later_s: float
    ) -> list[tuple[float, Obstacle]]:
        """Returns the gap of a body to each obstacle [m], `later_s` [s] from now, with the obstacle.

        That of its hull; over a shape that of its lowest point, if that is larger.
        """
        assert self.body is not None
        turning = self._turned(flight, later_s)
        assert turning is not None
        x, y, z = self._after(flight, later_s)[:3]
        lowest = z - self.body.below(turning)
        balls = [(x + dx, y + dy, z + dz) for dx, dy, dz in self._balls(turning)]
        found: list[tuple[float, Obstacle]] = []
        for obstacle in obstacles:
            gap = min(obstacle.gap(p, self.radius_m) for p in balls)
            if isinstance(obstacle, SolidShape):
                gap = max(gap, lowest - obstacle.top_z)
            found.append((gap, obstacle))
        return found

    def _contact(self, flight: FlyingObject, met: Obstacle) -> Contact:
        """Returns what an object touches: a body comes down on a level top only with its lowest point."""
        contact = met.contact(flight.state[:3])
        if self.body is None or flight.turning is None or not isinstance(met, SolidShape):
            return contact
        lowest = flight.state[2] - self.body.below(flight.turning)
        return contact if lowest >= met.top_z - CONTACT_M else Contact(contact.name)

    def _balls(self, turning: Turning) -> list[Point]:
        """Returns the places of the balls of a body's hull from its centre [m]."""
        thing = self.hull
        if self.body is None or not isinstance(thing, ThrownBody):
            return [(0.0, 0.0, 0.0)]
        along = self.body.axes(turning) @ thing.hull_axis_O
        return [tuple((place * along).tolist()) for place in thing.balls_m]

    def _axis(self, flight: FlyingObject) -> dict[str, Any]:
        """Returns what a record tells of how an object lies in the air: of a ball nothing."""
        if self.body is None or flight.turning is None:
            return {}
        w, x, y, z = flight.turning.q
        return {"axis": self.body.axes(flight.turning)[:, 2].tolist(), "quaternion": [x, y, z, w]}

    def _obstacles(self, flight: FlyingObject) -> list[Obstacle]:
        """Returns what an object can touch: once it lies on something, what is higher, and a bin's wall outside it."""
        if flight.caught is None:
            return [*self.shapes, *self._bins()]
        if flight.caught.name == BIN or any(each.spans(flight.state) for each in self._bins()):
            return []
        level_z = self._carrier(flight) + LEVEL_M
        return [*(shape for shape in self.shapes if shape.top_z > level_z), *self._bins()]

    def _bins(self) -> list[RoundBin]:
        return [] if self.bin is None else [self.bin]

    def _carrier(self, flight: FlyingObject) -> float:
        """Returns the height [m] of what an object lies on, or of the floor below."""
        lies_at_z_m = None if flight.caught is None else flight.caught.lies_at_z_m
        return self.floor_z_m if lies_at_z_m is None else lies_at_z_m

    def _touch(self, flight: FlyingObject, contact: Contact, t: float) -> None:
        """Lets an object that touches an obstacle stop there, or fall to where it comes to lie."""
        if contact.lies_at_z_m is None:
            self._record(flight, contact.name, t)
            self.flights.remove(flight)
            return
        if self.body is not None and contact.slides:
            self._land(flight, Plane(contact.name, contact.lies_at_z_m), t)
            return
        flight.caught = contact
        if not contact.slides:
            x, y, z, _, _, vz = flight.state
            vx, vy, _ = self.bin.velocity if self.bin is not None and contact.name == BIN else (0.0, 0.0, 0.0)
            flight.state = (x, y, z, vx, vy, vz)

    def _land(self, flight: FlyingObject, plane: Plane, t: float) -> None:
        x, y, _, vx, vy, vz = flight.state
        flight.state = (x, y, plane.z_m, vx, vy, vz)
        self._record(flight, plane.name, t)
        up = -self.restitution * vz
        if self.body is not None or up < BOUNCE_SPEED_MIN or flight.bounces >= BOUNCES_MAX:
            self.flights.remove(flight)
            return
        flight.bounces += 1
        flight.state = (x, y, plane.z_m + CLEAR_OF_PLANE_M, vx, vy, up)

    def _record(self, flight: FlyingObject, surface: str, t: float) -> None:
        record = {
            "object": flight.number,
            "throw": flight.throw,
            "t": t,
            "position_m": list(flight.state[:3]),
            "velocity_m_s": list(flight.state[3:]),
            "surface": surface,
            "bounce": flight.bounces,
            **self._axis(flight),
            **self._from(flight),
        }
        self.landings.append(record)
        del self.landings[:-RECORDS_MAX]
        if flight.bounces == 0:
            seen = {"throw": flight.throw, **self.camera.observe(record), **self._from(flight)}
            self.observations.append(seen)
            del self.observations[:-RECORDS_MAX]


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
