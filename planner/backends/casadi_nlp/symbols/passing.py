"""Rows of blocks "passing" and "standing": the braking arm, and what never moves of it, are clear of the flight.

The object's path follows from its position and velocity at the release, and from a polynomial, which is a parameter;
the time of the problem is 0 at the release.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from planner.backends.casadi_nlp import layout
from planner.backends.casadi_nlp.symbols import arm, distances
from planner.backends.casadi_nlp.symbols.stage import StageState, state, state_after, through
from planner.backends.casadi_nlp.symbols.terms import Terms

SX = Any
Given = dict[str, dict[str, SX]]  # pieces of the parameter vectors of `layout.SHARED` that a formula takes, by name

GUARD = 0.01  # [m^2/s^2] keeps the discriminant of a flight that never reaches the plane above zero
LANDING = 0.005  # [s] roundness of the end of a flight: the object stays where it lands
AT_REST_S = 0.03  # [s] before its standstill the arm is where it stays, within a millimetre or two: jerk is limited


def passing(z: SX, given: Given, terms: Terms) -> SX:
    """Room between the object in flight and the braking arm at a knot (1) [m]."""
    return _beside_path(state(z, given["scales"]), z, given, 0.0, terms)


def passing_middle(z: SX, given: Given, terms: Terms) -> SX:
    """The same in the middle of the step."""
    return _beside_path(through(state_after(z, given["scales"], 0.5), terms), z, given, 0.5, terms)


def _beside_path(s: StageState, z: SX, given: Given, share: float, terms: Terms) -> SX:
    """Returns the room between the arm after a share of the step and the object's path a quarter of it around [m]."""
    f = given["object_path"]
    scale = given["scales"]["time"]
    step = z[layout.STEP] * scale
    now = z[layout.TIME] * scale + share * step
    landing = _landing(z, f, terms)
    around = (_sooner(now + quarter * step, landing) for quarter in (-0.25, 0.25))
    times = terms.through(ca.vertcat(*around))
    first, last = (place(z, f["path"], times[i]) for i in range(2))
    gaps = [
        distances.segment_distance_at_moving_points(*ends, first, last, terms) - radius - f["reach"][i]
        for i, (ends, radius) in enumerate(_links_in_world(given["arm"], s))
    ]
    return distances.soft_minimum(gaps, terms) - f["fall"] * step**2 / 32


def passing_at_rest(z: SX, given: Given, terms: Terms) -> SX:
    """Room between the object's flight from `AT_REST_S` ago on and the arm as it is, the tool excepted (1) [m].

    Less what the path bends within a chord: 12 mm where the object flies on for a second.
    """
    f = given["object_path"]
    now = z[layout.TIME] * given["scales"]["time"]
    landing = _landing(z, f, terms)
    begin = terms.through(_sooner(now - AT_REST_S, landing))
    step = (landing - begin) / layout.CHORDS
    points = [place(z, f["path"], begin + i * step) for i in range(layout.CHORDS + 1)]
    links = _links_in_world(given["arm"], state(z, given["scales"]))
    gaps = [
        distances.chords_distance(*ends, points, terms) - radius - f["reach"][i]
        for i, (ends, radius) in enumerate(links)
    ]
    return distances.soft_minimum(gaps, terms) - f["fall"] * step**2 / 8


def standing(s: StageState, given: Given, terms: Terms) -> SX:
    """Room between the flight of an object that is released at a knot and what never moves of the arm (1) [m].

    The flight is taken without drag.
    """
    f = given["standing"]
    place, speed = map(terms.through, _leaving(s, given["arm"], f["share"]))
    without_drag, _ = flight_time(speed[2], place[2] - f["ground"], f["gravity"])
    landing = terms.through(without_drag)
    times = [i * landing / layout.CHORDS for i in range(layout.CHORDS + 1)]
    points = [place + time * speed - ca.vertcat(0, 0, f["gravity"] * time**2 / 2) for time in times]
    capsules = ca.horzsplit(ca.reshape(f["capsules"], 7, layout.STANDING_CAPSULES))
    gaps = [
        distances.chords_distance(c[:3], c[3:6], points, terms) - c[6] - f["reach"][i] for i, c in enumerate(capsules)
    ]
    return distances.soft_minimum(gaps, terms)


def _landing(z: SX, f: dict[str, SX], terms: Terms) -> SX:
    """Returns when the object's flight ends, after its release [s]."""
    without_drag, _ = flight_time(z[layout.SPEED][2], z[layout.PLACE][2] - f["ground"], f["gravity"])
    return terms.through(f["landing"] + f["lands"] * without_drag)


def flight_time(rise: SX, height: SX, gravity: SX) -> tuple[SX, SX]:
    """Returns when a flight without drag comes down to a plane [s], and its discriminant [m^2/s^2].

    Args:
        rise: vertical speed at the release [m/s].
        height: of the release above the plane [m].
        gravity: [m/s^2].
    """
    falls = rise**2 + 2 * gravity * height
    guarded = (falls + ca.sqrt(falls**2 + GUARD**2)) / 2
    # Where the object clearly falls, the error of the guard is negligible: GUARD^2 / (4 falls).
    return (rise + ca.sqrt(guarded)) / gravity, falls


def _sooner(time: SX, landing: SX) -> SX:
    """Returns the smooth minimum of two times [s]."""
    return (time + landing - ca.sqrt((time - landing) ** 2 + LANDING**2)) / 2


def thrown(z: SX, given: Given, terms: Terms) -> SX:
    """Position [m] and velocity [m/s] of the object in the world (6), where it is released after the stage's step."""
    s = through(state_after(z, given["scales"], 1.0), terms)
    return ca.vertcat(*_leaving(s, given["arm"], given["object_path"]["share"]))


def _leaving(s: StageState, a: dict[str, SX], share: SX) -> tuple[SX, SX]:
    """Returns position [m] and velocity [m/s] in the world (3,) of an object that has a share of the tool's speed."""
    tool = arm.tool_motion(a["dh"], a["tcp"], s.q, s.qd, s.qdd)
    R_WS = arm.world_axes(a["base"], s.q)
    return R_WS @ tool.position + a["base"][9:], share * (R_WS @ tool.velocity)


def carried(z: SX, given: Given, terms: Terms) -> SX:
    """The object's position and velocity at its release (6), which stay."""
    return ca.vertcat(z[layout.PLACE], z[layout.SPEED])


def place(z: SX, coefficients: SX, s: SX) -> SX:
    """Returns the object's place in the world (3,) [m] s after its release [s]."""
    return z[layout.PLACE] + s * z[layout.SPEED] + _path(coefficients, s)


def _path(coefficients: SX, s: SX) -> SX:
    """Returns a polynomial's value (3,) at s."""
    of_powers = ca.reshape(coefficients, 3, layout.PATH_TERMS)
    place = of_powers[:, layout.PATH_TERMS - 1]
    for i in reversed(range(layout.PATH_TERMS - 1)):
        place = of_powers[:, i] + s * place
    return place


def _links_in_world(a: dict[str, SX], s: StageState) -> list[tuple[tuple[SX, SX], SX]]:
    """Returns the ends (3,) in the world and the radius [m] of each link's capsule, the base's excepted."""
    body = distances.capsules_in_s(arm.frames(a["dh"], s.q), a["capsules"])
    R_WS = arm.world_axes(a["base"], s.q)
    world = distances.capsules_in_world(body, R_WS, a["base"][9:])
    links = list(zip(zip(world.starts, world.ends, strict=True), world.radii, strict=True))
    return links[layout.BASE + 1 : layout.FIRST_TOOL]
