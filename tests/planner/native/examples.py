"""Random arguments of the functions of the kernel, with what is special among them: points, parallels, no numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.random import Generator

from planner.approach.rrt_connect import Obstacles
from planner.cell import Box, shape_of
from planner.certificate.bounds import Rates
from planner.certificate.exits import cells_between
from planner.dynamics import bodies, payload_of
from planner.kinematics import forward, link_poses
from planner.native import Pinned
from planner.robots import ROBOT_NAMES, Robot, robot
from planner.rotations import pose, rotation_vector_to_matrix
from planner.trajectory import integrate
from tests.planner.problems import cell

Arguments = tuple[Any, ...]
Array = np.ndarray
AIR = (9.81, 0.1)
N = 7  # [-] instants or states; no multiple of four


def _arm(rng: Generator) -> Robot:
    return robot(ROBOT_NAMES[rng.integers(len(ROBOT_NAMES))])


def _poses(rng: Generator) -> Array:
    return link_poses(_arm(rng), rng.uniform(-3.0, 3.0, (N, 6)))


def _turns(rng: Generator) -> tuple[Array, Array, Array, Array]:
    """Returns cosines, sines, DH parameters and a base."""
    arm = _arm(rng)
    q = rng.uniform(-np.pi, np.pi, (N, 6))
    dh = np.array([arm.a, arm.d, np.cos(arm.alpha), np.sin(arm.alpha)])
    return np.cos(q), np.sin(q), dh, pose([0.3, -0.2, 0.1], rotation_vector_to_matrix([0.4, -0.5, 0.6]))


def _measured_chain(rng: Generator) -> Arguments:
    cosine, sine, _, base = _turns(rng)
    fixed = pose(rng.uniform(-1.0, 1.0, (6, 3)), rotation_vector_to_matrix(rng.uniform(-1.0, 1.0, (6, 3))))
    return cosine, sine, fixed, base


def _rates(rng: Generator) -> Array:
    return rng.uniform(-3.0, 3.0, (N, 6))


def _loaded(rng: Generator) -> Arguments:
    here = cell()
    masses = bodies(_arm(rng), payload_of(here, with_object=True)).arrays
    return _poses(rng), (_rates(rng), _rates(rng)), masses, rng.uniform(-9.8, 9.8, 3), rng.uniform(-0.2, 0.2, 3)


def _segments(rng: Generator) -> Arguments:
    """Parallel ones, points, and segments that touch among them."""
    p0, p1, q0, q1 = rng.uniform(-1.0, 1.0, (4, 8, 3, 3))
    q1[1] = q0[1] + 2.0 * (p1[1] - p0[1])
    q1[3] = q0[3]
    q0[4] = p1[4]
    p1[2] = p0[2]
    p1[5] = p0[5]
    q1[5] = q0[5]
    ends = np.concatenate([np.stack([p0, p1], axis=1), np.stack([q0, q1], axis=1)])
    return ends, np.array([[i, i + 8] for i in range(8)]), 1e-18


def _shapes(rng: Generator) -> Arguments:
    """All shapes; segments along a face, a point, and one through a box among them."""
    p0, p1, low, size = rng.uniform(-1.0, 1.0, (4, 12, 3))
    p1[1, 0] = p0[1, 0]
    p1[2, 1:] = p0[2, 1:]
    p1[3] = p0[3]
    p0[4] = low[4] - 0.1
    p1[4] = low[4] + np.abs(size[4]) + 0.1
    rows = [Box(low[i], low[i] + np.abs(size[i])).row for i in range(6)]
    for kind, sizes in (
        ("box", [0.3, 0.5, 0.7]),
        ("cylinder", [0.3, 0.5]),
        ("sphere", [0.3, 0.0]),
        ("capsule", [0.2, 0.5]),
    ):
        turned = rotation_vector_to_matrix(rng.uniform(-2.0, 2.0, 3))
        rows.append(shape_of(kind, pose(rng.uniform(-1.0, 1.0, 3), turned), np.array(sizes)).row)
    items = np.array([*range(6), *range(6, 10), 7, 7])
    return p0, p1, items, np.array(rows)


def _released(rng: Generator) -> Array:
    """States of an object; the last never lands."""
    states = rng.uniform([-1.0, -1.0, 0.5, -3.0, -3.0, -2.0], [1.0, 1.0, 1.5, 3.0, 3.0, 5.0], (N, 6))
    states[-1] = [0.0, 0.0, 0.1, 1.0, 0.0, 0.5]
    return states


def _flown(rng: Generator) -> Arguments:
    return _released(rng), np.array([0, 3, 5]), rng.uniform(0.0, 0.004, (N, 3)), AIR


def _motion(rng: Generator) -> tuple[float, Pinned]:
    jerk = rng.uniform(-500.0, 500.0, (40, 6))
    q, qd, qdd = integrate(np.zeros(6), np.zeros(6), np.ones(6), jerk, 0.002)
    return 0.002, Pinned(q, qd, qdd + 1e-6 * q, jerk)


def _rows(rng: Generator) -> Rates:
    return Rates(rng.uniform(0.0, 1.0, (4, 6, N)))


def _loads(rng: Generator) -> Arguments:
    rates = _rows(rng)
    shapes = (8, 6), (8, 6), (8,), (6,), (6, 6)
    return (rates.rows, rates.bounds), tuple(rng.uniform(0.0, 1.0, shape) for shape in shapes), 0.7, 9.81


def _way(rng: Generator) -> Arguments:
    fallen, felt = rng.uniform(-1.0, 1.0, (2, 3, 4))
    X_WF = rng.uniform(-1.0, 1.0, (4, 4, 4))
    return X_WF, rng.uniform(-1.0, 1.0, (4, 4)), fallen, np.array([0.0, 0.01, 0.1, 0.2]), felt


def _cells(rng: Generator) -> Arguments:
    cells = cells_between(np.array([0.0, 0.1, 0.2]), np.array([0.0, 0.03, 0.06, 0.09]))
    w = np.array([[0.0], [0.0], [9.0]]) + rng.uniform(-8.0, 8.0, (3, 12))
    cone = np.array([0.0, 0.6, 0.8]), float(rng.uniform(0.5, 2.5)), 0.001, 0.01
    return w, cells.s, cells.corners, rng.uniform(0.0, 1.0, 6), cone


def _capsules(rng: Generator) -> tuple[Array, Array]:
    """Returns frames and ends of three capsules, the last a sphere."""
    ends = rng.uniform(-1.0, 1.0, (3, 2, 3))
    ends[2, 1] = ends[2, 0]
    return np.array([0, 3, 6]), ends


def _grid(rng: Generator) -> Arguments:
    rows = rng.integers(1, 4)
    grid = rng.uniform(-1.0, 1.0, (3, rows, 5)), rng.uniform(-1.0, 1.0, (5, 7, 4, 4)), np.array([0.1, 0.2, 0.1, 0.3])
    moving = np.ones((2, max(1, rows - 1), 4))
    return grid, _capsules(rng), rng.uniform(0.0, 1.0, (2, 7, 4)), np.arange(7.0), moving


def _patches(rng: Generator) -> Arguments:
    poses = rng.uniform(-1.0, 1.0, (3, 7, 4, 4)), np.array([[0, 1, 0], [1, 2, 2]])
    return poses, _capsules(rng), rng.uniform(-1.0, 1.0, (3, 4, 3))


def _flanges(rng: Generator) -> Arguments:
    """Poses with joint 6 free, and out of reach, among them."""
    arm = _arm(rng)
    q = rng.uniform(-3.0, 3.0, (N, 6))
    q[0, 4] = 0.0
    X = forward(arm, q)
    X[1:3, :3, 3] *= 3.0
    return X, np.array([*arm.d[[0, 3, 4, 5]], *arm.a[[1, 2]], 1e-10, 1e-10])


def _states(rng: Generator) -> tuple[Array, Array, Array]:
    return rng.uniform(-1.0, 1.0, (N, 3, 6)), rng.uniform(-1.0, 1.0, (N, 3)), rng.uniform(-1.0, 1.0, (N, 6))


LIMITS = np.linspace(2.0, 3.0, 6)
NORMS = np.array([3.0, 4.0, 5.0, 8.0])


def _launches(rng: Generator) -> Arguments:
    """Slow and fast states, and one without a velocity."""
    q, qd = rng.uniform(-2.0, 2.0, (2, N, 6))
    qd[0, 0] = np.nan
    return q, np.concatenate([qd, 0.1 * qd, 3.0 * qd]), q[-1], (LIMITS, 2.0 * LIMITS), 1e3


ROOMS = (("box", [1.8, 2.0, 2.2]), ("cylinder", [1.0, 2.0]), ("sphere", [1.1, 0.0]), ("capsule", [0.9, 0.8]))


def _scene(rng: Generator) -> tuple[Pinned, Array, Array]:
    """What an arm with all shapes around it keeps clear of, the ends of its way, and the margins about it."""
    here = cell(("ur5e-sim", "ur3e-sim")[rng.integers(2)])
    sizes = {"box": (0.3, 0.2, 0.5), "cylinder": (0.1, 0.5), "sphere": (0.1, 0.0), "capsule": (0.05, 0.4)}
    places = rng.uniform([-0.8, -0.8, 0.0], [0.8, 0.8, 1.0], (4, 3))
    turns = rotation_vector_to_matrix(rng.uniform(-2.0, 2.0, (4, 3)))
    shapes = [
        shape_of(kind, pose(place, turn), np.array(size))
        for (kind, size), place, turn in zip(sizes.items(), places, turns, strict=True)
    ]
    box = Box(np.full(3, -1.2), np.full(3, 1.2))
    rooms = [
        replace(shape_of(kind, pose([0.1, 0.0, 0.4], turns[0]), np.array(size)), clearance_m=0.05)
        for kind, size in ROOMS
    ]
    around = replace(here.surroundings, keep_out=tuple(shapes), keep_in=(box, *rooms))
    ends = here.home + rng.uniform(-0.5, 0.5, (2, 6))
    found = Obstacles.of(replace(here, surroundings=around), 0.01, ends, bool(rng.integers(2)))
    return found.scene, ends, found.numbers


def _ways(rng: Generator) -> Arguments:
    """Pieces from a crowded posture to one farther away."""
    scene, ends, numbers = _scene(rng)
    start = ends[:1] + rng.uniform(-0.5, 0.5, (N, 6))
    return scene, ends, numbers, start, start + rng.uniform(-0.2, 0.2, (N, 6))


def _growing(rng: Generator) -> Arguments:
    """Two trees of a posture each."""
    scene, ends, numbers = _scene(rng)
    q = np.zeros((2, 12, 6))
    q[:, 0] = ends
    trees = q, np.full((2, 12), -1), np.array([1, 1, rng.integers(2), -1, -1, 200])
    return scene, ends, numbers, ends[0] + rng.uniform(-0.6, 0.6, (N, 6)), 0.3, trees


EXAMPLES: dict[str, Callable[[Generator], Arguments]] = {
    "link_poses": _turns,
    "flange_poses": _turns,
    "fixed_chain_poses": _measured_chain,
    "end_points": lambda rng: (_poses(rng), np.array([0, 3, 6]), rng.uniform(-1.0, 1.0, (3, 2, 3))),
    "end_points_of": lambda rng: (_poses(rng), rng.integers(0, 7, N), rng.uniform(-1.0, 1.0, (N, 2, 3))),
    "point_velocity": lambda rng: (_poses(rng), _rates(rng), rng.uniform(-1.0, 1.0, (3, N))),
    "point_acceleration": lambda rng: (_poses(rng), _rates(rng), _rates(rng), rng.uniform(-1.0, 1.0, (3, N))),
    "fastest": lambda rng: (_poses(rng), _rates(rng), np.array([2, 6]), rng.uniform(-0.3, 0.3, (2, 3))),
    "momentum": lambda rng: (_poses(rng), _rates(rng), np.arange(6.0), rng.uniform(-1.0, 1.0, (6, 3))),
    "chain_torques": _loaded,
    "torque_terms": _loaded,
    "pair_distances": _segments,
    "shape_distances": _shapes,
    "all_shape_distances": lambda rng: [_shapes(rng)[i] for i in (0, 1, 3)],
    "drag_paths": _flown,
    "drag_landings": lambda rng: (_released(rng), 0.3, (0.004, 10.0), AIR),
    "states_at": lambda rng: (rng.uniform(-0.01, 0.09, N), 500.0, _motion(rng)[1]),
    "joint_rates": lambda rng: (_motion(rng)[1], 0.002, np.array([1, 2, 5, 9, 40])),
    "derivative_bounds": lambda rng: (np.abs(rng.uniform(-1.0, 1.0, (3, 6, N))),),
    "load_bounds": _loads,
    "joint_extremes": _motion,
    "ways": _way,
    "exit_cells": _cells,
    "capsule_bounds": _grid,
    "patch_distances": _patches,
    "pieces_clear": _ways,
    "grow_trees": _growing,
    "jacobians": lambda rng: (_poses(rng), rng.uniform(-0.3, 0.3, 3)),
    "branches": _flanges,
    "least_norms": lambda rng: (_states(rng)[0], LIMITS**2, rng.uniform(-1.0, 1.0, (2 * N, 3)), 1e-13),
    "largest_shares": lambda rng: (_states(rng)[2], LIMITS),
    "lower_shares": lambda rng: (_states(rng), LIMITS, NORMS, (0.1, 1e-13), 2),
    "penalised_bounds": _launches,
    "distinct_rows": lambda rng: (rng.uniform(-0.4, 0.4, (100, 6)), 0.35, 48),
}
