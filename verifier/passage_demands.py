"""The passages of a plan: what its request asks of each, beside what its document tells of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

GREATEST_S = 1e9  # [s] of an edge; far beyond any motion


@dataclass(frozen=True, eq=False)
class ToldEdge:
    """An output's edge.

    Attributes:
        asked: the output, its level and its offsets, as the request has them.
        command_s, edge_s: when it is commanded and when it changes, as the document tells [s].
    """

    asked: Mapping[str, Any]
    command_s: float
    edge_s: float

    @property
    def line(self) -> tuple[str, int]:
        """Kind and number of the output."""
        return str(self.asked["output"]), int(self.asked["index"])


@dataclass(frozen=True, eq=False)
class ToldPassage:
    """A passage.

    Attributes:
        name: its name.
        asked: as the request has it: a state or a line.
        index, end_index: samples at which the document says that it begins and ends.
        edges: of its outputs, in the request's order.
    """

    name: str
    asked: Mapping[str, Any]
    index: int
    end_index: int
    edges: tuple[ToldEdge, ...]

    @property
    def state(self) -> Mapping[str, Any] | None:
        """The state; None of a line."""
        return self.asked.get("state")

    @property
    def line(self) -> Mapping[str, Any] | None:
        """The line; None of a state."""
        return self.asked.get("line")

    @property
    def releases(self) -> bool:
        """Whether an object leaves there."""
        return bool(self.asked.get("releases"))


def told_passages(asked: Sequence[Any], told: Sequence[Any], samples: int) -> tuple[ToldPassage, ...]:
    """Returns passages of a request, already checked, beside those of the plan's document.

    Raises:
        ValueError: the document tells of others.
    """
    if [each["name"] for each in asked] != [each["name"] for each in told]:
        raise ValueError("passages: the plan passes others than its request asks for")
    found = []
    for one, other in zip(asked, told, strict=True):
        index, end = other["index"], other["end_index"]
        if type(index) is not int or type(end) is not int or not 0 <= index <= end < samples:
            raise ValueError(f"passages: {one['name']!r} is told from {index} to {end}, of {samples} samples")
        found.append(ToldPassage(one["name"], one, index, end, _edges(one, other)))
    return tuple(found)


def _edges(asked: Mapping[str, Any], told: Mapping[str, Any]) -> tuple[ToldEdge, ...]:
    found = []
    for one, other in zip(asked.get("outputs") or (), told["outputs"], strict=True):
        if any(one[key] != other[key] for key in ("output", "index", "level")):
            raise ValueError(f"passages: {asked['name']!r} switches another output than its request asks for")
        times = other["command_time_s"], other["edge_time_s"]
        if not all(isinstance(each, int | float) and abs(each) <= GREATEST_S for each in times):
            raise ValueError(f"passages: {asked['name']!r} has an output whose times are {times!r}")
        found.append(ToldEdge(one, *map(float, times)))
    return tuple(found)
