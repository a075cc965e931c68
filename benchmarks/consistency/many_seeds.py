"""A slow search: the optimiser from many random release states, to tell a late answer from the best there is.

The states are drawn without the planner's own sequence, its ranking or its policy: random postures around the start,
with the tool brought to the requested point, or with the velocity of a random flight to the target.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.backends import casadi_nlp, ruckig_otg
from planner.backends.casadi_nlp import SolveOptions
from planner.certificate import certify
from planner.errors import Infeasible, SolverFailed
from planner.flight import launch_velocity, slowest_time
from planner.geometry import tool_pose
from planner.kinematics import inverse
from planner.problem import PointRelease, TargetRelease, ThrowProblem
from planner.rotations import invert_pose
from planner.seeds import Candidate, Seed, allocate_velocity, candidates, tool_jacobian

Vector = NDArray[np.float64]

SEEDS = 48  # release states that are optimised
SPREADS_RAD = (0.4, 1.5)  # [rad] of the postures around the start, in turn: throws close to it, and far from it
FLIGHTS = (0.6, 1.4)  # [-] flight time over that of the slowest throw
DRAWS = 5000  # postures drawn at most
ROUNDS = 4  # solves from one state, with wider margins after failed checks


def soonest_release(problem: ThrowProblem, seed: int) -> float:
    """Returns the soonest certified release time [s] from `SEEDS` states; infinite where none is certified."""
    return min((_optimised(problem, state) for state in _states(problem, seed)), default=np.inf)


def _states(problem: ThrowProblem, seed: int) -> list[Candidate]:
    """Returns the states; for a given pose all candidates, because it leaves nothing to draw."""
    release = problem.release
    qd_max = problem.limits.qd_max
    if not isinstance(release, PointRelease | TargetRelease):
        return candidates(problem)[:SEEDS]
    found: list[Candidate] = []
    for i, q in enumerate(_postures(problem, np.random.default_rng(seed))):
        state = _at_point(problem, release, q) if isinstance(release, PointRelease) else q
        v = release.v_WT if isinstance(release, PointRelease) else _flight(problem, release, q, i)
        if state is None or not np.isfinite(v).all():
            continue
        qd = allocate_velocity(tool_jacobian(problem, state[None]), problem.cell.X_WB[:3, :3].T @ v, qd_max)
        if np.all(np.abs(qd[0]) <= qd_max):
            found.append(Candidate(state, qd[0], 0.0, f"random {i}"))
        if len(found) == SEEDS:
            break
    return found


def _postures(problem: ThrowProblem, rng: np.random.Generator) -> Iterator[Vector]:
    limits = problem.reachable
    for i in range(DRAWS):
        spread = SPREADS_RAD[i % len(SPREADS_RAD)]
        yield np.clip(problem.start + rng.uniform(-spread, spread, 6), limits.q_lower, limits.q_upper)


def _at_point(problem: ThrowProblem, release: PointRelease, q: Vector) -> Vector | None:
    """Returns the posture closest to `q` with the same orientation and the tool at the point, None without one."""
    cell = problem.cell
    limits = problem.reachable
    X_WT = tool_pose(cell, q)
    X_WT[:3, 3] = release.p_WT
    found = inverse(cell.robot, invert_pose(cell.X_WB) @ X_WT, cell.tool.X_FT, limits.q_lower, limits.q_upper).q
    return None if len(found) == 0 else found[np.abs(found - q).max(axis=1).argmin()]


def _flight(problem: ThrowProblem, release: TargetRelease, q: Vector, i: int) -> Vector:
    """Returns the velocity (3,) of a flight to the target; their durations are spread evenly over `FLIGHTS`."""
    p = tool_pose(problem.cell, q)[None, :3, 3]
    share = FLIGHTS[0] + (FLIGHTS[1] - FLIGHTS[0]) * ((i * (np.sqrt(5.0) - 1.0) / 2.0) % 1.0)
    t = share * slowest_time(p, release.p_W, problem.gravity)
    return launch_velocity(p, release.p_W, t, problem.gravity, problem.drag)[0]


def _optimised(problem: ThrowProblem, state: Candidate) -> float:
    """Returns the release time [s] of the certified motion next to a state; infinite without one."""
    try:
        seed = Seed(state, ruckig_otg.initial_guess(problem, state))
        options = SolveOptions()
        for _ in range(ROUNDS):
            solution = casadi_nlp.solve(problem, seed, options)
            certificate = certify(problem, solution.trajectory)
            if certificate.valid:
                return solution.trajectory.release_time_s
            wider = options.margins.widened(certificate.failures, solution)
            if wider is None:
                break
            seed = Seed(state, solution.trajectory)
            options = replace(options, margins=wider)
    except (SolverFailed, Infeasible):
        pass
    return np.inf
