"""What an execution was for a job: a result, and where its object is as far as that is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from jobs.cycles.progress import DROPPED, FAILED, KEPT, MISSED_GRIP, MOVED, NOT_BEGUN, THROWN, UNKNOWN
from store import ExecutionRow, JobCycleRow, LandingRow

AT_PICK = "at its pick"
IN_GRIPPER = "in the gripper"
NOT_MOVED = f"{AT_PICK}, or {IN_GRIPPER} there"


class CycleEnd(NamedTuple):
    """How a motion of a job ended.

    Attributes:
        result: one of `jobs.cycles.progress`.
        object_at: where its object is, in words; None of an approach, which has none.
    """

    result: str
    object_at: str | None


class SeenLanding(NamedTuple):
    """What was seen of a landing.

    Attributes:
        is_hit: whether it was within the room of a hit.
        at: time of the last report [s since the epoch].
        position: mean of the observed positions (3,) [m]; None where a person only told the result.
        error_m: horizontal distance from the target [m].
    """

    is_hit: bool
    at: float
    position: list[float] | None = None
    error_m: float | None = None


def cycle_end(cycle: JobCycleRow, execution: ExecutionRow, was_seen_moving: bool) -> CycleEnd:
    """Returns what a finished execution was for its job.

    An executor that was lost may have moved without anybody being told, so that its execution counts as not begun only
    where it had not claimed it.

    Args:
        cycle: that it belongs to.
        execution: finished.
        was_seen_moving: whether it came to the state `streaming` or `braking`.
    """
    if cycle.kind == "approach":
        return CycleEnd(MOVED if execution.outcome == "completed" else FAILED, None)
    metrics = execution.metrics
    grip = (metrics or {}).get("grip") or {}
    if grip.get("opened_again") and not (metrics or {}).get("released"):
        return CycleEnd(MISSED_GRIP, AT_PICK)
    is_told = execution.outcome in ("refused", "aborted") or execution.claimed_at is None
    if execution.outcome == "refused" or (metrics is None and is_told):
        return CycleEnd(NOT_BEGUN, NOT_MOVED)
    at_target = f"thrown at target {cycle.target}"
    if metrics is None:
        likely = "" if was_seen_moving else f"{AT_PICK}, as no motion was seen, "
        return CycleEnd(UNKNOWN, f"{likely}{IN_GRIPPER}, or {at_target}: the execution left no record")
    return _recorded_end(execution.outcome, metrics, at_target)


def _recorded_end(outcome: str | None, metrics: Mapping[str, Any], at_target: str) -> CycleEnd:
    """Returns what a throw was for its job by its metrics, once it was not refused."""
    if outcome == "released_early":
        return CycleEnd(DROPPED, "dropped on the way, as the reason says")
    if not metrics.get("released") and metrics.get("ticks") == 0:
        return CycleEnd(NOT_BEGUN, NOT_MOVED)
    if outcome == "not_released" or not metrics.get("released"):
        return CycleEnd(KEPT, IN_GRIPPER)
    if outcome == "completed":
        return CycleEnd(KEPT, IN_GRIPPER) if metrics.get("object_left") is False else CycleEnd(THROWN, at_target)
    return CycleEnd(UNKNOWN, f"{at_target}, or {IN_GRIPPER}, as the reason says")


def seen_landing(cycle: JobCycleRow, landings: Sequence[LandingRow]) -> SeenLanding | None:
    """Returns what was seen of the landing of a throw; None where nothing was.

    A result that was told counts before positions, the last one; `edge` is no hit.
    """
    told = [each for each in landings if each.result is not None]
    position = combined_position([each for each in landings if each.position is not None])
    at = max((each.at for each in landings), default=0.0)
    error_m = None
    if position is not None and cycle.target_m is not None:
        error_m = float(np.hypot(*np.subtract(position, cycle.target_m)[:2]))
    if told:
        return SeenLanding(told[-1].result == "hit", at, position, error_m)
    if error_m is None or cycle.hit_radius_m is None:
        return None
    return SeenLanding(error_m <= cycle.hit_radius_m, at, position, error_m)


def combined_position(observed: Sequence[LandingRow]) -> list[float] | None:
    """Returns the mean of the positions weighted by 1 / std^2; exact ones (std 0) leave the others without weight."""
    if not observed:
        return None
    deviations = np.array([x.std_m or 0.0 for x in observed])
    exact = deviations == 0.0
    weights = exact.astype(float) if exact.any() else deviations**-2.0
    return np.average(np.array([x.position for x in observed], float), axis=0, weights=weights).tolist()
