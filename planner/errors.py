"""Errors of the planner. All of them survive pickling with their fields.

::

    PlannerError
    ├── UnknownRobot         there is no arm of this name
    ├── IncompleteRobot      numbers of an arm are not published, and were not given
    ├── CellError            a cell file is refused: field, value, reason
    ├── FileRefused          another file that a person handed over is refused: its path, and the reason
    ├── InvalidProblem       a request is refused: the first wrong fields, each with its reason
    ├── Infeasible           no motion was found: the violated constraints, proven or not, and one near it that works
    ├── SolverFailed         a solver gave up, or the time limit ended the search: status, what was found so far
    └── BackendUnavailable   an optional back end is not installed: the extra to install
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from reprlib import Repr
from typing import Any

ERRORS_MAX = 20  # refused fields that are named: a person mends the first ones and asks again
TIME_LIMIT = "time_limit"  # status of a search that the request's time limit ended
CUT_SHORT = f"{TIME_LIMIT} ended the search"  # end of the status in the document of a plan whose search was ended so

AT_RELEASE = re.compile(",? ?at the release")  # in the detail of a violation

QUOTE = Repr()
QUOTE.maxlevel = 3
QUOTE.maxlist = QUOTE.maxtuple = QUOTE.maxdict = 12
QUOTE.maxstring = QUOTE.maxlong = QUOTE.maxother = 200


class PlannerError(Exception):
    """Base class of every error that the planner raises on purpose.

    Errors cross process borders. By default an exception is unpickled by calling its class with its message alone;
    `__reduce__` restores message and fields without calling `__init__`.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore, (type(self), str(self), self.__dict__)


def _restore(kind: type[PlannerError], message: str, fields: dict[str, Any]) -> PlannerError:
    """Returns an error with this message and these fields."""
    error = kind.__new__(kind, message)
    error.__dict__.update(fields)
    return error


class UnknownRobot(PlannerError):
    """There is no arm of this name in `planner/robot_data`.

    Attributes:
        name: the unknown name.
        known: the names of all arms.
    """

    def __init__(self, name: str, known: Sequence[str]) -> None:
        super().__init__(f"unknown robot {name!r}; known are {', '.join(known)}")
        self.name = name
        self.known = tuple(known)


class IncompleteRobot(PlannerError):
    """Of an arm not everything is published that planning needs.

    Attributes:
        name: of the arm.
        missing: the keys of a cell file's `[arm_data]` that can give it.
    """

    def __init__(self, name: str, missing: Sequence[str]) -> None:
        self.reason = f"not published: {', '.join(missing)}; [arm_data] of a cell file takes them, with their source"
        super().__init__(f"{name}: {self.reason}")
        self.name = name
        self.missing = tuple(missing)


class CellError(PlannerError):
    """A cell file is refused.

    Attributes:
        field: dotted path of the refused field.
        value: its value, None where there is none.
        reason: in words.
    """

    def __init__(self, field: str, value: object, reason: str) -> None:
        super().__init__(f"{field} = {quoted(value)}: {reason}" if value is not None else f"{field}: {reason}")
        self.field = field
        self.value = value
        self.reason = reason


