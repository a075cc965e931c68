"""Distances, tool speeds and singularity distances of the audit, by coal and Pinocchio."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
import trimesh
from numpy.typing import NDArray

from audit.judge.bodies import body_points, body_solid
from audit.judge.fault import AuditFault, over, under
from audit.judge.pinocchio_arm import arm_model, dh_frames_in_urdf, object_in_flange, poses_and_velocity
from audit.judge.published_arms import robot_model
from planner.cell import Cell, Solid, ThrownBody
from planner.geometry import SELF_CLEARANCE_M, body_capsules
from planner.problem import TargetRelease, ThrowProblem
from planner.robots import Robot

Vector = NDArray[np.float64]

Obstacle = tuple[coal.ShapeBase, coal.Transform3s, float, str]

SPARSE_S = 0.008  # [s] grid of the distances
LENGTH_SLACK_M = 1e-5  # [m] of distances and positions
LIMIT_SLACK = 1e-5  # [-] of a limit
SINGULARITY_WINDOW_S = 0.05  # [s] around the release; source: docs/conventions.md
PAIR_SAMPLES = 2000  # random postures; pairs that touch in all of them are neighbours
_REQUEST = coal.DistanceRequest()


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
    obstacles = [*_obstacles(problem), *beyond]
    bodies = _all(cell)
    for solid in [*(body.solid for body in bodies), *(solid for solid, _, _, _ in obstacles)]:
        solid.computeLocalAABB()
    every_pair = _judged_pairs(cell)
    of_arm = tuple(pair for pair in every_pair if pair[1] < len(shapes(cell)))
    data = model.createData()
    for i in range(len(t)):
        poses, v = poses_and_velocity(cell, model, data, q[i], qd[i])
        places = [_coal(poses[shape.frame] * shape.placement) for shape in bodies]
        held = bool(t[i] <= held_until_s)
        worst.speed = max(worst.speed, float(np.linalg.norm(v)))
        worst.floor = min(worst.floor, _height(cell, poses, held))
        worst.self_gap = _self_gap(bodies, places, every_pair if held else of_arm, worst.self_gap)
        present = obstacles if problem.starts_at_s is None else [*_obstacles(problem, float(t[i])), *beyond]
        for solid, *_ in present:
            solid.computeLocalAABB()
        worst.boxes = _box_gap(cell, present, places, held, worst.boxes)
        worst.outside = max(worst.outside, _outside(cell, poses))
        if (np.abs(t[i] - passed_s) <= SINGULARITY_WINDOW_S).any():
            worst.singular = min(worst.singular, _singularity_distance(data))
    return worst.faults(problem)


def posture_room(cell: Cell, q: Vector) -> float:
    """Returns by how much an arm that holds its object keeps more than each distance that is asked of it [m].

    Negative where it is too near to the floor, to itself, to a shape, or outside a room.

    Args:
        cell: the cell.
        q: joint positions (6,) [rad].
    """
    model = arm_model(cell, False)
    poses, _ = poses_and_velocity(cell, model, model.createData(), q, np.zeros(6))
    bodies = _all(cell)
    obstacles = _keep_out(cell)
    for solid in [*(body.solid for body in bodies), *(solid for solid, _, _, _ in obstacles)]:
        solid.computeLocalAABB()
    places = [_coal(poses[body.frame] * body.placement) for body in bodies]
    clearance = cell.surroundings.clearance_m
    least = min(_height(cell, poses, True) - clearance, -_outside(cell, poses))
    least = min(least, _box_gap(cell, obstacles, places, True, np.inf) - clearance)
    of_arm = _self_gap(bodies, places, _judged_pairs(cell), np.inf)
    return min(least, of_arm - SELF_CLEARANCE_M)


def singularity_distance(cell: Cell, q: Vector) -> float:
    """Returns the smallest of the three distances of docs/conventions.md at joint positions (6,) [-]."""
    model = arm_model(cell, False)
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return _singularity_distance(data)


def _outside(cell: Cell, poses: list[pin.SE3]) -> float:
    """Returns how far the tool centre point is outside the keep-in shapes, or nearer to a wall than it may be [m].

    Negative inside. Written from pose and extent alone: a capsule is a sphere swept along z, and what is straight is
    between two planes.
    """
    p = poses[6].act(cell.tool.X_FT[:3, 3])
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


def _self_gap(
    bodies: list[BodyShape], places: list[coal.Transform3s], pairs: tuple[tuple[int, int], ...], least: float
) -> float:
    """Returns the smallest distance of pairs of bodies [m], or `least`, where that is smaller."""
    one, other = np.array(pairs, np.intp).reshape(-1, 2).T
    p = np.array([place.getTranslation() for place in places])
    r = np.array([body.solid.aabb_radius for body in bodies])
    away = np.linalg.norm(p[one] - p[other], axis=1) - r[one] - r[other]  # of the balls about them
    for k in np.flatnonzero(away < least).tolist():
        first, second = pairs[k]
        if away[k] < least:
            gap = _distance(bodies[first].solid, places[first], bodies[second].solid, places[second])
            least = min(least, gap)
    return least


def _box_gap(cell: Cell, obstacles: list[Obstacle], places: list[coal.Transform3s], held: bool, least: float) -> float:
    """Returns the smallest distance of the bodies from shapes and bin, less what these are kept from further [m].

    Or `least`, where that is smaller.
    """
    count = len(shapes(cell)) + held
    bodies = [(shape, own) for shape, own in list(zip(_all(cell), places, strict=True))[:count] if shape.frame > 0]
    if not obstacles:
        return least
    p = np.array([own.getTranslation() for _, own in bodies])
    r = np.array([shape.solid.aabb_radius for shape, _ in bodies])
    other_p = np.array([place.getTranslation() for _, place, _, _ in obstacles])
    other_r = np.array([solid.aabb_radius + further_m for solid, _, further_m, _ in obstacles])
    away = np.linalg.norm(p[:, None] - other_p, axis=2) - r[:, None] - other_r  # of the balls about them
    for i, j in np.argwhere(away < least).tolist():
        shape, own = bodies[i]
        solid, place, further_m, name = obstacles[j]
        if away[i, j] >= least or _may_touch(cell, shape.name, name):
            continue
        gap = _distance(shape.solid, own, solid, place)
        least = min(least, gap - further_m)
    return least


def _obstacles(problem: ThrowProblem, t: float = 0.0) -> list[Obstacle]:
    """Returns the keep-out shapes, and the bin as a solid cylinder: no part of the arm has business in it.

    A bin that moves stands where it is at a time `t` of the motion [s].
    With each what it is to be kept from beyond the cell's clearance [m], and its name.
    """
    found = _keep_out(problem.cell)
    release = problem.release
    if isinstance(release, TargetRelease) and release.opening is not None:
        height = release.opening.rim_height_m
        middle = release.p_W + np.array([0.0, 0.0, 0.5 * height])
        if problem.starts_at_s is not None:
            middle = middle + (problem.starts_at_s + t - release.at_s) * release.v_W
        found.append((coal.Cylinder(release.opening.radius_m, height), coal.Transform3s(np.eye(3), middle), 0.0, "bin"))
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


@cache
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


@cache
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


@cache
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


@cache
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


@cache
def _apart(robot: Robot, bodies: tuple[_Solid, ...]) -> tuple[tuple[int, int], ...]:
    """Returns the pairs of bodies that are apart in some random posture: all except neighbours.

    The object is beside what grips it: the tool, and wrists that it touches in some posture without being apart.
    """
    rng = np.random.default_rng(0)
    model = robot_model(robot)
    X_frames = dh_frames_in_urdf(robot)
    data = model.createData()
    solids = [coal.Capsule(b.radius_m, b.length_m) if b.length_m else coal.Sphere(b.radius_m) for b in bodies]
    fixed = [pin.SE3(np.vstack([np.reshape(b.placement, (3, 4)), [0.0, 0.0, 0.0, 1.0]])) for b in bodies]
    pairs = [(i, j) for i, j in combinations(range(len(bodies)), 2) if bodies[i].frame < 6]
    open_pairs = list(pairs)
    for _ in range(PAIR_SAMPLES):
        pin.forwardKinematics(model, data, rng.uniform(robot.q_lower, robot.q_upper))
        poses = [pin.SE3.Identity(), *(data.oMi[i] * X_frames[i - 1] for i in range(1, 7))]
        X = {i: _coal(poses[bodies[i].frame] * fixed[i]) for i in {i for pair in open_pairs for i in pair}}
        gaps = {
            (i, j): coal.distance(solids[i], X[i], solids[j], X[j], _REQUEST, coal.DistanceResult())
            for i, j in open_pairs
        }
        open_pairs = [pair for pair in open_pairs if gaps[pair] < SELF_CLEARANCE_M]
    return tuple(pair for pair in pairs if pair not in open_pairs)


def self_pairs(cell: Cell) -> list[tuple[str, str]]:
    """Returns the names of the bodies that self-collision is judged for; the held object is "object"."""
    names = [body.name for body in _all(cell)]
    return [(names[i], names[j]) for i, j in _pairs(cell)]


def _coal(X: pin.SE3) -> coal.Transform3s:
    return coal.Transform3s(X.rotation, X.translation)


def _distance(one: coal.ShapeBase, own: coal.Transform3s, other: coal.ShapeBase, place: coal.Transform3s) -> float:
    """Returns the distance of two solids [m]."""
    return float(coal.distance(one, own, other, place, _REQUEST, coal.DistanceResult()))


def _height(cell: Cell, poses: list[pin.SE3], held: bool) -> float:
    lowest = np.inf
    for shape in _all(cell)[: len(shapes(cell)) + held]:
        if shape.frame > 0:
            lowest = min(lowest, *(float(poses[shape.frame].act(end)[2]) - shape.radius_m for end in shape.ends))
    return lowest - cell.surroundings.floor_z_m
