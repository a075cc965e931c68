"""Rows of the optimal control problem as formulas of one stage's variables z and of parameters p.

z = (q, qd, qdd, t | jerk, h), each over its scale, which is a parameter: constant jerk over a step of length h,
integrated exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca

from planner.backends.casadi_nlp import layout
from planner.backends.casadi_nlp.layout import SHARED, VectorLayout
from planner.backends.casadi_nlp.symbols import arm, distances
from planner.backends.casadi_nlp.symbols.cost import COST, cost
from planner.backends.casadi_nlp.symbols.passing import (
    GUARD,
    Given,
    carried,
    flight_time,
    passing,
    passing_at_rest,
    passing_middle,
    place,
    standing,
    thrown,
)
from planner.backends.casadi_nlp.symbols.stage import StageState, state, state_after, state_at, through
from planner.backends.casadi_nlp.symbols.terms import Terms

SX = Any

FIRST_MOVING_CAPSULE = 2  # base and shoulder do not move relative to the floor
TINY = 1e-9  # [m^2/s^2] keeps the horizontal speed away from zero
PASSING = (
    0.01  # [s] roundness of the time at which a flight passes an edge, no sooner than its release; 0.1 ms late at 0.2 s
)
SLOWEST_FALL = 0.01  # [m^2/s^2] keeps the squared speed of fall into a bin away from zero
CENTRED = 1e-6  # [m^2] keeps the distance from a bin's axis away from zero
# [m^2/s^4] keeps the relative acceleration away from zero. Up to 0.3 m/s^2 may point anywhere for that: in the time
# that the way out takes they move the object by the millimetre that counts in no direction.
STEADY = 0.1
LEAVING_SHARES = (0.25, 0.5, 0.75, 1.0)  # [-] of a step, at which the object is looked at on its way out
IN_PLACE = 6.5e-4  # [m] displacement that counts in no direction, rounded off: at the certificate's 1 mm it counts
TINY_WAY = 1e-4  # [m] keeps the displacement away from zero
# [-] An object that has moved by so many times the way out may be anywhere, gradually: wholly so from 1.5 times on.
OUT = 1.25
OUT_ROUNDING = 0.05
IS_OUT = 4.0

RELEASE_ROWS = VectorLayout(
    {
        "position": 3,  # of the tool centre point in the world [m]
        "velocity": 3,  # [m/s]
        "landing": 2,  # horizontal offset of the landing point from the target [m]
        "drift": 2,  # its rate of change with the release time [m/s]
        "falls": 1,  # discriminant of the flight time [m^2/s^2]: positive where the object reaches the plane
        "elevation": 2,  # vertical speed less tan(elevation) times the horizontal [m/s], for both elevation limits
        "speed": 1,  # squared [m^2/s^2]
        "distance": 1,  # squared horizontal distance from the target [m^2]
    }
)

FLIGHT_ROWS = VectorLayout(
    {
        # each of the earliest and of the latest flight
        "edges": 2 * layout.FLIGHT_EDGES,  # of the flight beyond each edge [m]
        "mouth": 2,  # between sphere and rim, in the mouth's plane [m]
        "rim": 2,  # discriminant of that time [m^2/s^2]: positive where the flight rises above the rim
        "opening": 1,  # cosine of the object's first way out with the gripper's opening, less the least one [-]
        "out": 1,  # the same for its whole way, until it is out of the grip
    }
)


LEAVING_ROWS = VectorLayout(
    {
        "ways": len(LEAVING_SHARES),  # how deep the object is in the gripper's opening, at these shares of the step [-]
        "is_out": 1,  # by what its displacement after the step exceeds the way out of the grip, over it [-]
    }
)


def _tool_motion(a: dict[str, SX], s: StageState, terms: Terms) -> arm.ToolMotion:
    """Returns symbols for the tool's motion in S."""
    tool = arm.tool_motion(a["dh"], a["tcp"], s.q, s.qd, s.qdd)
    motion = terms.through(ca.vertcat(tool.position, tool.velocity, tool.acceleration))
    return arm.ToolMotion(*ca.vertsplit(motion, 3))