class FileRefused(PlannerError):
    """A file that a person handed over is not read: it is not there, is no file, too large, or not what it should be.

    Attributes:
        path: of the file.
        reason: in words.
    """

    def __init__(self, path: object, reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path = str(path)
        self.reason = reason


@dataclass(frozen=True)
class FieldError:
    """One refused field of a request: its dotted path, and the reason in words."""

    field: str
    reason: str


class InvalidProblem(PlannerError):
    """A request is refused before planning.

    Attributes:
        errors: the first `ERRORS_MAX` wrong fields with their reasons.
    """

    def __init__(self, errors: Sequence[FieldError]) -> None:
        self.errors = tuple(errors[:ERRORS_MAX])
        super().__init__("; ".join(f"{e.field}: {e.reason}" for e in self.errors))


def quoted(value: object) -> str:
    """Returns a value as an error quotes it: cut where it is long, whatever it holds and however deep it nests."""
    try:
        return QUOTE.repr(value)
    except ValueError:  # an integer of more digits than Python writes
        return "a number of thousands of digits"


def figures(value: float, limit: float) -> tuple[str, str]:
    """Returns a value and its limit in words: four digits, or as many as tell them apart."""
    digits = next((n for n in (4, 6, 9, 15) if f"{value:.{n}g}" != f"{limit:.{n}g}"), 4)
    return f"{value:.{digits}g}", f"{limit:.{digits}g}"


@dataclass(frozen=True)
class Violation:
    """A constraint that rules a motion out, and by how much.

    Attributes:
        constraint: name of the certificate check.
        value: value of the motion [unit], None where nothing was found that has one.
        limit: the bound that it violates [unit], None likewise.
        unit: of both.
        at_s: time on the trajectory [s], None where there is no such time.
        detail: joint, pair of links or shape concerned, in words.
        proven: whether no motion can avoid it; otherwise motions without it were searched for in vain.
    """

    constraint: str
    value: float | None
    limit: float | None
    unit: str
    at_s: float | None = None
    detail: str = ""
    proven: bool = False

    def in_passing(self) -> Violation:
        """Returns the violation of a state that is passed, or ended in, without letting anything go."""
        return replace(self, detail=AT_RELEASE.sub("", self.detail))

    def within(self, where: str) -> Violation:
        """Returns the violation with the part of a motion that it is about, in words."""
        return replace(self, detail=f"{where}: {self.detail}" if self.detail else where)

    def __str__(self) -> str:
        if self.value is None or self.limit is None:
            return f"{self.constraint}: {self.detail}"
        when = "" if self.at_s is None else f" at {self.at_s:.3f} s"
        value, limit = figures(self.value, self.limit)
        unit = "" if self.unit in ("-", "1") else f" {self.unit}"  # a plain number has none
        text = f"{self.constraint}: {value}{unit} against a limit of {limit}{unit}{when}"
        return f"{text} ({self.detail})" if self.detail else text


def nothing_found(constraint: str, detail: str) -> Violation:
    """Returns the violation of a constraint for which nothing was found that could be measured.

    Args:
        constraint: name of the certificate check, or `motion`.
        detail: what was not found, in words.
    """
    return Violation(constraint, None, None, "", detail=detail)


class Infeasible(PlannerError):
    """No motion satisfies the problem, or the search for one ran to its end in vain.

    Attributes:
        violations: the constraints in the way, each proven or only not avoided by what was tried.
        nearest: a request near it that has a certified plan, in the shape of `POST /plan`, or None.
        attempts: log of the search.
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
    """A solver gave up, or the request's time limit ended the search, before feasibility was decided.

    Attributes:
        status: of the solver, or `TIME_LIMIT`.
        iterations: of the solver.
        attempts: log of the search.
        violations: what stood in the way of the best motion so far; none is proven.
        nearest: a request near it that has a certified plan, in the shape of `POST /plan`, or None.
    """

    def __init__(
        self,
        status: str,
        iterations: int = 0,
        attempts: Sequence[Mapping[str, Any]] = (),
        violations: Sequence[Violation] = (),
        nearest: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__("; ".join([status, *map(str, violations)]))
        self.status = status
        self.iterations = iterations
        self.attempts = tuple(attempts)
        self.violations = tuple(violations)
        self.nearest = nearest


class BackendUnavailable(PlannerError):
    """An optional back end is not installed.

    Attributes:
        backend: its name.
        extra: the extra of this package that installs it.
    """

    def __init__(self, backend: str, extra: str) -> None:
        super().__init__(f"back end {backend!r} is not installed: pip install 'fling-robotics[{extra}]'")
        self.backend = backend
        self.extra = extra
