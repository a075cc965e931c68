"""An explicit-state explorer: breadth first, every state once, with the shortest way to each."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Generic, TypeVar

S = TypeVar("S", bound=Hashable)


@dataclass
class StateGraph(Generic[S]):
    """All states that are reachable, and the steps between them.

    Attributes:
        states: in the order in which they were found.
        steps: of each state, (name of the transition, number of the state after it).
        reached_by: of each state, (number of the state before, name of the transition) on a shortest way.
        depth: steps of the longest of the shortest ways.
    """

    states: list[S] = field(default_factory=list)
    steps: list[list[tuple[str, int]]] = field(default_factory=list)
    reached_by: list[tuple[int, str] | None] = field(default_factory=list)
    depth: int = 0

    @property
    def step_count(self) -> int:
        return sum(len(each) for each in self.steps)

    def way_to(self, number: int) -> list[tuple[str, S]]:
        """Returns a shortest way to a state: (name of the transition, state after it), the first without a name."""
        way = []
        at: int | None = number
        while at is not None:
            before = self.reached_by[at]
            way.append(("", self.states[at]) if before is None else (before[1], self.states[at]))
            at = None if before is None else before[0]
        return way[::-1]


def explore(
    starts: Iterable[S],
    steps_of: Callable[[S], Iterable[tuple[str, S]]],
    ends_at: Callable[[S], bool] = lambda state: False,
) -> StateGraph[S]:
    """Returns the graph of all states; at the first state where `ends_at` holds it stops, and that state is the last.

    Args:
        starts: the states to begin in.
        steps_of: returns the steps from a state: (name of the transition, state after it).
        ends_at: whether to stop.
    """
    graph: StateGraph[S] = StateGraph()
    numbers: dict[S, int] = {}
    depths: list[int] = []
    waiting: deque[int] = deque()

    def number_of(state: S, before: tuple[int, str] | None) -> int:
        found = numbers.get(state)
        if found is None:
            found = numbers[state] = len(graph.states)
            graph.states.append(state)
            graph.steps.append([])
            graph.reached_by.append(before)
            depths.append(0 if before is None else depths[before[0]] + 1)
            waiting.append(found)
        return found

    for state in starts:
        if ends_at(graph.states[number_of(state, None)]):
            return graph
    while waiting:
        number = waiting.popleft()
        graph.depth = depths[number]
        for name, after in steps_of(graph.states[number]):
            known = len(graph.states)
            found = number_of(after, (number, name))
            graph.steps[number].append((name, found))
            if found == known and ends_at(after):
                return graph
    return graph


def stuck(graph: StateGraph[S], within: Callable[[S], bool], progress: Callable[[str], bool]) -> Iterator[int]:
    """Yields the states `within` that are never left where only `progress` goes on: dead ends, and those on cycles.

    States are taken away whose every step of progress leaves, or leads to one that was taken away; there must be one.
    """
    inside = {number for number, state in enumerate(graph.states) if within(state)}
    left = {number: 0 for number in inside}
    before: dict[int, list[int]] = {number: [] for number in inside}
    leaves = []
    for number in inside:
        onward = [after for name, after in graph.steps[number] if progress(name)]
        for after in onward:
            if after in inside:
                left[number] += 1
                before[after].append(number)
        if onward and left[number] == 0:
            leaves.append(number)
    while leaves:
        gone = leaves.pop()
        inside.discard(gone)
        for number in before[gone]:
            left[number] -= 1
            if left[number] == 0:
                leaves.append(number)
    yield from sorted(inside)


def cannot_reach(graph: StateGraph[S], goal: Callable[[S], bool], allowed: Callable[[str], bool]) -> Iterator[int]:
    """Yields the states from which no way of `allowed` transitions leads to the goal."""
    before: list[list[int]] = [[] for _ in graph.states]
    for number, steps in enumerate(graph.steps):
        for name, after in steps:
            if allowed(name):
                before[after].append(number)
    reached = {number for number, state in enumerate(graph.states) if goal(state)}
    waiting = list(reached)
    while waiting:
        for number in before[waiting.pop()]:
            if number not in reached:
                reached.add(number)
                waiting.append(number)
    yield from (number for number in range(len(graph.states)) if number not in reached)