def _tool_in_world(a: dict[str, SX], s: StageState, terms: Terms) -> tuple[SX, SX, SX]:
    """Returns position [m], velocity [m/s] and acceleration [m/s^2] of the tool centre point in the world (3,) each."""
    R_WS = arm.world_axes(a["base"], s.q)
    tool = _tool_motion(a, s, terms)
    return R_WS @ tool.position + a["base"][9:], R_WS @ tool.velocity, R_WS @ tool.acceleration


def _tool_place(a: dict[str, SX], s: StageState) -> SX:
    """Returns the position of the tool centre point in the world (3,) [m]."""
    return arm.world_axes(a["base"], s.q) @ arm.frames(a["dh"], s.q).point(6, a["tcp"]) + a["base"][9:]


def motion(z: SX, given: Given, terms: Terms) -> SX:
    """Next state (NX), the velocity's middle control point (6), the position in the middle of the step (6); scaled."""
    c = given["scales"]
    end = state_after(z, c, 1.0)
    s = state(z, c)
    step = z[layout.STEP] * c["time"]
    middle_velocity = (s.qd + s.qdd * step / 2) / c["qd"]
    following = ca.vertcat(end.q, end.qd / c["qd"], end.qdd / c["qdd"], z[layout.TIME] + z[layout.STEP])
    return ca.vertcat(following, middle_velocity, state_after(z, c, 0.5).q)


def effort(s: StageState, given: Given, terms: Terms) -> SX:
    """Joint torques over their limits (6), and the square of the tool speed over its limit (1)."""
    a = given["arm"]
    tau = arm.torques(a["dh"], a["links"], a["gravity"], s.q, s.qd, s.qdd) / a["torque"]
    v = _tool_motion(a, s, terms).velocity
    return ca.vertcat(tau, ca.sumsqr(v) / a["speed"] ** 2)


def clearance(s: StageState, given: Given, terms: Terms) -> SX:
    """Self-collision, floor and keep-in distances beyond those required (3) [m]."""
    a = given["arm"]
    body = arm.frames(a["dh"], s.q)
    capsules = distances.capsules_in_s(body, a["capsules"])
    p_WB = a["base"][9:]
    R_WS = arm.world_axes(a["base"], s.q)
    heights = distances.lowest_heights(capsules, R_WS[2, :].T, p_WB[2], FIRST_MOVING_CAPSULE)
    p_WT = R_WS @ body.point(6, a["tcp"]) + p_WB
    inside = ca.vertsplit(ca.vertcat(p_WT - a["keep_in"][:3], a["keep_in"][3:] - p_WT))
    return ca.vertcat(
        distances.self_distance(capsules, a["pairs"], terms) - a["self_clearance"],
        distances.soft_minimum(heights, terms) - a["floor"],
        distances.soft_minimum(inside, terms),
    )


def keep_out(s: StageState, given: Given, terms: Terms, slots: int = layout.KEEP_OUT_SHAPES) -> SX:
    """Distance of arm, tool and object from the first `slots` keep-out shapes, beyond the one required (1) [m]."""
    a = given["arm"]
    b = given["shapes"]
    body = distances.capsules_in_s(arm.frames(a["dh"], s.q), a["capsules"])
    R_WS = arm.world_axes(a["base"], s.q)
    gaps = distances.shape_distances(body, R_WS, a["base"][9:], b["shapes"][: layout.SHAPE.size * slots], terms)
    return distances.soft_minimum(gaps, terms) - b["clearance"]


def rooms(s: StageState, given: Given, terms: Terms) -> SX:
    """Depth of the tool centre point in the keep-in shapes that are no plain boxes, beyond the one required (1) [m]."""
    b = given["rooms"]
    p_WT = _tool_place(given["arm"], s)
    return distances.soft_minimum(distances.depths(p_WT, b["rooms"], terms), terms) - b["margin"]


def singularity(s: StageState, given: Given, terms: Terms) -> SX:
    """Signed distances from the elbow, wrist and shoulder singularities (3) [-]."""
    return ca.vertcat(ca.sin(s.q[2]), ca.sin(s.q[4]), arm.shoulder_distance(given["arm"]["dh"], s.q))


