"""Refusal where the start or the cell's home is blocked: every plan begins at one and must leave a way to the other.

Both postures are given, so that no search is needed to tell.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from planner.approach import NEAR_RAD, obstacle_words, too_close
from planner.arrays import Array
from planner.cell import Cell
from planner.certificate import START_TOLERANCE, Check
from planner.errors import Violation
from planner.geometry import body_model
from planner.problem import ThrowProblem

POSTURES_KEPT = 64  # [-] whose clearance is cached: homes, and where requests begin


def blocked_postures(problem: ThrowProblem) -> list[Violation]:
    """Returns the bounds on the clearance that the start breaks, and that the cell's home does, whatever the motion.

    Where the arm starts at home, what stands in its way is said once.
    """
    found = [
        replace(check.as_violation(), at_s=0.0, detail=f"{check.detail}, at the start", proven=True)
        for check in _broken(problem, problem.start, problem.holds_object, START_TOLERANCE)
    ]
    if found and np.abs(problem.start - problem.cell.home).max() < NEAR_RAD:
        return found
    at_home = _broken(problem, problem.cell.home, not problem.throws, NEAR_RAD)
    if at_home:
        worst = min(at_home, key=lambda check: check.margin)
        words = obstacle_words(at_home)
        detail = f"the cell's home is blocked, and every plan needs a way there: {words}"
        found.append(replace(worst.as_violation(), constraint="way_home", at_s=None, detail=detail, proven=True))
    return found


@lru_cache(maxsize=POSTURES_KEPT)
def _least_clearance(cell: Cell, q: tuple[float, ...], with_object: bool) -> float:
    """Returns how far clear of its limits an arm at `q` (6,) [rad] is, as of `BodyModel.clearances` [m]."""
    return float(body_model(cell).clearances(np.array([q]), with_object).least[0])


def _broken(problem: ThrowProblem, q: Array, with_object: bool, tolerance_rad: float) -> list[Check]:
    """Returns the checks that fail at a posture, and at all that count as the same.

    Args:
        problem: of which the surroundings count, with a bin.
        q: the posture (6,) [rad].
        with_object: whether the object is in the tool there.
        tolerance_rad: largest difference of a joint to a posture that counts as the same [rad].
    """
    body = body_model(problem.cell_with_bin)
    moved_m = tolerance_rad * float(body.levers.sum(axis=1).max())  # the farthest that a point of the arm moves by that
    if _least_clearance(problem.cell_with_bin, tuple(q.tolist()), with_object) >= -moved_m:
        return []
    return [check for check in too_close(problem.cell_with_bin, q, with_object) if check.margin < -moved_m]
