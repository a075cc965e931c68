"""The release window: stages of fixed length around the release, at whose ends the object would still hit."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from planner.backends.casadi_nlp import bounds as bound
from planner.backends.casadi_nlp.exactness import tool_point
from planner.backends.casadi_nlp.layout import STEP, TIME_SCALE
from planner.backends.casadi_nlp.table import Table
from planner.flight import landing_points
from planner.problem import TargetRelease, ThrowProblem

Vector = NDArray[np.float64]
At = Callable[[Vector], tuple[Vector, Vector, Vector]]

USUAL_STAGES = 4  # on either side of the release; one stage alone releases 2 to 3 % later, more bring nothing
STAGE_S = 0.005  # [s] that one of them lasts at least
MOST_STAGES = 8  # in a longer window: between the ends of still longer stages landings stray
LONG_STAGE_S = 0.00625  # [s] that these last at least; shorter ones converge less often
DRIFT_SHARE = 2.0  # [-] of tolerance over window, for the change of the landing with the instant
FALL_MIN = 0.05  # [m^2/s^2] least discriminant: below, the object only grazes the plane
LOOKS = 4  # at the landings of each stage once the motion is on ticks
USED = 0.99  # [-] of the tolerance, that the certificate finds enough of it
TINY_M = 1e-9  # [m] keeps a miss away from zero
ROUNDING = 1e-9  # [-] of a number of stages


def stages(problem: ThrowProblem) -> int:
    """Returns how many stages make up the window before the release, and as many after it; 0 without a window.

    A place and velocity that are asked for leave a window little to choose: one stage does.
    """
    if not problem.is_robust:
        return 0
    if not isinstance(problem.release, TargetRelease):
        return 1
    usual, most = (_fitting(problem, least_s) for least_s in (STAGE_S, LONG_STAGE_S))
    return max(1, min(USUAL_STAGES, usual), min(MOST_STAGES, most))


def _fitting(problem: ThrowProblem, least_s: float) -> int:
    """Returns how many stages of `least_s` [s], or of a tick if that is longer, the window has room for."""
    return math.floor(problem.release_window_s / max(least_s, problem.dt) + ROUNDING)


def hold(b: bound.Bounds, table: Table, problem: ThrowProblem, share: float, shift: Vector | float) -> None:
    """Bounds the landings of releases at the window's knots, and how fast the landing moves at the release itself.

    Args:
        b: to be narrowed.
        table: of the assembled problem.
        problem: says window and tolerance.
        share: of the tolerance that may be used in each of two directions [-].
        shift: by how much the landings are to be taken for farther off than they are (2 n + 1, 2) [m].
    """
    around, tolerance, k = problem.release_window_s, problem.landing_tolerance_m, table.shape.launch
    n, miss = table.shape.window, share * problem.landing_tolerance_m
    moved = np.broadcast_to(shift, (2 * n + 1, 2))
    for offset in (o for o in range(-n, n + 1) if o):
        rows = bound.release_row(table, "landing", offset)
        b.g[0, rows], b.g[1, rows] = -miss - moved[n + offset], miss - moved[n + offset]
        b.g[0, bound.release_row(table, "falls", offset)] = FALL_MIN
    rows, drift = bound.release_row(table, "drift"), DRIFT_SHARE * tolerance / around
    b.g[0, rows], b.g[1, rows] = -drift, drift
    b.x[:, k - n : k + n, STEP] = around / n / TIME_SCALE


def misses(problem: ThrowProblem, at: At, release_s: float) -> Vector:
    """Returns how far from the nominal landing releases in the window land without drag (2 n LOOKS + 1, 2) [m].

    Args:
        problem: says the window.
        at: gives q, qd, qdd (k, 6) at times (k,) [s].
        release_s: the nominal instant on the same clock [s].
    """
    around = problem.release_window_s
    q, qd, _ = at(release_s + np.linspace(-around, around, 2 * LOOKS * stages(problem) + 1))
    landed = landing_points(*tool_point(problem, q, qd), problem.plane_z, problem.gravity)[:, :2]
    return landed - landed[len(landed) // 2]


def beyond(problem: ThrowProblem, missed: Vector) -> Vector:
    """Returns by how much landings next to each of the window's knots are too far off (2 n + 1, 2) [m].

    Args:
        problem: says the tolerance.
        missed: of `misses`.
    """
    far = np.linalg.norm(missed, axis=1)
    over = missed * np.maximum(1.0 - USED * problem.landing_tolerance_m / np.maximum(far, TINY_M), 0.0)[:, None]
    near = [slice(max(i - LOOKS + 1, 0), i + LOOKS) for i in range(0, len(missed), LOOKS)]
    return np.array([over[rows][far[rows].argmax()] for rows in near])