def release(s: StageState, given: Given, terms: Terms) -> SX:
    """The rows of `RELEASE_ROWS`."""
    r = given["release"]
    position, velocity, acceleration = _tool_in_world(given["arm"], s, terms)
    landing, falls = _landing(position, velocity, r)
    drift = _drift(velocity, acceleration, position, r)
    horizontal_speed = ca.sqrt(velocity[0] ** 2 + velocity[1] ** 2 + TINY)
    offset = position[:2] - r["target"][:2]
    return ca.vertcat(
        position,
        velocity,
        landing - r["target"][:2],
        drift,
        falls,
        velocity[2] - r["tan_elevation"] * horizontal_speed,
        ca.sumsqr(velocity),
        ca.sumsqr(offset),
    )


def grip(s: StageState, given: Given, terms: Terms) -> SX:
    """What the grip holds against free fall, over what it withstands: along the tool axes (3), squared norm (1)."""
    a = given["arm"]
    tool = _tool_motion(a, s, terms)
    R_SF = arm.frames(a["dh"], s.q).rotations[6]
    up_S = arm.turn(s.q[0]).T @ a["gravity"]
    held = ca.reshape(a["tool_rotation"], 3, 3).T @ (R_SF.T @ (tool.acceleration + up_S))
    return ca.vertcat(held / a["grip"][:3], ca.sumsqr(held) / a["grip"][3] ** 2)


def flight(z: SX, given: Given, terms: Terms) -> SX:
    """The rows of `FLIGHT_ROWS`, all positive for a flight that is clear."""
    c = given["scales"]
    a = given["arm"]
    r = given["release"]
    f = given["flight"]
    s = state(z, c)
    position, velocity, acceleration = _tool_in_world(a, s, terms)
    edges = ca.horzsplit(ca.reshape(f["edges"], 8, layout.FLIGHT_EDGES))
    passed: list[SX] = []
    mouths: list[SX] = []
    rims: list[SX] = []
    for late_s in (-f["spread"], f["spread"]):  # the arm hardly changes its acceleration meanwhile
        x = position + late_s * velocity + late_s**2 / 2 * acceleration
        v = velocity + late_s * acceleration
        passed += [_beyond(edge, x, v, r["gravity_z"]) for edge in edges]
        mouth, rim = _through_mouth(f["mouth"], x, v, r)
        mouths.append(mouth)
        rims.append(rim)
    R_WB = ca.reshape(a["base"][:9], 3, 3)
    leaving = -(acceleration + R_WB @ a["gravity"])  # at the tool's own speed, unlike the flights
    opening = _in_cone(leaving, _opening(a, s, f["opening"], terms), f["opening"])
    out_s = ca.sqrt(2 * f["opening"][4] / ca.sqrt(ca.sumsqr(leaving) + ca.sumsqr(a["gravity"])))
    out = _in_cone(*_way(z, c, a, out_s, f["opening"], terms), f["opening"])
    return ca.vertcat(*passed, *mouths, *rims, opening, out)


def leaving(z: SX, given: Given, terms: Terms) -> SX:
    """The rows of `LEAVING_ROWS`, all positive for an object that is on its way out, or out, after the step."""
    c = given["scales"]
    a = given["arm"]
    opening = given["flight"]["opening"]
    path = given["object_path"]
    step = z[layout.STEP] * c["time"]
    released = z[layout.TIME] * c["time"]
    thrown = z[layout.SPEED] + path["path"][3:6]
    faster = thrown * (1 - path["share"]) / path["share"]  # on its way out the object has the tool's own velocity
    rows = []
    moved = ca.SX.zeros(3)
    for share in LEAVING_SHARES:
        s = through(state_at(z, c, share * step), terms)
        time = released + share * step
        tool = _tool_place(a, s)
        moved = terms.through(place(z, path["path"], time) + time * faster - tool)
        rows.append(_in_opening(moved, _opening(a, s, opening, terms), opening))
    is_out = ca.sqrt(ca.sumsqr(moved) + TINY_WAY**2) / opening[4] - 1
    return ca.vertcat(*rows, is_out)


def _in_opening(moved: SX, direction: SX, opening: SX) -> SX:
    """Returns how deep a displacement is in the opening [-]: the cosine of its angle, less the least one.

    In the first millimetre, and once the object is out, it is positive whatever the direction.
    """
    least = opening[3]
    out_m = opening[4]
    squared = ca.sumsqr(moved) + TINY_WAY**2
    distance = ca.sqrt(squared)
    beyond = distance / out_m - OUT
    is_out = IS_OUT * (beyond + ca.sqrt(beyond**2 + OUT_ROUNDING**2)) / 2
    in_place = ca.exp(-((squared / IN_PLACE**2) ** 2))
    return ca.dot(moved, direction) / distance - least + (1 + least) * (in_place + is_out)


