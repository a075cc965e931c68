"""TOPP-RA: the fastest timing of a path through the release. Jerk is not its business.

The path decides what can be had, so several are offered. All enter the release with its velocity as their tangent, so
the speed there is exact. The brake runs straight along the velocity. The timing accelerates in steps: it is averaged
over the shortest window that keeps the jerk limit, with half a window of constant speed on each side of the release.
"""

from __future__ import annotations

from planner.backends.toppra_path.launches import LAUNCHES, raw_motion
from planner.problem import ThrowProblem
from planner.seeds.candidates import Candidate
from planner.solution import Solution
from planner.timing.smoothing import smooth

PATHS = tuple(LAUNCHES)


def solve(problem: ThrowProblem, candidate: Candidate, path: str = "joint") -> Solution:
    """Returns the fastest motion along the path through the candidate to rest.

    Args:
        problem: whose start, limits and ends of the arm hold.
        candidate: the release state.
        path: one of `PATHS`.

    Raises:
        SolverFailed: the release's speed cannot be had along the path within the limits, or there is no such path.
        BackendUnavailable: toppra is not installed.
    """
    trajectory, width = smooth(
        problem, candidate, lambda limits, width: raw_motion(problem, candidate, path, limits, width)
    )
    status = (
        f"time-optimal along {LAUNCHES[path]} without regard to jerk; "
        f"averaged over {1e3 * width:.0f} ms to keep the jerk limit"
    )
    return Solution(trajectory, status)
