"""What the audit finds wrong: the rule that is broken, the value and its limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


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
    return [] if value <= limit + slack else [AuditFault(rule, text, float(value), float(limit), unit)]


def under(rule: str, text: str, value: float, limit: float, slack: float, unit: str = "") -> list[AuditFault]:
    """Returns the fault of a value below its limit by more than the slack."""
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
