"""A slow, simple search for any certified motion to a joint state, to tell unsolved problems from infeasible ones.

Launches are Ruckig's from the start, straight or through a posture at rest, at several shares of the limits. Brakes are
Ruckig's too, or a launch from a posture at rest run backwards. The first certified pair counts. A problem without one
is undecided, not infeasible.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.backends import ruckig_otg
from planner.certificate import certify
from planner.errors import SolverFailed
from planner.problem import JointRelease, ThrowProblem
from planner.seeds import Candidate
from planner.trajectory import Trajectory, join

Vector = NDArray[np.float64]
Samples = tuple[Vector, Vector, Vector]

SEARCH = "known"  # name of this search in the rows
VIAS = 12  # postures: stops on the way, and ends of the brake
VIA_SPREAD = 1.2  # [rad] around start and release
SHARES = (1.0, 0.6, 0.35)  # of acceleration and jerk


def find_certified_motion(problem: ThrowProblem, state: JointRelease, seed: int = 0) -> Trajectory | None:
    """Returns a certified motion from the problem's start through a joint state, or None if it finds none."""
    nominal = replace(problem, release=state, release_window_s=0.0, landing_tolerance_m=0.0)
    vias = _vias(nominal, state, seed)
    brakes = list(_brakes(nominal, state, vias[: VIAS // 3]))
    for launch in _launches(nominal, state, vias):
        for brake in brakes:
            motion = join(launch, brake, float(nominal.cell.robot.sample_rate_hz))
            certificate = certify(nominal, motion)
            if certificate.valid:
                return motion
            if any(c.at_s is None or c.at_s < motion.release_time_s - 1e-9 for c in certificate.failures):
                break
    return None


def _vias(problem: ThrowProblem, state: JointRelease, seed: int) -> list[Vector]:
    rng = np.random.default_rng(seed)
    limits = problem.limits
    share = rng.uniform(0.0, 1.0, (VIAS, 1))
    near = problem.start + share * (state.q - problem.start) + rng.uniform(-VIA_SPREAD, VIA_SPREAD, (VIAS, 6))
    return list(np.clip(near, limits.q_lower, limits.q_upper))


def _launches(problem: ThrowProblem, state: JointRelease, vias: list[Vector]) -> Iterator[Samples]:
    for share in SHARES:
        yield from _runs(problem, problem.start, state, share)
    for via in vias:
        to_via = next(_runs(problem, problem.start, JointRelease(via, np.zeros(6)), 1.0), None)
        for onward in _runs(problem, via, state, 1.0):
            if to_via is not None:
                q, qd, qdd = (np.concatenate([a, b[1:]]) for a, b in zip(to_via, onward, strict=True))
                yield q, qd, qdd


def _brakes(problem: ThrowProblem, state: JointRelease, ends: list[Vector]) -> Iterator[Samples]:
    for share in SHARES:
        motion = _solve(_slower(problem, share), state, "synchronised")
        if motion is not None:
            k = motion.release_index
            yield motion.q[k:], motion.qd[k:], motion.qdd[k:]
    for end in [problem.start, *ends]:
        for q, qd, qdd in _runs(problem, end, JointRelease(state.q, -state.qd), 1.0):
            yield q[::-1], -qd[::-1], qdd[::-1]


def _runs(problem: ThrowProblem, start: Vector, state: JointRelease, share: float) -> Iterator[Samples]:
    """Yields the samples of Ruckig's launches from rest at `start` to the state."""
    for launch in ruckig_otg.VARIANTS:
        motion = _solve(replace(_slower(problem, share), start=start, release=state), state, launch)
        if motion is not None:
            end = motion.release_index + 1
            yield motion.q[:end], motion.qd[:end], motion.qdd[:end]


def _slower(problem: ThrowProblem, share: float) -> ThrowProblem:
    limits = problem.limits
    slower = replace(limits, qdd_max=share * limits.qdd_max, jerk_max=share * limits.jerk_max)
    return replace(problem, limits=slower)


def _solve(problem: ThrowProblem, state: JointRelease, variant: ruckig_otg.LaunchVariant) -> Trajectory | None:
    try:
        return ruckig_otg.solve(problem, Candidate(state.q, state.qd, 0.0, "known"), variant).trajectory
    except SolverFailed:
        return None
