"""Errors of the planner.

::

    PlannerError
    ├── UnknownRobot         no such arm
    ├── CellError            a cell file is refused: field, value, reason
    ├── InvalidProblem       a request is refused: every field and its reason
    ├── Infeasible           no motion exists: what stands in the way, by how much, the nearest that can be done
    ├── SolverFailed         gave up within its time: status, iterations, what was tried
    └── BackendUnavailable   an optional back end is not installed: the extra to install
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


class PlannerError(Exception):
    """Root of everything the planner raises on purpose."""


class UnknownRobot(PlannerError):
    """No arm of this name is described in `planner/robot_data`."""

    def __init__(self, name: str, known: Sequence[str]) -> None:
        super().__init__(f"unknown robot {name!r}; known are {', '.join(known)}")
        self.name = name
        self.known = tuple(known)


class CellError(PlannerError):
    """A cell file is refused."""

    def __init__(self, field: str, value: object, reason: str) -> None:
        super().__init__(f"{field} = {value!r}: {reason}" if value is not None else f"{field}: {reason}")
        self.field = field
        self.value = value
        self.reason = reason


@dataclass(frozen=True)
class FieldError:
    """One refused field of a request: dotted path and the reason in words."""

    field: str
    reason: str


class InvalidProblem(PlannerError):
    """A request is refused before any work: every wrong field with its reason."""

    def __init__(self, errors: Sequence[FieldError]) -> None:
        super().__init__("; ".join(f"{e.field}: {e.reason}" for e in errors))
        self.errors = tuple(errors)


@dataclass(frozen=True)
class Violation:
    """What stands in the way of a motion, and by how much.

    `value` and `limit` are in `unit`; `at_s` is the time on the trajectory [s], None where it has no time.
    """

    constraint: str
    value: float
    limit: float
    unit: str
    at_s: float | None = None
    detail: str = ""

    def __str__(self) -> str:
        when = "" if self.at_s is None else f" at {self.at_s:.3f} s"
        text = f"{self.constraint}: {self.value:.4g} {self.unit} against a limit of {self.limit:.4g} {self.unit}{when}"
        return f"{text} ({self.detail})" if self.detail else text


class Infeasible(PlannerError):
    """No motion satisfies the problem.

    `nearest` is the closest request that can be certified, in the shape of `POST /plan`, or None.
    """

    def __init__(
        self,
        violations: Sequence[Violation],
        nearest: Mapping[str, Any] | None = None,
        attempts: Sequence[Mapping[str, Any]] = (),
    ) -> None:
        super().__init__("; ".join(str(v) for v in violations) or "no motion was found")
        self.violations = tuple(violations)
        self.nearest = nearest
        self.attempts = tuple(attempts)


class SolverFailed(PlannerError):
    """A solver gave up without deciding whether the problem can be solved."""

    def __init__(self, status: str, iterations: int = 0, attempts: Sequence[Mapping[str, Any]] = ()) -> None:
        super().__init__(status)
        self.status = status
        self.iterations = iterations
        self.attempts = tuple(attempts)


class BackendUnavailable(PlannerError):
    """An optional back end is not installed."""

    def __init__(self, backend: str, extra: str) -> None:
        super().__init__(f"back end {backend!r} is not installed: pip install 'fling[{extra}]'")
        self.backend = backend
        self.extra = extra