def _way(z: SX, c: dict[str, SX], a: dict[str, SX], time: SX, opening: SX, terms: Terms) -> tuple[SX, SX]:
    """Returns the mean acceleration (3,) of the object against the tool in a time after the release, and the opening.

    In a time s it moves by the mean of g - a over s, weighted with 2 (1 - u / s), times s^2 / 2 (`certificate.exits`):
    for an acceleration that changes evenly, that at s / 3. The opening's direction (3,) is that after s.
    """
    time = terms.through(time)
    third, end = (through(state_at(z, c, at), terms) for at in (time / 3, time))
    tool = _tool_motion(a, third, terms)
    felt = ca.reshape(a["base"][:9], 3, 3) @ (arm.turn(third.q[0]) @ tool.acceleration + a["gravity"])
    return -felt, _opening(a, end, opening, terms)


def _opening(a: dict[str, SX], s: StageState, opening: SX, terms: Terms) -> SX:
    """Returns the direction (3,) in the world in which the gripper opens."""
    R_WS = arm.world_axes(a["base"], s.q)
    return terms.through(R_WS @ arm.frames(a["dh"], s.q).rotations[6] @ opening[:3])


def _in_cone(leaving: SX, direction: SX, opening: SX) -> SX:
    """Returns the cosine of an acceleration's angle with a direction, less the least one [-]."""
    return ca.dot(leaving, direction) / ca.sqrt(ca.sumsqr(leaving) + STEADY) - opening[3]


def _beyond(edge: SX, position: SX, velocity: SX, gravity: SX) -> SX:
    """Returns how far beyond its bound the flight is at the time of an edge of `flight_rows` [m], times a square.

    The time is ahead / speed. A division would have no bound where the flight turns parallel to the edge's plane, and
    the solver would not return from there; so the row is multiplied by speed^2, which is 1 at the expected speed.
    """
    normal = edge[:2]
    steady = edge[2]
    offset = edge[3]
    direction = edge[4:7]
    bound = edge[7]
    speed = ca.dot(normal, velocity[:2]) + steady
    distance = offset - ca.dot(normal, position[:2])
    ahead = (distance + ca.sqrt(distance**2 + PASSING**2)) / 2
    room = ca.dot(direction, position) - bound
    return speed * (speed * room + ahead * ca.dot(direction, velocity)) - direction[2] * gravity * ahead**2 / 2


def _through_mouth(mouth: SX, position: SX, velocity: SX, r: dict[str, SX]) -> tuple[SX, SX]:
    """Returns the room between sphere and rim in the mouth's plane [m], and the discriminant of the time there.

    At an angle d below the horizontal the sphere clears the rim if its centre falls through the plane r / sin d inside.
    """
    point, rises = _landing(position, velocity, {**r, "target": mouth[:3]})
    fall_squared = ca.sqrt(((rises + ca.sqrt(rises**2 + GUARD**2)) / 2) ** 2 + SLOWEST_FALL**2)
    thick = mouth[4] * ca.sqrt(1 + ca.sumsqr(velocity[:2]) / fall_squared)
    return mouth[3] - thick - ca.sqrt(ca.sumsqr(point - mouth[:2]) + CENTRED), rises


def _landing(position: SX, velocity: SX, r: dict[str, SX]) -> tuple[SX, SX]:
    """Returns the drag-free landing point (2,) on the target's plane [m], and the discriminant [m^2/s^2]."""
    time, falls = flight_time(velocity[2], position[2] - r["target"][2], r["gravity_z"])
    return position[:2] + velocity[:2] * time, falls


def _drift(velocity: SX, acceleration: SX, position: SX, r: dict[str, SX]) -> SX:
    p = ca.SX.sym("p", 3)
    v = ca.SX.sym("v", 3)
    point, _ = _landing(p, v, r)
    rate = ca.jtimes(point, p, velocity) + ca.jtimes(point, v, acceleration)
    return ca.substitute([rate], [p, v], [position, velocity])[0]


