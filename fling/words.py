"""A plan in a few words, for terminal and report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def passing_text(plan: Mapping[str, Any]) -> str:
    """Returns when a plan passes what it was asked to pass: the release; without one, its passages."""
    end = f"of {plan['duration_s']:.3f} s"
    if plan["release_time_s"] is not None:
        return f"release after {plan['release_time_s']:.3f} s {end}"
    passages = plan["passages"]
    times = ", ".join(f"{each['time_s']:.3f}" for each in passages)
    return f"{'passage' if len(passages) == 1 else 'passages'} after {times} s {end}"
