"""The answer of one landing cell: a plan and what it promises, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Any

from jobs.planning import PlanRecord
from store import LandingCellRow, derived_id


class LandingState(IntEnum):
    """What is known of a landing cell; the numbers are those of `GET /cells/{name}/map`."""

    UNKNOWN = 0
    YES = 1
    PROVEN = 2  # refused, and proven: no motion throws there
    NOT_FOUND = 3  # refused: no motion was found, without a proof


def planned_row(map_id: str, number: int, round: int, planned: PlanRecord) -> LandingCellRow | None:
    """Returns the row of a landing cell with a plan; None where its search did not come to its end.

    Args:
        map_id: of the map.
        number: of the landing cell.
        round: in which it was planned.
        planned: its plan.
    """
    if planned.was_cut_short:
        return None
    return LandingCellRow(
        map_id=map_id,
        number=number,
        round=round,
        state=int(LandingState.YES),
        plan_id=planned.row.id,
        samples_sha256=planned.samples_sha256,
        release_time_s=planned.release_time_s,
        shift_early_m=planned.shift_early_m,
        shift_late_m=planned.shift_late_m,
        hit_probability=planned.hit_probability,
        margin=planned.margin,
        margin_check=planned.margin_check,
    )


def refused_row(map_id: str, number: int, round: int, refusal: Mapping[str, Any]) -> LandingCellRow | None:
    """Returns the row of a landing cell without a plan; None where its search did not come to its end.

    Args:
        map_id: of the map.
        number: of the landing cell.
        round: in which it was refused.
        refusal: of the planner, from `jobs.planning.refusal_of`.
    """
    if refusal["name"] != "infeasible":
        return None
    violations = refusal["violations"]
    first = next((each for each in violations if each["proven"]), violations[0] if violations else None)
    is_proven = first is not None and first["proven"]
    return LandingCellRow(
        map_id=map_id,
        number=number,
        round=round,
        state=int(LandingState.PROVEN if is_proven else LandingState.NOT_FOUND),
        constraint_name="motion" if first is None else first["constraint"],
        reason=refusal["detail"] if first is None else _words(first),
    )


def plan_id_of(map_id: str, number: int, round: int) -> str:
    """Returns the id of a landing cell's plan: the same one for a landing cell that is planned again after a kill.

    Args:
        map_id: of the map.
        number: of the landing cell.
        round: in which it is planned.
    """
    return derived_id(map_id, f"{number}/{round}")


def _words(violation: Mapping[str, Any]) -> str:
    """Returns by how much a constraint is violated, in words."""
    if violation["value"] is None and violation["limit"] is None:
        return violation["detail"]
    value, limit = (_number(violation[name]) for name in ("value", "limit"))
    text = f"{value} {violation['unit']} against a limit of {limit} {violation['unit']}"
    return f"{text} ({violation['detail']})" if violation["detail"] else text


def _number(value: float | None) -> str:
    return "unbounded" if value is None else f"{value:.4g}"
