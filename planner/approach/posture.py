"""A posture at rest by the rule of the certificate: what is too close, and which way leads clear.

An arm at rest may stand closer than the rule allows: it is measured a little off the plan's end, or it was stopped or
jogged there. A short way out is then found by the steepest ascent of the smallest clearance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.approach.rest_to_rest import rest_to_rest_motion
from planner.arrays import Array
from planner.cell import Cell
from planner.certificate import Check, Examination
from planner.errors import InvalidProblem
from planner.geometry import body_model
from planner.problem import JointRelease, ThrowProblem

RECOVERABLE_M = 0.002  # [m] less than the rule asks from which Fling moves clear: 2 mrad at a reach of 1 m, and bending
SPARE_M = 0.001  # [m] beyond the rule to which it moves
STEP_RAD = 0.02  # [rad] largest turn of a joint on the way clear
STEPS_MAX = 10  # [-] such steps
DIFFERENCE_RAD = 1e-4  # [rad] for the slope of the clearance by each joint
INSTANTS = 9  # [-] postures at which a step is checked


def way_clear(cell: Cell, q: Array, with_object: bool = True) -> Array | None:
    """Returns postures (K, 6) from `q` (6,) to one that the rule accepts: `q` alone where it does already.

    On the way no clearance gets smaller than it is at `q`. None where `q` is too close by more than `RECOVERABLE_M`, or
    no way is found.
    """
    body = body_model(cell)
    path = [q]
    least = float(body.clearances(q[None], with_object).least[0])
    if least >= 0.0:
        return np.array(path)
    if least < -RECOVERABLE_M:
        return None
    for _ in range(STEPS_MAX):
        slope = _slopes(cell, path[-1], with_object)
        step = slope * min(
            STEP_RAD / max(float(np.abs(slope).max()), 1e-9), (SPARE_M - least) / float(slope @ slope + 1e-9)
        )
        line = path[-1] + np.linspace(0.0, 1.0, INSTANTS)[:, None] * step
        along = body.clearances(line, with_object).least
        if (along < least - 1e-9).any() or (line < cell.limits.q_lower).any() or (line > cell.limits.q_upper).any():
            return None
        path = [*path, line[-1]]
        least = float(along[-1])
        if least >= 0.5 * SPARE_M:
            return np.array(path)
    return None


def jog_advice(cell: Cell, q: Array, with_object: bool = True) -> str:
    """Returns what is too close at a posture (6,) and how to jog the arm by hand; "" where nothing is too close."""
    try:
        close = too_close(cell, q, with_object)
    except InvalidProblem as error:
        return f"jog the arm by hand: {error}"
    if not close:
        return ""
    slope = _slopes(cell, q, with_object)
    joint = int(np.abs(slope).argmax())
    direction = "positive" if slope[joint] > 0.0 else "negative"
    return (
        f"the arm stands too close ({obstacle_words(close)}): jog it by hand; "
        f"{cell.robot.joint_names[joint]} in the {direction} direction increases the distance most"
    )


def too_close(cell: Cell, q: Array, with_object: bool = True) -> list[Check]:
    """Returns the failed checks of the clearance of an arm at rest at a posture (6,) [rad].

    Raises:
        InvalidProblem: the posture is beyond the cell's limits.
    """
    still = rest_to_rest_motion(np.array([q, q]), cell.limits, 1.0 / cell.robot.sample_rate_hz)
    problem = ThrowProblem(cell, q, JointRelease(q, np.zeros(6)), cell.limits, holds_object=with_object)
    return [check for check in Examination(problem, still).failures if check.unit == "m"]


def obstacle_words(checks: Sequence[Check]) -> str:
    """Returns the failed checks of a move from rest to rest in words, with their numbers."""
    return " and ".join(f"{_where(check)} ({_numbers(check)})" for check in checks)


def _where(check: Check) -> str:
    """Returns what a failed check is about."""
    first, _, second = check.detail.partition(", ")
    words = {
        "self_collision": f"{first} and {second}",
        "floor": f"{first} and the floor",
        "keep_out": f"{first} and keep-out {second}",
        "keep_in": f"the tool and a wall of {f'keep-in {second}' if second else 'the keep-in boxes'}",
    }
    return words.get(check.name, f"{check.name} of {check.detail}" if check.detail else check.name)


def _numbers(check: Check) -> str:
    """Returns value and limit of a failed check; distances in millimetres."""
    if check.unit == "m":
        return f"{1e3 * check.value:.1f} mm, at least {1e3 * check.limit:.1f} mm"
    return f"{check.value:.4g} against {check.limit:.4g} {check.unit}"


def _slopes(cell: Cell, q: Array, with_object: bool) -> Array:
    """Returns the slope (6,) [m/rad] of the smallest clearance by each joint."""
    steps = DIFFERENCE_RAD * np.eye(6)
    least = body_model(cell).clearances(np.concatenate([q + steps, q - steps]), with_object).least
    return (least[:6] - least[6:]) / (2.0 * DIFFERENCE_RAD)
