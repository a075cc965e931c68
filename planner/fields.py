"""Fields of JSON documents: what each may hold, stated once and read by library, command line and service alike.

A shape (`Number`, `Vector`, `Record` …) reads a value: it returns the value in plain Python types, or adds the refusal
to `errors` and returns None. A reason is the end of a sentence that begins with the field's path.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from itertools import islice
from typing import Any, Protocol

import numpy as np

from planner.errors import ERRORS_MAX, FieldError

NUMBER_MAX = 1e6  # of any number, in any unit: no robot has a larger one, and squares and sums of them are finite
SHOWN = 40  # characters of a refused value that a sentence quotes
NAME_SHOWN = 80  # characters of an unknown name that is quoted, and for which a similar one is looked for


class Shape(Protocol):
    """What a field may hold."""

    def read(self, value: Any, path: str, errors: list[FieldError]) -> Any:
        """Returns the value in plain Python types; None where it is refused."""
        ...


@dataclass(frozen=True)
class Number:
    """A finite number.

    Attributes:
        least, most: its bounds.
        above: a bound that it must exceed; None: there is none.
    """

    least: float = -NUMBER_MAX
    most: float = NUMBER_MAX
    above: float | None = None

    def read(self, value: Any, path: str, errors: list[FieldError]) -> float | None:
        """Returns a number."""
        reason = self._refusal(value)
        if reason is None:
            return float(value)
        errors.append(FieldError(path, f"{reason}; it is {shown(value)}"))
        return None

    def _refusal(self, value: Any) -> str | None:
        if not is_number(value):
            return "must be a number"
        if value != value or value in (np.inf, -np.inf):
            return "must be a finite number"
        if self.above is not None and value <= self.above:
            return f"must be above {self.above:.12g}"
        if value < self.least:
            return f"must be at least {self.least:.12g}"
        if value > self.most:
            return f"must be at most {self.most:.12g}"
        return None


@dataclass(frozen=True)
class Vector:
    """A list of so many finite numbers."""

    size: int

    def read(self, value: Any, path: str, errors: list[FieldError]) -> list[float] | None:
        """Returns a list of numbers; an array of numpy is one, too."""
        if not is_list(value):
            errors.append(FieldError(path, f"must be a list of {self.size} numbers, not {named(value)}"))
            return None
        if len(value) != self.size:
            errors.append(FieldError(path, f"has {len(value)} entries; it needs {self.size}"))
            return None
        before = len(errors)
        numbers = [Number().read(entry, f"{path}[{i}]", errors) for i, entry in enumerate(value)]
        return numbers if len(errors) == before else None  # type: ignore[return-value]


@dataclass(frozen=True)
class PerJoint:
    """One number for all six joints, or one for each."""

    def read(self, value: Any, path: str, errors: list[FieldError]) -> float | list[float] | None:
        """Returns a number, or a list of six."""
        if is_list(value):
            return Vector(6).read(value, path, errors)
        if is_number(value):
            return Number().read(value, path, errors)
        errors.append(FieldError(path, f"must be a number, or a list of numbers; it is {shown(value)}"))
        return None


@dataclass(frozen=True)
class Choice:
    """One of a few texts."""

    values: Sequence[str]

    def read(self, value: Any, path: str, errors: list[FieldError]) -> str | None:
        """Returns the text; the reason of another one names a similar one."""
        if isinstance(value, str) and value in self.values:
            return value
        meant = did_you_mean(value, self.values)
        errors.append(FieldError(path, f"{shown(value)} is not one of {', '.join(self.values)}{meant}"))
        return None


@dataclass(frozen=True)
class Text:
    """A text of so many characters.

    Attributes:
        most, least: number of characters.
    """

    most: int
    least: int = 0

    def read(self, value: Any, path: str, errors: list[FieldError]) -> str | None:
        """Returns the text."""
        if not isinstance(value, str):
            errors.append(FieldError(path, f"must be a text, not {named(value)}"))
            return None
        if len(value) > self.most:
            errors.append(FieldError(path, f"has {len(value)} characters; it may have at most {self.most}"))
            return None
        if len(value) < self.least:
            errors.append(FieldError(path, "must not be empty"))
            return None
        return value


@dataclass(frozen=True)
class Yes:
    """True, or absent."""

    def read(self, value: Any, path: str, errors: list[FieldError]) -> bool | None:
        """Returns True."""
        if value is True:
            return True
        errors.append(FieldError(path, f"may only be true, or be left out; it is {shown(value)}"))
        return None


@dataclass(frozen=True)
class YesOr:
    """True, or a text of at most so many characters that names something; or absent."""

    most: int

    def read(self, value: Any, path: str, errors: list[FieldError]) -> bool | str | None:
        """Returns True, or the name."""
        if value is True:
            return True
        if isinstance(value, str) and 0 < len(value) <= self.most:
            return value
        reason = f"may only be true or a name of at most {self.most} characters, or be left out; it is {shown(value)}"
        errors.append(FieldError(path, reason))
        return None


@dataclass(frozen=True)
class Whole:
    """A whole number within bounds."""

    least: int
    most: int

    def read(self, value: Any, path: str, errors: list[FieldError]) -> int | None:
        """Returns the whole number."""
        number = Number(self.least, self.most).read(value, path, errors)
        if number is None or number == int(number):
            return None if number is None else int(number)
        errors.append(FieldError(path, f"must be a whole number; it is {shown(value)}"))
        return None


@dataclass(frozen=True)
class Flag:
    """True or false."""

    def read(self, value: Any, path: str, errors: list[FieldError]) -> bool | None:
        """Returns the value."""
        if isinstance(value, bool):
            return value
        errors.append(FieldError(path, f"must be true or false; it is {shown(value)}"))
        return None


@dataclass(frozen=True)
class RecordList:
    """A list of records.

    Attributes:
        record: of each entry.
        least, most: how many there may be.
    """

    record: Record
    least: int
    most: int

    def read(self, value: Any, path: str, errors: list[FieldError]) -> list[dict[str, Any]] | None:
        """Returns the fields of each entry."""
        if not is_list(value):
            errors.append(FieldError(path, f"must be a list, not {named(value)}"))
            return None
        if not self.least <= len(value) <= self.most:
            errors.append(FieldError(path, f"has {len(value)} entries; it may have {self.least} to {self.most}"))
            return None
        return [self.record.read(entry, f"{path}[{i}]", errors) for i, entry in enumerate(value)]


@dataclass(frozen=True)
class ListOr:
    """A list, of numbers or of records, or an object that stands for it."""

    listed: Vector | RecordList
    record: Record

    def read(self, value: Any, path: str, errors: list[FieldError]) -> list[Any] | dict[str, Any] | None:
        """Returns the list, or the fields of the object."""
        if isinstance(value, Mapping):
            return self.record.read(value, path, errors)
        return self.listed.read(value, path, errors)


@dataclass(frozen=True)
class Field:
    """A field of a record.

    Attributes:
        shape: what it may hold.
        text: what it means, with its unit.
        is_required: whether it must be there.
        default: its value where it is absent; None: it stays absent, and null means absent.
    """

    shape: Shape
    text: str
    is_required: bool = False
    default: Any = None

    @property
    def is_nullable(self) -> bool:
        """Whether null means absent."""
        return not self.is_required and self.default is None


def required(shape: Shape, text: str) -> Field:
    """Returns a field that must be there."""
    return Field(shape, text, is_required=True)


@dataclass(frozen=True)
class Record:
    """A JSON object with known fields.

    Attributes:
        name: of the type, in OpenAPI.
        text: what it is, in a sentence.
        fields: by name.
        rule: refuses values that do not fit each other, given those of all fields, the path of the record's fields, and
            the errors.
        planned: names of further fields that are not supported yet, each with the reason of its refusal.
    """

    name: str
    text: str
    fields: Mapping[str, Field]
    rule: Callable[[dict[str, Any], str, list[FieldError]], None] | None = None
    planned: Mapping[str, str] = field(default_factory=dict)

    def read(self, value: Any, path: str, errors: list[FieldError]) -> dict[str, Any]:
        """Returns the fields that are there and not refused, defaults filled in."""
        if not isinstance(value, Mapping):
            errors.append(FieldError(path or "body", f"must be a JSON object, not {named(value)}"))
            return {}
        before = len(errors)
        prefix = f"{path}." if path else ""
        found: dict[str, Any] = {}
        for name, each in self.fields.items():
            if name not in value and each.is_required:
                errors.append(FieldError(prefix + name, "is missing"))
                continue
            entry = value.get(name, each.default)
            if entry is None and each.is_nullable:
                continue
            entry = each.shape.read(entry, prefix + name, errors)
            if entry is not None:
                found[name] = entry
        unknown = islice((str(name) for name in value if name not in self.fields), ERRORS_MAX)
        for name in unknown:
            reason = self.planned.get(name) or unknown_field(name, self.fields)
            errors.append(FieldError(prefix + short_name(name), reason))
        if self.rule is not None and len(errors) == before:
            self.rule(found, path, errors)
        return found


@dataclass(frozen=True)
class Kinds:
    """One of several records; their field `kind` says which."""

    records: Mapping[str, Record]

    def read(self, value: Any, path: str, errors: list[FieldError]) -> dict[str, Any]:
        """Returns the fields of the record that is meant, its kind among them."""
        if not isinstance(value, Mapping):
            errors.append(FieldError(path, f"must be a JSON object, not {named(value)}"))
            return {}
        if "kind" not in value:
            errors.append(FieldError(f"{path}.kind", "is missing; it says what the other fields mean"))
            return {}
        kind = Choice(tuple(self.records)).read(value["kind"], f"{path}.kind", errors)
        return {} if kind is None else self.record(kind).read(value, path, errors)

    def record(self, kind: str) -> Record:
        """Returns the record of a kind, with its field `kind`."""
        record = self.records[kind]
        which = required(Choice((kind,)), "")
        return replace(record, fields={"kind": which, **record.fields})


def unknown_field(name: str, known: Mapping[str, Any]) -> str:
    """Returns the reason of a field that does not exist, with the one that was meant."""
    there = f"; there are {', '.join(known)}"
    return f"there is no such field{did_you_mean(name, list(known)) or there}"


def _similar_name(given: Any, known: Sequence[str]) -> str | None:
    """Returns the known name that was probably meant, whatever its case; None where none is similar."""
    if not isinstance(given, str) or len(given) > NAME_SHOWN:  # to compare a megabyte would take a second
        return None
    by_lower = {name.lower(): name for name in known}
    return next((by_lower[name] for name in get_close_matches(given.lower(), by_lower, n=1)), None)


def did_you_mean(given: Any, known: Sequence[str]) -> str:
    """Returns the end of a sentence that names the known name which was probably meant; nothing where none is."""
    similar = _similar_name(given, known)
    return f"; did you mean {similar!r}?" if similar else ""


def short_name(name: str) -> str:
    """Returns a name that a client made up, cut to what a sentence can quote."""
    return name if len(name) <= NAME_SHOWN else f"{name[:NAME_SHOWN]}…"


def is_number(value: Any) -> bool:
    """Returns whether a value is a number, of Python or numpy."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def is_list(value: Any) -> bool:
    """Returns whether a value is a list, a tuple or an array of numpy."""
    return isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)


def shown(value: Any) -> str:
    """Returns a value as a sentence quotes it: a text in single quotes, everything else as JSON."""
    text = ascii(value) if isinstance(value, str) else json.dumps(value, default=str)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}…"


def named(value: Any) -> str:
    """Returns what kind of JSON a value is."""
    names = {dict: "an object", list: "a list", str: "a text", bool: "true or false", type(None): "null"}
    return names.get(type(value), "a number")
