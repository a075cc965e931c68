"""What a soak is judged by: what must be flat, and what must never have happened."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from benchmarks.soak.clients import Tally
from benchmarks.soak.station import Usage

GROWTH = 1.1  # [-] of memory from the second quarter of a soak to its last: pools and caches are full by then
SLACK_MB = 15.0  # [MB] by which it may differ anyway: a large answer in hand
STOP_S = 1.0  # [s] within which a stop is answered
COUNTED = ("descriptors", "threads", "sockets")


def growth(usages: Sequence[Usage], shared: Sequence[int]) -> list[str]:
    """Returns what has grown, in words.

    A count has grown where it never came down again, in the last quarter, to its largest value of the second: load
    makes it go up and down, and a leak makes it go up alone.
    """
    found = []
    for role in sorted({usage.role for usage in usages}):
        own = [usage for usage in usages if usage.role == role]
        second, last = own[len(own) // 4 : len(own) // 2], own[3 * len(own) // 4 :]
        for name in COUNTED:
            before = max(getattr(usage, name) for usage in second)
            after = min(getattr(usage, name) for usage in last)
            if after > before:
                found.append(f"{role}: {name} grew from at most {before} to at least {after}")
        before_mb = median(usage.memory_mb for usage in second)
        after_mb = median(usage.memory_mb for usage in last)
        if after_mb > GROWTH * before_mb + SLACK_MB:
            found.append(f"{role}: memory grew from {before_mb:.0f} MB to {after_mb:.0f} MB")
    half = len(shared) // 2
    if min(shared[3 * len(shared) // 4 :]) > max(shared[len(shared) // 4 : half]):
        found.append(f"shared memory: from {max(shared[:half])} to {shared[-1]} blocks")
    return found


def faults(tally: Tally, hostile: dict[str, int]) -> list[str]:
    """Returns what must not have happened, in words."""
    found = list(tally.lost)
    wrong = {status: n for status, n in tally.statuses.items() if status >= 500 and status != 503}
    wrong |= {int(status): n for status, n in hostile.items() if int(status) >= 500 and int(status) != 503}
    found += [f"status {status}, {n} times" for status, n in wrong.items()]
    late = [stop for stop in tally.stops_s if stop > STOP_S]
    if late:
        found.append(f"{len(late)} of {len(tally.stops_s)} stops took over {STOP_S:g} s, {max(late):.1f} s at most")
    if not tally.stops_s:
        found.append("no stop was asked for")
    if not tally.outcomes["completed"]:
        found.append("no throw was completed")
    return found
