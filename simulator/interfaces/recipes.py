"""Recipes: the variables that a data package carries, compiled once; and the owners of input variables."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from operator import itemgetter
from typing import Any

from simulator.interfaces.variables import FORMAT, IN_USE, INPUT_TYPES, NOT_FOUND, OUTPUT_TYPES, WIDTH, exists
from simulator.interfaces.wire import DATA_PACKAGE, HEADER, MalformedPackage

OUTPUT_RECIPE_ID = 1  # a connection has one output recipe
RECIPES_MAX = 255  # the recipe id is one byte


@dataclass(frozen=True)
class OutputRecipe:
    """Output variables of one connection, sent every `every` controller cycles; protocol 1 sends no recipe id."""

    names: tuple[str, ...]
    every: int
    head: tuple[int, ...]  # package type and, from protocol 2 on, recipe id
    layout: struct.Struct
    pick: Callable[[Mapping[str, Sequence[float]]], Iterable[Sequence[float]]]  # the values in order

    def encode(self, values: Mapping[str, Sequence[float]]) -> bytes:
        """Returns the data package with the present values; `values` maps each name to a sequence of numbers."""
        flat = chain.from_iterable(self.pick(values))
        return self.layout.pack(self.layout.size, *self.head, *flat)


@dataclass(frozen=True)
class InputValues:
    """Values of a data package: integer registers, runs of double registers, and all others by name."""

    ints: Sequence[tuple[int, int]] = ()  # (register, value)
    doubles: Sequence[tuple[int, Sequence[float]]] = ()  # (first register, values)
    others: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class InputRecipe:
    """Input variables of a data package, each with its position among the numbers of the package."""

    layout: struct.Struct
    ints: tuple[tuple[int, int], ...]  # (position, register)
    doubles: tuple[tuple[int, int, int], ...]  # (position, count, first register)
    others: tuple[tuple[int, int, str], ...]  # (position, count, name)

    @property
    def switches(self) -> bool:
        """Whether it has digital outputs."""
        return any(name.endswith("digital_output") for _, _, name in self.others)

    def decode(self, body: bytes) -> InputValues:
        """Returns the values in the body of a data package, without its recipe id.

        Raises:
            MalformedPackage: too few bytes; surplus ones are ignored, as the protocol does not define its padding.
        """
        if len(body) < self.layout.size:
            raise MalformedPackage(f"{len(body)} bytes of values where the recipe has {self.layout.size}")
        values = self.layout.unpack_from(body)
        return InputValues(
            [(register, values[at]) for at, register in self.ints],
            [(first, values[at : at + count]) for at, count, first in self.doubles],
            {name: values[at] if count == 1 else values[at : at + count] for at, count, name in self.others},
        )


def output_types(names: Sequence[str], version: tuple[int, ...]) -> list[str]:
    """Returns the type of every output variable, NOT_FOUND where a controller of `version` has none."""
    return [OUTPUT_TYPES[n] if n in OUTPUT_TYPES and exists(n, version) else NOT_FOUND for n in names]


def output_recipe(names: Sequence[str], every: int, protocol: int = 2) -> OutputRecipe:
    """Returns the compiled recipe of known output variables in a version of the protocol."""
    form = "".join(FORMAT[OUTPUT_TYPES[n]] for n in names)
    # for a single name, itemgetter returns the value without a tuple around it
    pick = itemgetter(*names) if len(names) > 1 else lambda values: (values[names[0]],)
    head = (DATA_PACKAGE,) if protocol == 1 else (DATA_PACKAGE, OUTPUT_RECIPE_ID)
    layout = struct.Struct(f">{HEADER.format[1:]}{'B' * (len(head) - 1)}{form}")
    return OutputRecipe(tuple(names), every, head, layout, pick)


def input_recipe(names: Sequence[str]) -> InputRecipe:
    """Returns the compiled recipe of known input variables."""
    ints = []
    doubles = []
    others = []
    at = 0
    for name in names:
        width = WIDTH[INPUT_TYPES[name]]
        kind, _, number = name.rpartition("_register_")
        if kind == "input_int":
            ints.append((at, int(number)))
        elif kind == "input_double":
            _append(doubles, at, int(number))
        else:
            others.append((at, width, name))
        at += width
    layout = struct.Struct(">" + "".join(FORMAT[INPUT_TYPES[n]] for n in names))
    return InputRecipe(layout, tuple(ints), tuple(doubles), tuple(others))


def _append(runs: list[tuple[int, int, int]], at: int, register: int) -> None:
    """Adds a double register to the last run if it continues it, else as a run of its own."""
    if runs:
        start, count, first = runs[-1]
        if at == start + count and register == first + count:
            runs[-1] = (start, count + 1, first)
            return
    runs.append((at, 1, register))


@dataclass
class InputOwners:
    """Owners of input variables; an owner is any object, compared by identity."""

    owner: dict[str, object] = field(default_factory=dict)

    def types(self, names: Sequence[str], who: object, version: tuple[int, ...]) -> list[str]:
        """Returns the type of every input variable, IN_USE where another connection owns it, else NOT_FOUND."""
        return [self._type(name, who, version) for name in names]

    def _type(self, name: str, who: object, version: tuple[int, ...]) -> str:
        if name not in INPUT_TYPES or not exists(name, version):
            return NOT_FOUND
        return INPUT_TYPES[name] if self.owner.get(name, who) is who else IN_USE

    def claim(self, names: Sequence[str], who: object) -> None:
        """Assigns the variables to `who`."""
        self.owner.update(dict.fromkeys(names, who))

    def release(self, who: object) -> None:
        """Frees all variables of `who`: its connection has ended."""
        self.owner = {name: owner for name, owner in self.owner.items() if owner is not who}
