"""Distances, tool speeds and singularity distances of the audit, by coal and Pinocchio."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
import trimesh
from numpy.typing import NDArray

from audit.judge.arm_path import ArmPath
from audit.judge.bodies import body_points, body_solid
from audit.judge.fault import AuditFault, over, under
from audit.judge.least_gap import REQUEST, MovingSolid, least_gap
from audit.judge.pinocchio_arm import CELLS_KEPT, arm_model, dh_frames_in_urdf, object_in_flange
from audit.judge.published_arms import robot_model
from planner.cell import Cell, Solid, ThrownBody
from planner.geometry import SELF_CLEARANCE_M, body_capsules
from planner.problem import TargetRelease, ThrowProblem
from planner.robots import Robot

Vector = NDArray[np.float64]

Obstacle = tuple[coal.ShapeBase, coal.Transform3s, float, str]
MovingObstacle = tuple[MovingSolid, float, str]

SPARSE_S = 0.008  # [s] grid of the distances
LENGTH_SLACK_M = 1e-5  # [m] of distances and positions
LIMIT_SLACK = 1e-5  # [-] of a limit
SINGULARITY_WINDOW_S = 0.05  # [s] around the release; source: docs/conventions.md
PAIR_SAMPLES = 2000  # random postures; pairs that touch in all of them are neighbours
PAIRS_KEPT = 4096  # pairs of bodies in a process: the links of every arm, and tools of the last cells
ROBOTS_KEPT = 32  # in a process, each with its random postures
BIN = "bin"  # name of the obstacle


@dataclass
class SpatialExtremes:
    """Extreme values over a motion.

    Attributes:
        floor: Smallest height above the floor [m].
        self_gap: Smallest distance between two bodies of the arm [m].
        boxes: Smallest distance from keep-out shapes and bin, less what one requires beyond the cell's clearance [m].
        singular: Smallest singularity distance [1].
        speed: Largest tool speed [m/s].
        outside: Largest distance of the tool centre point outside the keep-in shapes, and their clearances [m].
    """

    floor: float = np.inf
    self_gap: float = np.inf
    boxes: float = np.inf
    singular: float = np.inf
    speed: float = 0.0
    outside: float = -np.inf

    def faults(self, problem: ThrowProblem) -> list[AuditFault]:
        """Returns the violated limits."""
        limits = problem.limits
        clearance = problem.cell.surroundings.clearance_m
        slack = LENGTH_SLACK_M
        least = limits.singularity_distance_min
        fast = limits.tcp_speed_max
        return [
            *over("tcp_speed", "tool speed", self.speed, fast, fast * LIMIT_SLACK, "m/s"),
            *under("floor", "floor", self.floor, clearance, slack, "m"),
            *under("self_collision", "self-collision", self.self_gap, SELF_CLEARANCE_M, slack, "m"),
            *under("keep_out", "forbidden shape or bin", self.boxes, clearance, slack, "m"),
            *over("keep_in", "outside a keep-in shape by", self.outside, 0.0, slack, "m"),
            *under("singularity_distance", "singularity distance", self.singular, least, LIMIT_SLACK),
        ]


def spatial_faults(
    problem: ThrowProblem,
    q: Vector,
    qd: Vector,
    t: Vector,
    held_until_s: float,
    passed_s: Vector,
    beyond: tuple[Obstacle, ...] = (),
) -> list[AuditFault]:
    """Returns the violated distances, speeds and singularity distances.

    Args:
        problem: Gives cell and limits.
        q: Joint positions (n, 6) [rad].
        qd: Joint velocities (n, 6) [rad/s].
        t: Times (n,) [s].
        held_until_s: Time until which the object may be held, the end of the release window [s].
        passed_s: Times of the release, or of the passages, that are at speed (k,) [s].
        beyond: obstacles beside those of the cell.
    """
    cell = problem.cell
    worst = SpatialExtremes()
    model = arm_model(cell, False)
    arm = ArmPath.of(cell, model, q, qd)
    held = int(np.searchsorted(t, held_until_s, side="right"))
    bodies = [MovingSolid.at(body.solid, *arm.placed(body.frame, body.placement)) for body in _all(cell)]
    obstacles = [_moving(problem, obstacle, t) for obstacle in _obstacles(problem)]
    obstacles += [_standing(obstacle, len(t)) for obstacle in beyond]
    worst.speed = float(np.linalg.norm(arm.v, axis=1).max())
    worst.floor = min(_height(cell, arm, False), _height(cell, arm.rows(slice(held)), True) if held else np.inf)
    worst.self_gap = _self_gap(cell, bodies, held)
    worst.boxes = _box_gap(cell, obstacles, bodies, held)
    if cell.surroundings.keep_in:
        worst.outside = max(_outside(cell, p) for p in arm.points(6, cell.tool.X_FT[None, :3, 3])[:, 0])
    near = (np.abs(t[:, None] - passed_s) <= SINGULARITY_WINDOW_S).any(axis=1)
    worst.singular = min((singularity_distance(cell, q[k]) for k in np.flatnonzero(near)), default=np.inf)
    return worst.faults(problem)


def posture_room(cell: Cell, q: Vector) -> float:
    """Returns by how much an arm that holds its object keeps more than each distance that is asked of it [m].

    Negative where it is too near to the floor, to itself, to a shape, or outside a room.

    Args:
        cell: the cell.
        q: joint positions (6,) [rad].
    """
    arm = ArmPath.of(cell, arm_model(cell, False), q[None], np.zeros((1, 6)))
    bodies = [MovingSolid.at(body.solid, *arm.placed(body.frame, body.placement)) for body in _all(cell)]
    obstacles = [_standing(obstacle, 1) for obstacle in _keep_out(cell)]
    clearance = cell.surroundings.clearance_m
    outside = _outside(cell, arm.points(6, cell.tool.X_FT[None, :3, 3])[0, 0])
    least = min(_height(cell, arm, True) - clearance, -outside)
    least = min(least, _box_gap(cell, obstacles, bodies, 1) - clearance)
    return min(least, _self_gap(cell, bodies, 1) - SELF_CLEARANCE_M)


def singularity_distance(cell: Cell, q: Vector) -> float:
    """Returns the smallest of the three distances of docs/conventions.md at joint positions (6,) [-]."""
    model = arm_model(cell, False)
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return _singularity_distance(data)


def _outside(cell: Cell, p: Vector) -> float:
    """Returns how far the tool centre point (3,) is outside the keep-in shapes, or nearer to a wall than it may be [m].

    Negative inside. Written from pose and extent alone: a capsule is a sphere swept along z, and what is straight is
    between two planes.
    """
    return max((_beyond(shape, p) + (shape.clearance_m or 0.0) for shape in cell.surroundings.keep_in), default=-np.inf)


def _beyond(shape: Solid, p: Vector) -> float:
    """Returns how far a point (3,) is beyond the walls of a shape [m]; negative inside."""
    x, y, z = np.abs(pin.SE3(shape.X_WC[:3, :3], shape.X_WC[:3, 3]).actInv(p)).tolist()
    wide, deep, long = (0.5 * shape.extent).tolist()
    match shape.kind:
        case "box":
            return max(x - wide, y - deep, z - long)
        case "cylinder":
            return max(math.hypot(x, y) - wide, z - long)
        case _:
            return math.hypot(x, y, max(0.0, z - (long - wide))) - wide


def _singularity_distance(data: pin.Data) -> float:
    """Returns the smallest of the three distances of docs/conventions.md, from axes and origins of the joints."""
    axis = [data.oMi[i].rotation[:, 2] for i in range(1, 7)]
    origin = [data.oMi[i].translation for i in range(1, 7)]
    wrist = np.linalg.norm(np.cross(axis[3], axis[5]))
    upper, fore = (origin[i + 1] - origin[i] for i in (1, 2))
    upper, fore = (link - axis[1] * (axis[1] @ link) for link in (upper, fore))  # in the arm's plane
    lengths = np.linalg.norm(upper), np.linalg.norm(fore)
    elbow = np.linalg.norm(np.cross(upper, fore)) / (lengths[0] * lengths[1])
    shoulder = abs(np.cross(axis[0], axis[1]) @ (origin[4] - origin[0])) / sum(lengths)
    return float(min(wrist, elbow, shoulder))


def _self_gap(cell: Cell, bodies: list[MovingSolid], held: int) -> float:
    """Returns the smallest distance of the pairs that are judged [m]; of the object, in the instants it is held."""
    every = [(bodies[i], bodies[j]) for i, j in _judged_pairs(cell) if j < len(shapes(cell))]
    every += [(bodies[i].first(held), bodies[j].first(held)) for i, j in _judged_pairs(cell) if j == len(shapes(cell))]
    return _least([(one, other, 0.0) for one, other in every])


def _box_gap(cell: Cell, obstacles: list[MovingObstacle], bodies: list[MovingSolid], held: int) -> float:
    """Returns the smallest distance of bodies from shapes and bin [m], less what these are kept from further."""
    every = []
    for shape, body in zip(_all(cell), bodies, strict=True):
        count = held if body is bodies[-1] else len(body.p)
        if shape.frame > 0:
            meets = [each for each in obstacles if not _may_touch(cell, shape.name, each[2])]
            every += [(solid.first(count), body.first(count), further_m) for solid, further_m, _ in meets]
    return _least(every)


def _least(every: list[tuple[MovingSolid, MovingSolid, float]]) -> float:
    """Returns the smallest distance of pairs of solids [m], each less a length of its own; near ones come first."""
    balls = np.full(len(every), np.inf)
    for count in {len(one.p) for one, _, _ in every} - {0}:
        which = [k for k, (one, _, _) in enumerate(every) if len(one.p) == count]
        apart = np.array([every[k][0].middle for k in which]) - np.array([every[k][1].middle for k in which])
        radii = [every[k][0].solid.aabb_radius + every[k][1].solid.aabb_radius + every[k][2] for k in which]
        balls[which] = np.linalg.norm(apart, axis=2).min(axis=1) - radii
    least = np.inf
    for k in np.argsort(balls).tolist():
        one, other, further_m = every[k]
        if balls[k] < least:
            least = least_gap(one, other, least + further_m) - further_m
    return least


def _moving(problem: ThrowProblem, obstacle: Obstacle, t: Vector) -> MovingObstacle:
    """Returns an obstacle of `_obstacles` at times (n,) of the motion [s]."""
    solid, further_m, name = _standing(obstacle, len(t))
    if name != BIN or problem.starts_at_s is None:
        return solid, further_m, name
    assert isinstance(problem.release, TargetRelease)
    return MovingSolid.at_rest(*obstacle[:2], solid.p + t[:, None] * problem.release.v_W), further_m, name


def _standing(obstacle: Obstacle, count: int) -> MovingObstacle:
    """Returns an obstacle that stays where it is at as many instants."""
    solid, place, further_m, name = obstacle
    return MovingSolid.at_rest(solid, place, np.tile(place.getTranslation(), (count, 1))), further_m, name


def _obstacles(problem: ThrowProblem) -> list[Obstacle]:
    """Returns the keep-out shapes, and the bin as a solid cylinder: no part of the arm has business in it.

    A bin that moves stands where it is as the motion starts.
    With each what it is to be kept from beyond the cell's clearance [m], and its name.
    """
    found = _keep_out(problem.cell)
    release = problem.release
    if isinstance(release, TargetRelease) and release.opening is not None:
        height = release.opening.rim_height_m
        middle = release.p_W + np.array([0.0, 0.0, 0.5 * height])
        if problem.starts_at_s is not None:
            middle = middle + (problem.starts_at_s - release.at_s) * release.v_W
        found.append((coal.Cylinder(release.opening.radius_m, height), coal.Transform3s(np.eye(3), middle), 0.0, BIN))
    return found


def _keep_out(cell: Cell) -> list[Obstacle]:
    """Returns the keep-out shapes."""
    around = cell.surroundings
    found = []
    for name, shape in zip(around.keep_out_names, around.keep_out, strict=True):
        own = around.clearance_m if shape.clearance_m is None else shape.clearance_m
        place = coal.Transform3s(shape.X_WC[:3, :3], shape.X_WC[:3, 3])
        found.append((coal_solid(shape), place, own - around.clearance_m, name))
    return found


def coal_solid(shape: Solid) -> coal.ShapeBase:
    """Returns coal's solid of a shape."""
    x, y, z = shape.extent.tolist()
    solids = {
        "box": lambda: coal.Box(x, y, z),
        "cylinder": lambda: coal.Cylinder(0.5 * x, z),
        "sphere": lambda: coal.Sphere(0.5 * x),
        "capsule": lambda: coal.Capsule(0.5 * x, z - x),
    }
    return solids[shape.kind]()


