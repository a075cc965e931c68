"""What a certificate is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

ROUNDING = 1e-7  # [-] share of a limit by which floating point may exceed it


@dataclass(frozen=True)
class Check:
    """One judged property of a trajectory.

    Attributes:
        name: of the contract, such as "joint_velocity".
        value: the worst value found, in `unit`.
        limit: what it is held against, in `unit`.
        unit: of value, limit and margin; "1" for a plain number.
        margin: how far inside the limit the value lies; negative outside.
        at_s: when the worst value occurs [s], None where it has no time.
        ok: whether the bound holds at every instant, between samples too.
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


@dataclass(frozen=True)
class Certificate:
    """An independent judgement of a trajectory. Valid where every check is ok."""

    checks: tuple[Check, ...]

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
