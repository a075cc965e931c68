"""Recipes: which variables a data package carries, compiled once; and who owns which input."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from executor.simulator.variables import FORMAT, IN_USE, INPUT_TYPES, NOT_FOUND, OUTPUT_TYPES, WIDTH, exists
from executor.simulator.wire import DATA_PACKAGE, HEADER, MalformedPackage

OUTPUT_RECIPE_ID = 1  # one output recipe a connection
RECIPES_MAX = 255  # the recipe id is one byte


@dataclass(frozen=True)
class OutputRecipe:
    """Output variables of one connection, sent every `every` controller cycles."""

    names: tuple[str, ...]
    every: int
    layout: struct.Struct

    def encode(self, values: Mapping[str, Sequence[float]]) -> bytes:
        """Returns the data package with the values of now; `values` holds a sequence a name."""
        flat: list[float] = []
        for name in self.names:
            flat += values[name]
        return self.layout.pack(self.layout.size, DATA_PACKAGE, OUTPUT_RECIPE_ID, *flat)


@dataclass(frozen=True)
class InputRecipe:
    """Input variables that one data package of a connection carries."""

    names: tuple[str, ...]
    layout: struct.Struct
    single: bool  # every variable is one number: no vectors to cut out

    def decode(self, body: bytes) -> dict[str, float | tuple[float, ...]]:
        """Returns name -> value of a data package's body, the recipe id stripped.

        Raises:
            MalformedPackage: too few bytes; too many are ignored, as the protocol's padding is not defined.
        """
        if len(body) < self.layout.size:
            raise MalformedPackage(f"{len(body)} bytes of values where the recipe has {self.layout.size}")
        values = self.layout.unpack_from(body)
        if self.single:
            return dict(zip(self.names, values, strict=True))
        return self._cut(values)

    def _cut(self, values: tuple[float, ...]) -> dict[str, float | tuple[float, ...]]:
        decoded: dict[str, float | tuple[float, ...]] = {}
        at = 0
        for name in self.names:
            width = WIDTH[INPUT_TYPES[name]]
            decoded[name] = values[at] if width == 1 else values[at:at + width]
            at += width
        return decoded


def output_types(names: Sequence[str], version: tuple[int, ...]) -> list[str]:
    """Returns the type of every output variable, NOT_FOUND where a controller of `version` has none."""
    return [OUTPUT_TYPES[n] if n in OUTPUT_TYPES and exists(n, version) else NOT_FOUND for n in names]


def output_recipe(names: Sequence[str], every: int) -> OutputRecipe:
    """Returns the compiled recipe of known output variables."""
    form = "".join(FORMAT[OUTPUT_TYPES[n]] for n in names)
    return OutputRecipe(tuple(names), every, struct.Struct(f">{HEADER.format[1:]}B{form}"))


def input_recipe(names: Sequence[str]) -> InputRecipe:
    """Returns the compiled recipe of known input variables."""
    types = [INPUT_TYPES[n] for n in names]
    single = all(WIDTH[t] == 1 for t in types)
    return InputRecipe(tuple(names), struct.Struct(">" + "".join(FORMAT[t] for t in types)), single)


@dataclass
class InputOwners:
    """Which connection owns which input variable; an owner is any hashable token."""

    owner: dict[str, object] = field(default_factory=dict)

    def types(self, names: Sequence[str], who: object, version: tuple[int, ...]) -> list[str]:
        """Returns the type of every input variable, IN_USE where another connection owns it, else NOT_FOUND."""
        return [self._type(name, who, version) for name in names]

    def _type(self, name: str, who: object, version: tuple[int, ...]) -> str:
        if name not in INPUT_TYPES or not exists(name, version):
            return NOT_FOUND
        return INPUT_TYPES[name] if self.owner.get(name, who) is who else IN_USE

    def claim(self, names: Sequence[str], who: object) -> None:
        """Gives the variables to `who`."""
        self.owner.update(dict.fromkeys(names, who))

    def release(self, who: object) -> None:
        """Takes everything back from `who`: its connection has ended."""
        self.owner = {name: owner for name, owner in self.owner.items() if owner is not who}