def coal_mesh(mesh: trimesh.Trimesh) -> coal.BVHModelOBBRSS:
    """Returns coal's tree of a mesh's faces."""
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(mesh.faces), len(mesh.vertices))
    corners = coal.StdVec_Vec3s()
    corners.extend(np.array(mesh.vertices))
    faces = coal.StdVec_Triangle()
    faces.extend(coal.Triangle(*map(int, face)) for face in mesh.faces)
    model.addSubModel(corners, faces)
    model.endModel()
    return model


class BodyShape(NamedTuple):
    """A body: name, frame it is fixed in, placement there, coal's solid, radius [m], ends of its axis (2, 3) [m].

    Of a held object that is no ball, points (n, 3) instead of the ends, which its shape is the hull of.
    """

    name: str
    frame: int
    placement: pin.SE3
    solid: coal.ShapeBase
    radius_m: float
    ends: Vector


@lru_cache(maxsize=CELLS_KEPT)
def shapes(cell: Cell) -> list[BodyShape]:
    """Returns the bodies of arm and tool."""
    rows = []
    for c in body_capsules(cell.robot, cell.tool.capsules):
        along = c.p1 - c.p0
        length = float(np.linalg.norm(along))
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along / length if length else np.eye(3)[2])
        placement = pin.SE3(turn.matrix(), 0.5 * (c.p0 + c.p1))
        ends = np.array([c.p0, c.p1])
        rows.append(BodyShape(c.name, c.frame, placement, coal.Capsule(c.radius_m, length), c.radius_m, ends))
    return rows


