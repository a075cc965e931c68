"""Problems that are feasible by construction, with starts far from the release: some ways need a stop.

A joint state is drawn with a certified throw through it from a run-up posture at rest, and a start up to 3 rad from it
in every joint with a certified way from rest to rest to the run-up posture. Both in a row are a certified motion, so a
planner that refuses the problem is wrong. In every second problem the straight way is blocked, so that the known one
stops on a corner of a path.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from benchmarks.problem_sets.named_sets import ARMS, cell, point_of, pose_of, states, target_of
from benchmarks.problem_sets.task import Task
from planner.approach import find_approach
from planner.backends import ruckig_otg
from planner.cell import Cell
from planner.certificate import certify
from planner.errors import InvalidProblem, SolverFailed
from planner.geometry import body_model
from planner.problem import JointRelease, ThrowProblem
from planner.seeds import Candidate
from planner.trajectory import Trajectory, in_a_row

Vector = NDArray[np.float64]

FAR_RAD = 3.0  # [rad] farthest start from the release, in every joint
RUN_UPS_S = (0.15, 0.3, 0.5)  # [s] of constant acceleration from the run-up posture to the release
PACE = 3.0  # [-] of an approach, for the way to the run-up posture
SPREAD_RAD = 1.5
SPEED_SHARE = 0.6  # [rad] around home and [-] of the velocity limit, for the release
TIME_LIMIT_S = 60.0  # [s] ample: work ends a search, not the clock
STARTS = 20  # starts drawn for one release
KINDS = (pose_of, point_of, target_of)


def far_start_tasks(count: int, seed: int) -> list[Task]:
    """Returns `count` tasks, the arms and the kinds of release in turn."""
    streams = [_tasks(cell(arm), np.random.default_rng([seed, 21, rank]), seed) for rank, arm in enumerate(ARMS)]
    return [next(streams[i % len(ARMS)]) for i in range(count)]


def _tasks(here: Cell, rng: np.random.Generator, seed: int) -> Iterator[Task]:
    number = 0
    for state in states(here, seed + 1000, _near_home):
        throw = _throw(here, state)
        release = KINDS[number // 2 % len(KINDS)](here, state)
        motion = None if throw is None or release is None else _from_afar(here, state, throw, rng, number % 2 == 1)
        if motion is not None and release is not None:
            problem = ThrowProblem(here, motion.q[0], release, here.limits, time_limit_s=TIME_LIMIT_S)
            yield Task(f"far-start/{here.name}/{number:04d}", problem, state, motion)
            number += 1


def _near_home(here: Cell, rng: np.random.Generator) -> tuple[Vector, Vector]:
    limits = here.limits
    q = np.clip(here.home + rng.uniform(-SPREAD_RAD, SPREAD_RAD, 6), limits.q_lower, limits.q_upper)
    return q, rng.uniform(-SPEED_SHARE, SPEED_SHARE, 6) * limits.qd_max


def _throw(here: Cell, state: JointRelease) -> Trajectory | None:
    """Returns a certified throw through a state from a run-up posture behind it; None if none is found."""
    for run_up_s in RUN_UPS_S:
        try:
            problem = ThrowProblem(here, state.q - 0.5 * run_up_s * state.qd, state, here.limits)
            motion = ruckig_otg.solve(problem, Candidate(state.q, state.qd, 0.0, "known")).trajectory
        except (InvalidProblem, SolverFailed):
            continue
        if certify(problem, motion).valid and _leads_home(here, motion):
            return motion
    return None


def _leads_home(here: Cell, motion: Trajectory) -> bool:
    """Returns whether a certified way home was found from the end of a throw."""
    return find_approach(here, motion.q[-1], here.home, with_object=False)[0] is not None


def _from_afar(
    here: Cell, state: JointRelease, throw: Trajectory, rng: np.random.Generator, with_stop: bool
) -> Trajectory | None:
    """Returns a certified motion from a random start to the throw's start, and the throw; None if none is found.

    With a stop only starts count whose straight way is blocked.
    """
    for _ in range(STARTS):
        offset = rng.uniform(-FAR_RAD, FAR_RAD, 6)
        start = np.clip(state.q + offset, here.limits.q_lower, here.limits.q_upper)
        if body_model(here).clearances(start[None]).least[0] < 0.0:
            continue
        way, blocked = find_approach(here, start, throw.q[0], PACE)
        if way is None or way.trajectory is None or (with_stop and not blocked):
            continue
        motion = in_a_row(way.trajectory, throw)
        if certify(ThrowProblem(here, start, state, here.limits), motion).valid:
            return motion
    return None
