"""Certificate and checks: the result of certifying a trajectory."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from planner.errors import Violation

ROUNDING = 1e-7  # [-] share of a limit by which floating point may exceed it


@dataclass(frozen=True)
class Check:
    """One verified property of a trajectory.

    Attributes:
        name: such as "joint_velocity"; fixed by the plan document.
        value: a bound that holds at every instant, in `unit`; of a check that is not ok the worst value found.
        limit: the bound on it, in `unit`.
        unit: of value, limit and margin; "1" for a plain number.
        margin: distance of the value from the limit; negative where it is violated.
        at_s: time of the worst value found [s]; None where it has none.
        ok: whether the bound is proven at every instant, also between samples.
        detail: which joint, singularity, body or box.
    """

    name: str
    value: float
    limit: float
    unit: str
    margin: float
    at_s: float | None
    ok: bool
    detail: str = ""

    def provided(self, proven: bool) -> Check:
        """Returns the check, not ok unless its bound is `proven` between samples."""
        return self if proven else replace(self, ok=False)

    def as_violation(self) -> Violation:
        """Returns the check that does not hold as what stands in a motion's way."""
        return Violation(self.name, self.value, self.limit, self.unit, self.at_s, self.detail)


@dataclass(frozen=True)
class NotChecked:
    """A check that the cell gives no limit for, or that cannot be computed from the model.

    Attributes:
        name: of the check, or of the quantity.
    """

    name: str


@dataclass(frozen=True)
class Certificate:
    """Independent verification of a trajectory. Valid if every check is ok.

    Attributes:
        checks: the checks that apply to the problem.
        not_checked: names of the checks and quantities that stay unverified, for want of a limit or of a model.
    """

    checks: tuple[Check, ...]
    not_checked: tuple[str, ...] = ()

    @property
    def valid(self) -> bool:
        """Whether every check holds."""
        return all(check.ok for check in self.checks)

    @property
    def failures(self) -> tuple[Check, ...]:
        """The checks that do not hold."""
        return tuple(check for check in self.checks if not check.ok)

    def check(self, name: str) -> Check:
        """Returns the check of this name.

        Raises:
            KeyError: the certificate has none.
        """
        for check in self.checks:
            if check.name == name:
                return check
        raise KeyError(name)


def at_most(name: str, value: float, limit: float, unit: str, at_s: float | None = None, detail: str = "") -> Check:
    """Returns the check value <= limit; a value that is not finite fails."""
    ok = math.isfinite(value) and value <= limit + ROUNDING * abs(limit)
    return Check(name, float(value), float(limit), unit, float(limit - value), at_s, ok, detail)


def at_least(name: str, value: float, limit: float, unit: str, at_s: float | None = None, detail: str = "") -> Check:
    """Returns the check value >= limit; a value that is not finite fails."""
    ok = math.isfinite(value) and value >= limit - ROUNDING * abs(limit)
    return Check(name, float(value), float(limit), unit, float(value - limit), at_s, ok, detail)