@lru_cache(maxsize=CELLS_KEPT)
def _all(cell: Cell) -> list[BodyShape]:
    """Returns the bodies of arm and tool, and the held object last."""
    p_FT = cell.tool.X_FT[:3, 3]
    thing = cell.object
    radius = thing.radius_m
    if isinstance(thing, ThrownBody):
        lies = pin.SE3(object_in_flange(cell))
        points, radius = body_points(thing)
        ends = points @ lies.rotation.T + lies.translation
        return [*shapes(cell), BodyShape("object", 6, lies, body_solid(thing), radius, ends)]
    held = BodyShape("object", 6, pin.SE3(np.eye(3), p_FT), coal.Sphere(radius), radius, np.array([p_FT, p_FT]))
    return [*shapes(cell), held]


@lru_cache(maxsize=CELLS_KEPT)
def _pairs(cell: Cell) -> tuple[tuple[int, int], ...]:
    """Returns the pairs of bodies, as indices into `_all`, that are judged."""
    every = [_Solid(b.frame, _key(b.placement), b.radius_m, _length(b)) for b in shapes(cell)]
    thing = cell.object
    held = _all(cell)[-1]
    if not isinstance(thing, ThrownBody):
        return _apart(cell.robot, (*every, _Solid(held.frame, _key(held.placement), held.radius_m, 0.0)))
    # Every link counts against a body that is held, but those that it is apart from in every posture need no look.
    own = _apart(cell.robot, tuple(every))
    links = [i for i, body in enumerate(shapes(cell)) if not body.name.startswith("tool_")]
    return (*own, *((i, len(every)) for i in links))


