"""How long the certificate of a plan of 1.5 s at 500 Hz takes."""

from __future__ import annotations

import time
from dataclasses import replace
from statistics import median

import numpy as np

from planner.certificate import certify
from planner.planning import plan
from planner.problem import TargetRelease, ThrowProblem
from planner.trajectory import Trajectory
from tests.benchmarks.sets import cell

SLOW_JOINTS = 2.0, 15.0  # [rad/s^2, rad/s^3] limits that make a throw last about so long
TARGET = np.array([1.1, 0.3, 0.0])
REPEATS = 25


def certificate_time() -> tuple[int, float]:
    """Returns the samples of a robust throw with a tool, and the median processor time of its certificate [s]."""
    here = cell("ur5e-sim")
    limits = replace(here.limits, qdd_max=np.full(6, SLOW_JOINTS[0]), jerk_max=np.full(6, SLOW_JOINTS[1]))
    problem = ThrowProblem(
        here, here.home, TargetRelease(TARGET), limits, release_window_s=0.02, landing_tolerance_m=0.01
    )
    motion = plan(problem).trajectory
    return len(motion.q), median(_once(problem, motion) for _ in range(REPEATS))


def _once(problem: ThrowProblem, motion: Trajectory) -> float:
    fresh = Trajectory(motion.sample_rate_hz, motion.q, motion.qd, motion.qdd, motion.release_index)  # nothing cached
    begun = time.process_time()
    certify(problem, fresh)
    return time.process_time() - begun
