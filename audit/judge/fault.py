"""What the audit finds wrong: the rule that is broken, the value and its limit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Worst = dict[str, tuple[float, float]]  # value and limit of each rule where least is left [in the rule's unit]
_WORST: ContextVar[Worst | None] = ContextVar("worst", default=None)


@contextmanager
def worst_margins() -> Iterator[Worst]:
    """Yields what its block fills: by rule, the value that left least of its limit, as a share of that.

    Of a limit of 0 the value counts by itself. It is told beside the faults, which do not depend on it.
    """
    found: Worst = {}
    token = _WORST.set(found)
    try:
        yield found
    finally:
        _WORST.reset(token)


def _note(rule: str, value: float, limit: float, sign: float) -> None:
    """Notes a value of a rule; `sign` is 1 where it may not be above its limit, -1 where it may not be below."""
    found = _WORST.get()
    if found is None or not np.isfinite(value):
        return
    before = found.get(rule)
    if before is None or sign * _excess(value, limit) > sign * _excess(*before):
        found[rule] = (float(value), float(limit))


def _excess(value: float, limit: float) -> float:
    return (value - limit) / (abs(limit) or 1.0)


@dataclass(frozen=True)
class AuditFault:
    """A broken rule.

    Attributes:
        rule: Its name, as docs/throwbench.md lists them.
        text: What is wrong, in words.
        value: The value.
        limit: The limit, without the tolerance.
        unit: Unit of both.
    """

    rule: str
    text: str
    value: float
    limit: float
    unit: str = ""

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.text}: {self.value:.6g}{unit}, limit {self.limit:.6g}{unit}"


def over(rule: str, text: str, value: float, limit: float, slack: float, unit: str = "") -> list[AuditFault]:
    """Returns the fault of a value above its limit by more than the slack; NaN is a fault too."""
    _note(rule, value, limit, 1.0)
    return [] if value <= limit + slack else [AuditFault(rule, text, float(value), float(limit), unit)]


def under(rule: str, text: str, value: float, limit: float, slack: float, unit: str = "") -> list[AuditFault]:
    """Returns the fault of a value below its limit by more than the slack."""
    _note(rule, value, limit, -1.0)
    return [] if value >= limit - slack else [AuditFault(rule, text, float(value), float(limit), unit)]


def joint_faults(
    rule: str,
    text: str,
    worst: NDArray[np.float64],
    limit: NDArray[np.float64],
    slack: float | NDArray[np.float64],
    unit: str,
) -> list[AuditFault]:
    """Returns the faults of the joints that are above their limits; all arrays (6,)."""
    allowed = np.broadcast_to(slack, 6)
    rows = enumerate(zip(worst, limit, allowed, strict=True))
    return [f for i, (w, top, more) in rows for f in over(rule, f"{text} of joint {i}", w, top, more, unit)]