@lru_cache(maxsize=CELLS_KEPT)
def _judged_pairs(cell: Cell) -> tuple[tuple[int, int], ...]:
    """Returns those of `_pairs` that the cell's table of contacts leaves."""
    names = [body.name for body in _all(cell)]
    return tuple((i, j) for i, j in _pairs(cell) if not _may_touch(cell, names[i], names[j]))


def _may_touch(cell: Cell, one: str, other: str) -> bool:
    """Returns whether two things may touch by the cell file's own words."""
    meant = {"tool": lambda name: name.startswith("tool_")}
    for entry in cell.surroundings.may_touch:
        for a, b in ((one, other), (other, one)):
            is_a = meant.get(entry.a, entry.a.__eq__)(a)
            is_b = b in entry.shapes if entry.shapes else meant.get(entry.b, entry.b.__eq__)(b)
            if is_a and is_b:
                return True
    return False


class _Solid(NamedTuple):
    """A body without its name: what pairs depend on, as a key."""

    frame: int
    placement: tuple[float, ...]
    radius_m: float
    length_m: float


def _key(X: pin.SE3) -> tuple[float, ...]:
    return tuple(np.round(X.homogeneous[:3].ravel(), 12).tolist())


def _length(body: BodyShape) -> float:
    return float(np.linalg.norm(body.ends[1] - body.ends[0]))


