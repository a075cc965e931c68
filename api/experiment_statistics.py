"""Statistics of a series of throws, from its executions, plans and observed landings."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from jobs.cycles import combined_position
from store import ExecutionRow, LandingRow, PlanRow

Throw = dict[str, Any]


def throws_of(
    executions: Sequence[ExecutionRow], landings: Sequence[LandingRow], plans: Sequence[PlanRow]
) -> list[Throw]:
    """Returns one document a throw, in the order of the executions."""
    targets = {plan.id: _target(plan) for plan in plans}
    seen: dict[str, list[LandingRow]] = defaultdict(list)
    for landing in landings:
        seen[landing.execution_id].append(landing)
    return [_throw(row, targets.get(row.plan_id), seen[row.id]) for row in executions]


def statistics_of(throws: Sequence[Throw]) -> dict[str, Any]:
    """Returns outcomes, and mean and spread of the landings about their targets."""
    landed = [throw for throw in throws if throw["error_m"] is not None]
    errors = np.array([np.subtract(throw["landing"], throw["target"])[:2] for throw in landed]).reshape(-1, 2)
    distances = np.hypot(errors[:, 0], errors[:, 1])
    return {
        "throws": len(throws),
        "outcomes": dict(Counter(throw["outcome"] or throw["state"] for throw in throws)),
        "landed": len(landed),
        "mean_error_m": errors.mean(axis=0).tolist() if len(landed) else None,
        "covariance_m2": np.cov(errors.T).tolist() if len(landed) > 1 else None,
        "median_distance_m": float(np.median(distances)) if len(landed) else None,
        "largest_distance_m": float(distances.max()) if len(landed) else None,
        "results": dict(Counter(result for throw in throws for result in throw["results"])),
    }


def statistics_by_target(throws: Sequence[Throw]) -> list[dict[str, Any]]:
    """Returns the statistics of each target, in the order in which they were first thrown at."""
    targets: list[Any] = []
    for throw in throws:
        if throw["target"] not in targets:
            targets.append(throw["target"])
    return [
        {"target": target, **statistics_of([throw for throw in throws if throw["target"] == target])}
        for target in targets
    ]


def _target(plan: PlanRow) -> list[float] | None:
    """Returns the target of a plan in the world; None for releases without one, or in the frame of the base."""
    request = json.loads(plan.summary).get("request", {})
    release = request.get("release", {})
    in_world = request.get("frame", "world") == "world"
    return release.get("position") if release.get("kind") == "target" and in_world else None


def _throw(row: ExecutionRow, target: list[float] | None, landings: Sequence[LandingRow]) -> Throw:
    landing = combined_position([x for x in landings if x.position is not None])
    error = None if target is None or landing is None else float(np.hypot(*np.subtract(landing, target)[:2]))
    return {
        "execution_id": row.id,
        "plan_id": row.plan_id,
        "state": row.state,
        "outcome": row.outcome,
        "reason": row.reason,
        "target": target,
        "landing": landing,
        "error_m": error,
        "results": [x.result for x in landings if x.result is not None],
    }
