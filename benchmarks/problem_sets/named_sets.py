"""The named problem sets. The same name, count and seed give the same problems."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.problem_sets import sdu_table
from benchmarks.problem_sets.posture import allowed, height, tool_position, tool_velocity
from benchmarks.problem_sets.task import Task
from planner.cell import Cell, load_cell
from planner.flight import fly
from planner.kinematics import forward, jacobian
from planner.problem import JointRelease, PointRelease, PoseRelease, Release, TargetRelease, ThrowProblem

Vector = NDArray[np.float64]

CELLS = Path(__file__).parents[2] / "cells"
ARMS = ("ur5e-sim", "ur3e-sim", "ur10e-sim", "ur5-sim")
SPREAD = 1.5  # [rad] around home, for joint positions
SPEED_SHARE = 0.8  # [-] of the velocity limit, for joint velocities
SPEED_MIN = 0.8  # [m/s] of the tool: slower ones are not throws
RANGE_MIN = 0.3  # [m] horizontally from release to target
ANYWHERE = "-anywhere"  # suffix of a set with the same releases, but random starts instead of home
IMPOSSIBLE_SETS = ("unreachable", "too-fast")
WINDOW_S = 0.02
TOLERANCE_M = 0.005  # [s], [m] of the robust set
WIDE_WINDOW_S = 0.03  # [s] of the set robust-30
NEAR_LIMIT = 0.03  # [-] of the joint range: a state this close to a limit is "near a limit"
NEAR_FLOOR_M = 0.05  # [m] beyond the clearance: "near the floor"
NEAR_SINGULAR = 0.05  # [1] beyond the cell's minimum distance: "near a singularity"

Draw = Callable[[Cell, np.random.Generator], tuple[Vector, Vector]]


@cache
def cell(name: str) -> Cell:
    """Returns a shipped cell."""
    return load_cell(CELLS / f"{name}.toml")


def build(name: str, count: int, seed: int) -> list[Task]:
    """Returns the tasks of a set, spread over the arms.

    Args:
        name: Name of the set.
        count: Number of tasks; `sdu-near` and `sdu-far` have fixed numbers.
        seed: Seed of the random draws.
    """
    if name.startswith("sdu"):
        return sdu_table.tasks(name, cell("sdu-table"), count, seed)
    family = name.removesuffix(ANYWHERE)
    makers = {
        "pose": lambda arm, share: _drawn("pose", arm, share, seed, pose_of),
        "point": lambda arm, share: _drawn("point", arm, share, seed, point_of),
        "target": lambda arm, share: _drawn("target", arm, share, seed, target_of),
        "robust": lambda arm, share: _robust("robust", arm, share, seed, WINDOW_S),
        "robust-30": lambda arm, share: _robust("robust-30", arm, share, seed, WIDE_WINDOW_S),
        "hard": lambda arm, share: _hard(arm, share, seed),
        "unreachable": lambda arm, share: _unreachable(arm, share, seed),
        "too-fast": lambda arm, share: _too_fast(arm, share, seed),
    }
    shares = [len(part) for part in np.array_split(np.arange(count), len(ARMS))]
    per_arm = [makers[family](arm, share) for arm, share in zip(ARMS, shares, strict=True)]
    if name != family:
        per_arm = [list(map(partial(_moved, family), tasks, _starts(tasks, seed))) for tasks in per_arm]
    return [task for rank in range(max(shares)) for tasks in per_arm for task in tasks[rank : rank + 1]]


def states(here: Cell, seed: int, draw: Draw) -> Iterator[JointRelease]:
    """Yields feasible joint states in a sequence determined by seed and cell."""
    rng = np.random.default_rng([seed, ARMS.index(here.name)])
    while True:
        q, qd = draw(here, rng)
        if np.linalg.norm(tool_velocity(here, q, qd)) >= SPEED_MIN and allowed(here, q, qd):
            yield JointRelease(q, qd)


def _anywhere(here: Cell, rng: np.random.Generator) -> tuple[Vector, Vector]:
    limits = here.limits
    q = np.clip(here.home + rng.uniform(-SPREAD, SPREAD, 6), limits.q_lower, limits.q_upper)
    return q, rng.uniform(-SPEED_SHARE, SPEED_SHARE, 6) * limits.qd_max


def _drawn(
    group: str,
    arm: str,
    count: int,
    seed: int,
    ask: Callable[[Cell, JointRelease], Release | None],
    draw: Draw = _anywhere,
) -> list[Task]:
    here = cell(arm)
    tasks = []
    for state in states(here, seed, draw):
        release = ask(here, state)
        if release is None:
            continue
        if len(tasks) == count:
            break
        problem = ThrowProblem(here, here.home, release, here.limits)
        tasks.append(Task(f"{group}/{arm}/{len(tasks):04d}", problem, state))
    return tasks


def _starts(tasks: list[Task], seed: int) -> Iterator[Vector]:
    """Yields a start for every task of an arm, drawn like its release, but at rest."""
    if not tasks:
        return
    here = tasks[0].problem.cell
    rng = np.random.default_rng([seed, ARMS.index(here.name), 1])
    for _ in tasks:
        while not allowed(here, q := _anywhere(here, rng)[0], np.zeros(6)):
            pass
        yield q


def _moved(family: str, task: Task, start: Vector) -> Task:
    """Returns the task with another start, as part of the set's `-anywhere` variant."""
    return replace(
        task, name=task.name.replace(family, family + ANYWHERE, 1), problem=replace(task.problem, start=start)
    )