def _apart(robot: Robot, bodies: tuple[_Solid, ...]) -> tuple[tuple[int, int], ...]:
    """Returns the pairs of bodies that are apart in some random posture: all except neighbours.

    The object is beside what grips it: the tool, and wrists that it touches in some posture without being apart.
    """
    pairs = [(i, j) for i, j in combinations(range(len(bodies)), 2) if bodies[i].frame < 6]
    return tuple((i, j) for i, j in pairs if _are_ever_apart(robot, bodies[i], bodies[j]))


@lru_cache(maxsize=PAIRS_KEPT)
def _are_ever_apart(robot: Robot, one: _Solid, other: _Solid) -> bool:
    places = []
    for body in (one, other):
        X = np.reshape(body.placement, (3, 4))
        R, p = _random_postures(robot)[body.frame]
        places.append((R @ X[:, :3], p + R @ X[:, 3]))
    solids = [coal.Capsule(b.radius_m, b.length_m) if b.length_m else coal.Sphere(b.radius_m) for b in (one, other)]
    return any(
        coal.distance(
            solids[0], coal.Transform3s(R_0, p_0), solids[1], coal.Transform3s(R_1, p_1), REQUEST, coal.DistanceResult()
        )
        >= SELF_CLEARANCE_M
        for R_0, p_0, R_1, p_1 in zip(*places[0], *places[1], strict=True)
    )


@lru_cache(maxsize=ROBOTS_KEPT)
def _random_postures(robot: Robot) -> list[tuple[Vector, Vector]]:
    """Returns axes (n, 3, 3) and origin (n, 3) [m] of base and DH frames at random postures."""
    rng = np.random.default_rng(0)
    model = robot_model(robot)
    data = model.createData()
    frames = [pin.SE3.Identity(), *dh_frames_in_urdf(robot)]
    X = np.empty((PAIR_SAMPLES, 7, 4, 4))
    for k in range(PAIR_SAMPLES):
        pin.forwardKinematics(model, data, rng.uniform(robot.q_lower, robot.q_upper))
        X[k] = [(data.oMi[i] * frames[i]).homogeneous for i in range(7)]
    return [(X[:, i, :3, :3], X[:, i, :3, 3]) for i in range(7)]


def self_pairs(cell: Cell) -> list[tuple[str, str]]:
    """Returns the names of the bodies that self-collision is judged for; the held object is "object"."""
    names = [body.name for body in _all(cell)]
    return [(names[i], names[j]) for i, j in _pairs(cell)]


def _height(cell: Cell, arm: ArmPath, held: bool) -> float:
    """Returns the height of the lowest body over the floor [m], along a path."""
    bodies = [body for body in _all(cell)[: len(shapes(cell)) + held] if body.frame > 0]
    lowest = min(float(arm.points(body.frame, body.ends)[..., 2].min()) - body.radius_m for body in bodies)
    return lowest - cell.surroundings.floor_z_m