VECTORS = {**SHARED, "cost": COST}  # layouts of what formulas are given; those of the cost differ from stage to stage


@dataclass(frozen=True)
class BlockFormula:
    """The formula of a block.

    Attributes:
        rows: (z, given, terms) -> rows (n,); adds its intermediate terms to `terms`.
        parameters: names in `VECTORS` of the parameters that are given, in order.
        curved: whether the rows contribute to the Hessian.
        of_object: whether the variables are (z, thrown), with the object's states.
    """

    rows: Callable[[SX, Given, Terms], SX]
    parameters: tuple[str, ...]
    curved: bool = True
    of_object: bool = False

    @property
    def variables(self) -> int:
        """Number of variables that the rows are of."""
        return layout.NZ + (layout.N_THROWN if self.of_object else 0)

    @property
    def layout(self) -> VectorLayout:
        """Names and sizes of the parameter vectors, which make up p."""
        return VectorLayout({name: VECTORS[name].size for name in self.parameters})

    def given(self, p: SX) -> Given:
        """Returns the pieces of the parameters p."""
        return {name: VECTORS[name].split(piece) for name, piece in self.layout.split(p).items()}


StateFormula = Callable[[StageState, Given, Terms], SX]


def _at_knot(rows: StateFormula, *parameters: str, curved: bool = True) -> BlockFormula:
    """Evaluates rows of a state at the beginning of the stage."""

    def at_knot(z: SX, given: Given, terms: Terms) -> SX:
        return rows(state(z, given["scales"]), given, terms)

    return BlockFormula(at_knot, ("scales", *parameters), curved)


def _in_middle(rows: StateFormula, *parameters: str, curved: bool = True) -> BlockFormula:
    """Evaluates rows of a state in the middle of the step."""

    def in_middle(z: SX, given: Given, terms: Terms) -> SX:
        return rows(through(state_after(z, given["scales"], 0.5), terms), given, terms)

    return BlockFormula(in_middle, ("scales", *parameters), curved)


# Every block of rows. The order is that of the rows within a stage.
FORMULAS: dict[str, BlockFormula] = {
    "motion": BlockFormula(motion, ("scales",)),
    "cost": BlockFormula(cost, ("cost",)),
    "effort": _at_knot(effort, "arm"),
    "effort_middle": _in_middle(effort, "arm"),
    "clearance": _at_knot(clearance, "arm"),
    "clearance_middle": _in_middle(clearance, "arm"),
    # Without second derivatives, which take three quarters of a minute to compile, each.
    "keep_out": _at_knot(keep_out, "arm", "shapes", curved=False),
    "keep_out_middle": _in_middle(keep_out, "arm", "shapes", curved=False),
    "rooms": _at_knot(rooms, "arm", "rooms"),
    "rooms_middle": _in_middle(rooms, "arm", "rooms"),
    "grip": _at_knot(grip, "arm"),
    "grip_middle": _in_middle(grip, "arm"),
    "singularity": _at_knot(singularity, "arm"),
    "singularity_middle": _in_middle(singularity, "arm"),
    "release": _at_knot(release, "arm", "release"),
    "flight": BlockFormula(flight, ("scales", "arm", "release", "flight")),
    "standing": _at_knot(standing, "arm", "standing"),
    "leaving": BlockFormula(leaving, ("scales", "arm", "flight", "object_path"), of_object=True),
    "thrown": BlockFormula(thrown, ("scales", "arm", "object_path")),
    "carried": BlockFormula(carried, (), curved=False, of_object=True),
    "passing": BlockFormula(passing, ("scales", "arm", "object_path"), of_object=True),
    "passing_middle": BlockFormula(passing_middle, ("scales", "arm", "object_path"), of_object=True),
    "passing_at_rest": BlockFormula(passing_at_rest, ("scales", "arm", "object_path"), of_object=True),
}
# The same rows with fewer slots for shapes, each of which takes its time.
WITH_FEWER_SHAPES = {
    f"{name}_{slots}": at(partial(keep_out, slots=slots), "arm", "shapes")
    for name, at in (("keep_out", _at_knot), ("keep_out_middle", _in_middle))
    for slots in layout.SHAPE_SLOTS[:-1]
}
# Every formula that functions are built from.
ALL_FORMULAS = FORMULAS | WITH_FEWER_SHAPES