def pose_of(here: Cell, state: JointRelease) -> PoseRelease:
    """Returns the release with a joint state's tool pose and twist."""
    X_WT = here.X_WB @ forward(here.robot, state.q, here.tool.X_FT)
    V_BT = jacobian(here.robot, state.q, here.tool.X_FT) @ state.qd
    R_WB = here.X_WB[:3, :3]
    return PoseRelease(X_WT, np.concatenate([R_WB @ V_BT[:3], R_WB @ V_BT[3:]]))


def point_of(here: Cell, state: JointRelease) -> PointRelease:
    """Returns the release with a joint state's tool position and velocity."""
    return PointRelease(tool_position(here, state.q), tool_velocity(here, state.q, state.qd))


def target_of(here: Cell, state: JointRelease) -> TargetRelease | None:
    """Returns the target that a release in a joint state hits; None where it is too near."""
    p = tool_position(here, state.q)
    v = tool_velocity(here, state.q, state.qd)
    flight = fly(p, v, here.surroundings.floor_z_m, here.surroundings.gravity_m_s2)
    if flight is None or np.linalg.norm((flight.landing_point - p)[:2]) < RANGE_MIN:
        return None
    return TargetRelease(flight.landing_point)


def _robust(group: str, arm: str, count: int, seed: int, window_s: float) -> list[Task]:
    """Returns the problems of `target` with a release window."""
    tasks = []
    for task in _drawn("target", arm, count, seed, target_of):
        problem = replace(task.problem, release_window_s=window_s, landing_tolerance_m=TOLERANCE_M)
        tasks.append(Task(task.name.replace("target", group, 1), problem, task.state))
    return tasks


def _hard(arm: str, count: int, seed: int) -> list[Task]:
    """Returns poses near joint limits, singularities and the floor, and with joints near their velocity limit."""
    draws = (_near_limit, _near_singular, _near_floor, _nearly_too_fast)
    shares = [len(part) for part in np.array_split(np.arange(count), len(draws))]
    tasks = []
    for draw, share in zip(draws, shares, strict=True):
        name = draw.__name__.strip("_")
        for task in _drawn("hard", arm, share, seed, pose_of, draw):
            tasks.append(Task(task.name.replace(arm, f"{arm}-{name}"), task.problem, task.state))
    return tasks


def _near_limit(here: Cell, rng: np.random.Generator) -> tuple[Vector, Vector]:
    q, qd = _anywhere(here, rng)
    joint = int(rng.integers(6))
    top = bool(rng.integers(2))
    span = NEAR_LIMIT * (here.limits.q_upper - here.limits.q_lower)[joint] * rng.uniform()
    q[joint] = here.limits.q_upper[joint] - span if top else here.limits.q_lower[joint] + span
    return q, qd


def _near_singular(here: Cell, rng: np.random.Generator) -> tuple[Vector, Vector]:
    q, qd = _anywhere(here, rng)
    joint = int(rng.choice([2, 4]))  # elbow, wrist
    least = here.limits.singularity_distance_min
    angle = np.arcsin(least + NEAR_SINGULAR * rng.uniform())
    q[joint] = np.round(q[joint] / np.pi) * np.pi + angle * rng.choice([-1.0, 1.0])
    return q, qd


def _near_floor(here: Cell, rng: np.random.Generator) -> tuple[Vector, Vector]:
    while True:
        q, qd = _anywhere(here, rng)
        if 0.0 <= height(here, q) - here.surroundings.clearance_m <= NEAR_FLOOR_M:
            return q, qd


def _nearly_too_fast(here: Cell, rng: np.random.Generator) -> tuple[Vector, Vector]:
    q, _ = _anywhere(here, rng)
    return q, rng.uniform(0.9, 1.0, 6) * rng.choice([-1.0, 1.0], 6) * here.limits.qd_max


def _unreachable(arm: str, count: int, seed: int) -> list[Task]:
    """Returns points beyond the arm's reach (1.3 to 3 times as far), and targets beyond any throw."""
    here = cell(arm)
    rng = np.random.default_rng([seed, 7])
    tasks = []
    reach = float(np.hypot(here.robot.a, here.robot.d).sum() + here.tool.X_FT[2, 3])
    for i in range(count):
        angle = rng.uniform(-np.pi, np.pi)
        far = rng.uniform(1.3, 3.0) * reach
        p = here.X_WB[:3, 3] + np.array([far * np.cos(angle), far * np.sin(angle), rng.uniform(0.1, 0.6)])
        X = np.eye(4)
        X[:3, 3] = p
        v = rng.uniform(-1.0, 1.0, 3)
        ground = np.array([8.0 * p[0], 8.0 * p[1], here.surroundings.floor_z_m])
        release = (PointRelease(p, v), PoseRelease(X, np.concatenate([v, np.zeros(3)])), TargetRelease(ground))[i % 3]
        problem = ThrowProblem(here, here.home, release, here.limits)
        tasks.append(Task(f"unreachable/{arm}/{i:04d}", problem))
    return tasks


def _too_fast(arm: str, count: int, seed: int) -> list[Task]:
    """Returns reachable points with twice the cell's maximum tool speed."""
    tasks = []
    for task in _drawn("too-fast", arm, count, seed + 1, point_of):
        here = task.problem.cell
        release = task.problem.release
        assert isinstance(release, PointRelease)
        faster = 2.0 * here.limits.tcp_speed_max * release.v_WT / np.linalg.norm(release.v_WT)
        problem = replace(task.problem, release=PointRelease(release.p_WT, faster))
        tasks.append(Task(task.name, problem))
    return tasks
