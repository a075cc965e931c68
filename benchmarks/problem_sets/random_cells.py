"""Cells drawn at random in everything that a cell file says, and problems of every kind in them, for the audit.

Bases stand, lean, hang on a wall or from a ceiling; tools lie off the axis; objects are light, heavy, large or a point,
with drag or without; walls, ceilings, boxes and bins stand around; every limit is loose in one cell and small in
another. The same number and seed give the same cell and the same problems.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.problem_sets.named_sets import ARMS, cell
from benchmarks.problem_sets.posture import allowed, pose_and_twist, tool_position
from benchmarks.problem_sets.task import Task
from planner.cell import Box, Cell, Limits, Safety, ToolCapsule
from planner.dynamics import safety_use
from planner.flight import fly, path
from planner.geometry import body_model
from planner.problem import JointRelease, Opening, PointRelease, PoseRelease, TargetRelease, ThrowProblem
from planner.rotations import pose, rotation_vector_to_matrix

Vector = NDArray[np.float64]

KINDS = ("target", "bin", "joint", "robust", "point", "robust bin", "pose", "rest")
MOUNTINGS = {"floor": 0.0, "leaning": 0.4, "wall": np.pi / 2, "ceiling": np.pi}  # [rad] tilt of the base
SPREAD = 1.2
SPEED_SHARE = 0.7  # [rad] around home, [-] of the velocity limits
SPEED_MIN = 0.4
RANGE_MIN = 0.2  # [m/s], [m] of a throw
HOME_CLEARANCE_M = 0.005  # [m] beyond the required clearances, at home: the wrist of a UR5 has 8 mm there
BOXES = 3  # keep-out boxes per cell: a wall, a ceiling, a block
STATES_MAX = 400  # states drawn for one problem before another kind is tried
SMALL = 0.02  # [-] smallest share of an ordinary limit


def random_cell_tasks(count: int, cells: int, seed: int) -> list[Task]:
    """Returns `count` problems in `cells` random cells; cells and kinds of release take turns."""
    drawn = [random_cell(i, seed) for i in range(cells)]
    streams = [np.random.default_rng([seed, i, 1]) for i in range(cells)]
    tasks: list[Task] = []
    for rank in range(count):
        i = rank % cells
        turn = rank // cells
        for attempt in range(len(KINDS)):
            kind = KINDS[(turn + i + attempt) % len(KINDS)]
            problem = _problem(drawn[i], kind, streams[i])
            if problem is not None:
                tasks.append(Task(f"cells/{drawn[i].name}/{rank:04d}-{kind.replace(' ', '-')}", problem))
                break
    return tasks


@cache
def random_cell(index: int, seed: int) -> Cell:
    """Returns the random cell of this number."""
    rng = np.random.default_rng([seed, index, 0])
    arm = cell(ARMS[index % len(ARMS)])
    mounting = tuple(MOUNTINGS)[index // len(ARMS) % len(MOUNTINGS)]
    while True:
        plain = replace(_mounted(arm, mounting, rng), name=f"{index:02d}-{mounting}-{arm.name}")
        if _clearance(plain) > HOME_CLEARANCE_M:
            return _furnished(_limited(plain, index % 3 == 2, rng), rng)


def _mounted(arm: Cell, mounting: str, rng: np.random.Generator) -> Cell:
    """Returns the arm on another base, with another tool and object."""
    lean = MOUNTINGS[mounting]
    turn = rng.uniform(-np.pi, np.pi)
    R_WB = _rotation(2, turn) @ _rotation(0, lean + rng.uniform(-0.1, 0.1)) @ _rotation(2, rng.uniform(-np.pi, np.pi))
    height = rng.uniform(0.0, 0.8) + (1.0 if lean > 1.0 else 0.0)
    p_FT = rng.uniform([-0.1, -0.1, 0.05], [0.1, 0.1, 0.25])
    X_FT = pose(p_FT, rotation_vector_to_matrix(rng.uniform(-0.8, 0.8, 3)))
    tool = replace(
        arm.tool,
        X_FT=X_FT,
        mass_kg=float(rng.uniform(0.1, 1.5)),
        capsules=(ToolCapsule(np.zeros(3), 0.85 * p_FT, 0.03),),
    )
    thing = replace(
        arm.object,
        mass_kg=float(np.exp(rng.uniform(np.log(0.005), np.log(1.5)))),
        radius_m=float(rng.choice([0.0, rng.uniform(0.01, 0.06)], p=[0.15, 0.85])),
        drag_coefficient=float(rng.choice([0.0, 0.47, 1.2])),
    )
    gripper = replace(
        arm.gripper,
        jitter_s=float(rng.choice([0.0, rng.uniform(0.0, 0.006)])),
        opening_direction=np.array([0.0, 0.0, 1.0]),
        opening_cone_rad=float(rng.uniform(0.8, np.pi)),
        hold_acceleration_m_s2=np.full(int(rng.choice([1, 3])), np.exp(rng.uniform(np.log(15.0), np.log(120.0)))),
    )
    base = pose(np.array([*rng.uniform(-1.0, 1.0, 2), height]), R_WB)
    return replace(arm, X_WB=base, tool=tool, object=thing, gripper=gripper)


def _limited(here: Cell, small: bool, rng: np.random.Generator) -> Cell:
    """Returns the cell with other limits; where they are `small`, some of them down to a fiftieth of ordinary ones."""

    def share(least: float = SMALL) -> float:
        return float(np.exp(rng.uniform(np.log(least), 0.0))) if small and rng.random() < 0.5 else rng.uniform(0.5, 1.0)

    own = here.limits
    size = float(np.abs(here.robot.a).sum())
    safety = Safety(
        tool_speed_m_s=float(rng.uniform(1.5, 5.0)) * share(0.3),
        elbow_speed_m_s=3.0 * share(0.2),
        momentum_kg_m_s=60.0 * size * share(0.1),
        power_w=1000.0 * size * share(0.1),
        stopping_time_s=0.5 * share(0.1),
        stopping_distance_m=0.6 * share(0.1),
    )
    limits = Limits(
        q_lower=own.q_lower,
        q_upper=own.q_upper,
        qd_max=here.robot.qd_max * np.array([share(0.05) for _ in range(6)]),
        qdd_max=own.qdd_max * share(),
        jerk_max=own.jerk_max * share() * rng.choice([1.0, 4.0]),
        tau_max=here.robot.tau_max * rng.uniform(0.6, 1.0),
        tcp_speed_max=min(own.tcp_speed_max * share(0.2), safety.tool_speed_m_s or np.inf),
        singularity_distance_min=float(rng.choice([0.0, 0.001, 0.05, 0.15])),
    )
    return replace(here, limits=limits, safety=safety)


def _furnished(here: Cell, rng: np.random.Generator) -> Cell:
    """Returns the cell with a wall, a ceiling and a block within reach, all clear of the home posture."""
    base = here.X_WB[:3, 3]
    reach = float(np.hypot(here.robot.a, here.robot.d).sum())
    around = replace(here.surroundings, clearance_m=float(rng.choice([0.0, 0.005, 0.02, 0.05])))
    found = replace(here, surroundings=around)
    for kind in ("wall", "ceiling", "block")[:BOXES]:
        for _ in range(20):
            boxes = (*found.surroundings.keep_out, _box(kind, base, reach, rng))
            more = replace(found, surroundings=replace(around, keep_out=boxes))
            if _clearance(more) > HOME_CLEARANCE_M:
                found = more
                break
    if rng.random() < 0.3:
        home = tool_position(found, found.home)
        room = Box(home - rng.uniform(0.5, 1.0, 3) * reach, home + rng.uniform(0.5, 1.0, 3) * reach)
        found = replace(found, surroundings=replace(found.surroundings, keep_in=(room,)))
    return found


def _box(kind: str, base: Vector, reach: float, rng: np.random.Generator) -> Box:
    if kind == "ceiling":
        centre = base + rng.uniform(0.9, 1.6) * reach * np.eye(3)[2]
        half = np.array([2.0, 2.0, 0.02]) * reach
    elif kind == "wall":
        away, across = rng.permutation(2)
        centre = np.array(base)
        half = np.zeros(3)
        centre[away] += rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.1) * reach
        half[away] = rng.uniform(0.01, 0.1)
        half[across] = rng.uniform(0.3, 2.0) * reach
        half[2] = reach
        centre[2] = rng.uniform(0.2, 0.8) * reach - half[2]
    else:
        centre = base + rng.uniform(-0.9, 0.9, 3) * reach
        half = rng.uniform(0.03, 0.2, 3) * reach
    return Box(centre - half, centre + half)


def _clearance(here: Cell) -> float:
    return float(body_model(here).clearances(here.home[None]).least[0])


def _rotation(axis: int, angle: float) -> Vector:
    return rotation_vector_to_matrix(angle * np.eye(3)[axis])


def _states(here: Cell, rng: np.random.Generator) -> Iterator[JointRelease]:
    limits = here.limits
    body = body_model(here)
    for _ in range(STATES_MAX):
        q = np.clip(here.home + rng.uniform(-SPREAD, SPREAD, 6), limits.q_lower, limits.q_upper)
        qd = rng.uniform(-SPEED_SHARE, SPEED_SHARE, 6) * limits.qd_max
        used = max(float(use.value[0]) / use.limit for use in safety_use(here, limits.tcp_speed_max, q[None], qd[None]))
        qd = qd * min(1.0, 0.8 / used)
        if body.clearances(q[None]).least[0] > 0.0 and allowed(here, q, qd):
            yield JointRelease(q, qd)


def _problem(here: Cell, kind: str, rng: np.random.Generator) -> ThrowProblem | None:
    """Returns a problem of a kind in which the object flies freely from a state that keeps every limit by itself."""
    for state in _states(here, rng):
        if kind == "rest":
            return ThrowProblem(here, here.home, JointRelease(state.q, np.zeros(6)), here.limits)
        X_WT, V_WT = pose_and_twist(here, state.q, state.qd)
        p = X_WT[:3, 3]
        v = V_WT[:3]
        if np.linalg.norm(v) < SPEED_MIN:
            continue
        if kind in ("joint", "pose", "point"):
            release = {"joint": state, "pose": PoseRelease(X_WT, V_WT), "point": PointRelease(p, v)}[kind]
            return ThrowProblem(here, here.home, release, here.limits)
        release = _target(here, p, v, "bin" in kind, rng)
        if release is not None:
            return _with_window(ThrowProblem(here, here.home, release, here.limits), "robust" in kind)
    return None


def _with_window(problem: ThrowProblem, robust: bool) -> ThrowProblem:
    """Returns the problem with the window that a target has by default, or without one."""
    if not robust:
        return problem
    here = problem.cell
    release = problem.release
    tolerance = max(0.01, here.object.radius_m)
    if isinstance(release, TargetRelease) and release.opening is not None:
        tolerance = max(0.001, release.opening.radius_m - here.object.radius_m)
    return replace(problem, release_window_s=max(0.005, 3.0 * here.gripper.jitter_s), landing_tolerance_m=tolerance)


def _target(here: Cell, p: Vector, v: Vector, in_bin: bool, rng: np.random.Generator) -> TargetRelease | None:
    """Returns the target that a release hits, None where its way is not free or too short."""
    floor = here.surroundings.floor_z_m
    radius = here.object.radius_m
    plain = ThrowProblem(here, here.home, PointRelease(p, v), here.limits)
    plane = floor + float(rng.choice([0.0, rng.uniform(0.0, 0.3)]))
    flight = fly(p, v, plane, plain.gravity, plain.drag)
    if flight is None or np.linalg.norm((flight.landing_point - p)[:2]) < RANGE_MIN:
        return None
    x = path(p, v, np.linspace(0.0, flight.time_of_flight_s, 60), plain.gravity, plain.drag)
    for box in here.surroundings.keep_out:
        if np.linalg.norm(x - np.clip(x, box.lower, box.upper), axis=1).min() < radius + 0.01:
            return None
    if not in_bin:
        return TargetRelease(flight.landing_point)
    opening = Opening(float(radius + rng.uniform(0.04, 0.15)), float(rng.uniform(0.03, 0.2)))
    off = np.linalg.norm((x - flight.landing_point)[:, :2], axis=1)
    below = x[:, 2] < plane + opening.rim_height_m + radius
    clear = off[below].max(initial=0.0) < opening.radius_m - radius and not below[0]
    return TargetRelease(flight.landing_point, opening=opening) if clear else None
