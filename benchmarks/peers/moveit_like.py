"""A pipeline of the kind that MoveIt users build: a path by RRT-Connect, timed by TOPP-RA, then the throw.

The path leads from the start to the run-up posture, where the arm stops: time parameterisations of such pipelines (TOTG
and TOPP-RA alike) begin and end at rest. From there the throw is a straight line in joint space that passes the release
at speed. TOPP-RA knows no jerk, so the motion is averaged over a moving window, as a smoothing adapter does. The path
is planned clear of everything; throw, torques and tool speed are looked at afterwards.
"""

from __future__ import annotations

import logging
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.arm import PeerArm, Problem
from benchmarks.peers.motions import WITHIN, Answer, answer, is_right, refusal, straight_throw, thrown
from benchmarks.peers.releases import release_states

Vector = NDArray[np.float64]

TRIES = 20  # release states
WANTED = 3  # answers, the soonest of which counts
MARGIN_M = 0.002  # [m] beyond the clearances, on the path
STEP_RAD = 0.3  # [rad] a tree grows by
RESOLUTION_RAD = 0.04  # [rad] between checked postures
NODES = 2000
SHORTCUTS = 60


def plan(problem: Problem) -> Answer:
    """Returns the answer to a problem of ThrowBench."""
    arm = PeerArm(problem)
    rate = float(problem["sample_rate_hz"])
    rng = np.random.default_rng(1)
    found = []
    for state in release_states(problem, arm, TRIES):
        run_up = straight_throw(arm, rate, state)[0]
        if np.any(run_up < arm.q_lower) or np.any(run_up > arm.q_upper):
            continue
        path = _path(arm, run_up, rng)
        approach = None if path is None else _timed(arm, rate, path)
        if approach is None:
            continue
        motion = thrown(arm, rate, approach, state)
        if is_right(arm, rate, *motion):
            found.append(motion)
        if len(found) == WANTED:
            break
    if not found:
        return refusal("no release state with a path to its run-up")
    q, qd, release = min(found, key=lambda motion: motion[2])
    return answer(q, qd, release, rate)


def _path(arm: PeerArm, goal: Vector, rng: np.random.Generator) -> list[Vector] | None:
    """Returns waypoints from the start to a goal by RRT-Connect and shortcuts, None where none were found."""
    if arm.room(goal[None])[0] < MARGIN_M:
        return None
    trees = [[(arm.start, -1)], [(goal, -1)]]
    for _ in range(NODES):
        drawn = rng.uniform(np.maximum(arm.q_lower, -np.pi), np.minimum(arm.q_upper, np.pi))
        target = goal if len(trees[0]) == 1 else drawn
        reached = _grow(arm, trees[0], target)
        if reached is not None and np.array_equal(reached, goal):
            return [arm.start, goal]
        if reached is not None:
            other = _connect(arm, trees[1], reached)
            if other:
                both = _branch(trees[0])[::-1] + _branch(trees[1])[1:]
                return _shortened(arm, both if np.array_equal(both[0], arm.start) else both[::-1], rng)
        trees.reverse()
    return None


def _grow(arm: PeerArm, tree: list[tuple[Vector, int]], target: Vector) -> Vector | None:
    nearest = int(np.argmin([np.abs(q - target).max() for q, _ in tree]))
    away = target - tree[nearest][0]
    far = np.abs(away).max()
    whole = len(tree) == 1  # the straight way first
    q = target if whole or far <= STEP_RAD else tree[nearest][0] + STEP_RAD / far * away
    if not _free(arm, tree[nearest][0], q):
        return None
    tree.append((q, nearest))
    return q


def _connect(arm: PeerArm, tree: list[tuple[Vector, int]], target: Vector) -> bool:
    while True:
        q = _grow(arm, tree, target)
        if q is None:
            return False
        if np.array_equal(q, target):
            return True


def _branch(tree: list[tuple[Vector, int]]) -> list[Vector]:
    way = []
    i = len(tree) - 1
    while i >= 0:
        way.append(tree[i][0])
        i = tree[i][1]
    return way


def _free(arm: PeerArm, begin: Vector, end: Vector) -> bool:
    count = max(2, int(np.ceil(np.abs(end - begin).max() / RESOLUTION_RAD)) + 1)
    return bool(arm.room(begin + np.linspace(0.0, 1.0, count)[1:, None] * (end - begin)).min() >= MARGIN_M)


def _shortened(arm: PeerArm, path: list[Vector], rng: np.random.Generator) -> list[Vector]:
    for _ in range(SHORTCUTS):
        if len(path) < 3:
            break
        i, j = sorted(rng.choice(len(path), 2, replace=False))
        if j - i > 1 and _free(arm, path[i], path[j]):
            path = [*path[: i + 1], *path[j:]]
    return path


def _timed(arm: PeerArm, rate: float, path: list[Vector]) -> Vector | None:
    """Returns velocities on ticks (n, 6) of TOPP-RA along straight pieces, each from rest to rest; None without."""
    pieces = [_piece(arm, rate, begin, end) for begin, end in pairwise(path)]
    if any(piece is None for piece in pieces):
        return None
    rest = np.zeros((int(0.08 * rate), 6))
    return np.concatenate([row for piece in pieces if piece is not None for row in (piece, rest)])


def _piece(arm: PeerArm, rate: float, begin: Vector, end: Vector) -> Vector | None:
    import toppra
    from toppra import algorithm, constraint

    logging.getLogger("toppra").setLevel(logging.ERROR)
    if np.abs(end - begin).max() < 1e-6:
        return np.zeros((1, 6))
    line = toppra.SplineInterpolator([0.0, 0.5, 1.0], np.array([begin, 0.5 * (begin + end), end]))
    velocity = constraint.JointVelocityConstraint(np.column_stack([-arm.qd_max, arm.qd_max]) * WITHIN)
    acceleration = constraint.JointAccelerationConstraint(np.column_stack([-arm.qdd_max, arm.qdd_max]) * WITHIN**2)
    timed = algorithm.TOPPRA([velocity, acceleration], line, parametrizer="ParametrizeConstAccel")
    motion = timed.compute_trajectory(0.0, 0.0)
    if motion is None:
        return None
    ticks = int(np.ceil(motion.duration * rate)) + 1
    q = motion(np.minimum(np.arange(ticks + 1) / ticks, 1.0) * motion.duration)
    steps = np.diff(q, axis=0) * rate
    qd = np.concatenate([np.zeros((1, 6)), 0.5 * (steps[1:] + steps[:-1]), np.zeros((1, 6))])
    share = np.abs(end - begin).max() / np.abs(qd.sum(axis=0) / rate).max()  # half a step is lost at both ends
    return share * qd
