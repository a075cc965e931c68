"""TOPP-RA: time-optimal path parameterization, the fastest timing of a given path through the release.

Every path enters the release along the release velocity, so the speed there is exact; the brake runs straight along
it. The timing steps in acceleration and is averaged over the narrowest window that keeps the jerk limit, with half a
window of constant speed on each side of the release.
"""

from planner.backends.toppra_path.motions import VARIANTS, solve
from planner.backends.toppra_path.parameterization import toppra_module

__all__ = ["VARIANTS", "solve", "toppra_module"]
