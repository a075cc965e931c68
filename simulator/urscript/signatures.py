"""A function that scripts may call: its parameters with their defaults, and what it does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

REQUIRED = object()  # default of a parameter that has none


@dataclass(frozen=True)
class Signature:
    """A function of URScript.

    Attributes:
        parameters: name -> default, REQUIRED without one, in the order of the arguments.
        body: function of the program's context and the arguments; returns a value, or a motion that does.
        waits: whether it may take controller cycles.
    """

    parameters: dict[str, Any]
    body: Callable[..., Any]
    waits: bool = False

    def bound(self, arguments: list[Any], named: dict[str, Any]) -> list[Any]:
        """Returns the arguments in order, defaults filled in.

        Raises:
            TypeError: there are too many, one is missing, or a name is unknown.
        """
        unknown = named.keys() - self.parameters.keys()
        if len(arguments) > len(self.parameters) or unknown:
            raise TypeError(f"takes {', '.join(self.parameters) or 'no arguments'}")
        if len(arguments) == len(self.parameters) and not named:
            return arguments
        values = self.parameters | dict(zip(self.parameters, arguments, strict=False)) | named
        missing = [name for name, value in values.items() if value is REQUIRED]
        if missing:
            raise TypeError(f"the argument {missing[0]} is missing")
        return [*values.values()]


def signature(parameters: str, body: Callable[..., Any], waits: bool = False) -> Signature:
    """Returns a function with parameters as in `"q a=1.4 name=socket_0 text="`; defaults are numbers or words."""
    table: dict[str, Any] = {}
    for parameter in parameters.split():
        name, equals, default = parameter.partition("=")
        table[name] = _default(default) if equals else REQUIRED
    return Signature(table, body, waits)


def _default(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
