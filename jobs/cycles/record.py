"""The record of a shift: what became of every object, cycles an hour, hits with their interval, misses by cause."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

from jobs.cycles.judgement import AT_PICK, SeenLanding, seen_landing
from jobs.cycles.order import JobOrder
from jobs.cycles.progress import THROWN, UNKNOWN, JobProgress
from store import JobCycleRow, LandingRow

NORMAL_95 = 1.959963984540054  # [-] quantile of the standard normal distribution at 0.975
AXES = ("x", "y", "z")


def wilson_interval(hits: int, throws: int) -> list[float] | None:
    """Returns the 95 % interval of a share [-, -]; None without a throw. Wilson, 1927; Brown, Cai, DasGupta, 2001."""
    if throws == 0:
        return None
    share = hits / throws
    z2 = NORMAL_95**2 / throws
    centre = share + z2 / 2.0
    half = NORMAL_95 * math.sqrt(share * (1.0 - share) / throws + z2 / (4.0 * throws))
    return [max(0.0, (centre - half) / (1.0 + z2)), min(1.0, (centre + half) / (1.0 + z2))]


def seen_landings(rows: Sequence[JobCycleRow], landings: Sequence[LandingRow]) -> dict[int, SeenLanding]:
    """Returns what was seen of the landings of a job, by the number of the throw."""
    by_execution: dict[str, list[LandingRow]] = {}
    for each in landings:
        by_execution.setdefault(each.execution_id, []).append(each)
    seen = {row.number: seen_landing(row, by_execution.get(row.execution_id or "", [])) for row in rows}
    return {number: each for number, each in seen.items() if each is not None}


def progress_of(order: JobOrder, rows: Sequence[JobCycleRow], landings: Sequence[LandingRow]) -> JobProgress:
    """Returns how far a job is."""
    seen = seen_landings(rows, landings)
    return JobProgress(order, rows, {number: each.at for number, each in seen.items() if not each.is_hit})


def object_results(
    order: JobOrder, rows: Sequence[JobCycleRow], landings: Sequence[LandingRow]
) -> list[dict[str, Any]]:
    """Returns what became of each object, in the order of the picks."""
    progress = progress_of(order, rows, landings)
    seen = seen_landings(rows, landings)
    return [_object_result(progress, seen, pick) for pick in range(len(order.picks))]


def shift_record(objects: Sequence[Mapping[str, Any]], rows: Sequence[JobCycleRow]) -> dict[str, Any]:
    """Returns the statistics of a job.

    Args:
        objects: of `object_results`.
        rows: the motions of the job.
    """
    counts = Counter(each["result"] for each in objects)
    seen = counts["hit"] + counts["miss"]
    thrown = seen + counts[THROWN]
    ran = [(row, row.asked_at, row.ended_at) for row in rows if row.asked_at is not None and row.ended_at is not None]
    times = [ended - asked for row, asked, ended in ran if row.result == THROWN]
    duration_s = max(ended for *_, ended in ran) - min(asked for _, asked, _ in ran) if ran else 0.0
    causes = {name: n for name, n in counts.items() if name not in ("hit", THROWN, "waiting", "moving")}
    return {
        "objects": dict(counts),
        "thrown": thrown,
        "hits": counts["hit"],
        "landings_seen": seen,
        "hit_share": counts["hit"] / seen if seen else None,
        "hit_interval": wilson_interval(counts["hit"], seen),
        "misses": causes,
        "cycles_per_hour": 3600.0 * thrown / duration_s if thrown and duration_s > 0.0 else None,
        "cycle_time_s": median(times) if times else None,
    }


def _object_result(progress: JobProgress, seen: Mapping[int, SeenLanding], pick: int) -> dict[str, Any]:
    row = progress.last_of(pick)
    state = progress.state_of(pick)
    if row is not None and row.result is None:
        state = "moving"
    landing = None if row is None else seen.get(row.number)
    if state in (THROWN, UNKNOWN) and landing is not None:
        state = "hit" if landing.is_hit else "miss"
    position = [None] * 3 if landing is None or landing.position is None else landing.position
    return {
        "pick": pick,
        "object": progress.order.picks[pick].get("object"),
        "result": state,
        "object_at": AT_PICK if row is None else row.object_at,
        "reason": None if row is None else row.reason,
        "attempts": progress.attempts(pick),
        **{name: getattr(row, name, None) for name in ("target", "turn", "outcome", "plan_id", "execution_id")},
        **{f"landing_{axis}_m": value for axis, value in zip(AXES, position, strict=True)},
        "error_m": None if landing is None else landing.error_m,
        **{name: getattr(row, name, None) for name in ("asked_at", "ended_at")},
    }
