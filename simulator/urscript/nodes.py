"""The syntax tree of a script: expressions and statements, each with its place in the text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple


class Place(NamedTuple):
    """Line and column of the text, both from 1."""

    line: int
    column: int


@dataclass(frozen=True)
class Node:
    """Any part of the tree."""

    place: Place


@dataclass(frozen=True)
class Literal(Node):
    """A number, a string, True or False."""

    value: float | str | bool


@dataclass(frozen=True)
class Name(Node):
    """A variable or a constant."""

    name: str


@dataclass(frozen=True)
class Items(Node):
    """`[a, b]`, or a pose `p[x, y, z, rx, ry, rz]`."""

    items: tuple[Node, ...]
    is_pose: bool


@dataclass(frozen=True)
class Numbers(Node):
    """`[1.0, -2.0]`: a list of plain numbers."""

    values: tuple[float, ...]


@dataclass(frozen=True)
class Operation(Node):
    """An operator on one or two operands."""

    operator: str
    operands: tuple[Node, ...]


@dataclass(frozen=True)
class Index(Node):
    """`container[index]`."""

    container: Node
    index: Node


@dataclass(frozen=True)
class Call(Node):
    """A call; `run` starts it as a thread instead of waiting for it."""

    name: str
    arguments: tuple[Node, ...]
    named: tuple[tuple[str, Node], ...]
    run: bool = False


@dataclass(frozen=True)
class Assignment(Node):
    """`target = value`; `scope` is "global", "local" or empty."""

    target: Node
    value: Node
    scope: str


@dataclass(frozen=True)
class Branches(Node):
    """`if`, `elif`, `else`: conditions with their blocks, the last one without a condition if there is an else."""

    branches: tuple[tuple[Node | None, tuple[Node, ...]], ...]


@dataclass(frozen=True)
class While(Node):
    """A loop."""

    condition: Node
    block: tuple[Node, ...]


@dataclass(frozen=True)
class Jump(Node):
    """`return`, `break`, `continue`, `halt` or `pass`."""

    word: str
    value: Node | None = None


@dataclass(frozen=True)
class ThreadCommand(Node):
    """`kill` or `join` of a thread's handle."""

    word: str
    handle: Node


@dataclass(frozen=True)
class Critical(Node):
    """`enter_critical` or `exit_critical`."""

    enters: bool


@dataclass(frozen=True)
class Function(Node):
    """`def`, `sec` or `thread`, with parameters and body; `defaults` are those of the last parameters."""

    kind: str
    name: str
    parameters: tuple[str, ...]
    defaults: tuple[Node, ...]
    block: tuple[Node, ...] = field(repr=False)


def walk(nodes: Sequence[Node]) -> list[Node]:
    """Returns nodes and everything below them."""
    found: list[Node] = []
    _collect(tuple(nodes), found)
    return found


def _collect(value: object, found: list[Node]) -> None:
    if isinstance(value, Node):
        found.append(value)
        for part in vars(value).values():
            _collect(part, found)
    elif isinstance(value, tuple) and not isinstance(value, Place):
        for item in value:
            _collect(item, found)
