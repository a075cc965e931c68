"""The explorer on graphs whose answers are known."""

from __future__ import annotations

from itertools import pairwise

from tests.protocol.explorer import cannot_reach, explore, stuck

Jugs = tuple[int, int]
SIZES = (5, 3)


def pours(jugs: Jugs) -> list[tuple[str, Jugs]]:
    """Two jugs of 5 and 3 litres: fill, empty, pour over."""
    a, b = jugs
    over = min(a, SIZES[1] - b)
    back = min(b, SIZES[0] - a)
    steps = {
        "fill 5": (SIZES[0], b),
        "fill 3": (a, SIZES[1]),
        "empty 5": (0, b),
        "empty 3": (a, 0),
        "pour 5 into 3": (a - over, b + over),
        "pour 3 into 5": (a + back, b - back),
    }
    return [(name, after) for name, after in steps.items() if after != jugs]


def test_every_state_is_found_once_by_a_shortest_way() -> None:
    """Reachable is where one jug is full or empty: 2 (5 + 1) + 2 (3 + 1) - 4; four litres take six steps."""
    graph = explore([(0, 0)], pours)
    edge = {(a, b) for a in range(6) for b in range(4) if a in (0, 5) or b in (0, 3)}
    assert set(graph.states) == edge
    assert len(graph.states) == len(edge) == 16
    found = explore([(0, 0)], pours, lambda jugs: jugs[0] == 4)
    way = found.way_to(len(found.states) - 1)
    assert [name for name, _ in way[1:]] == [
        "fill 5", "pour 5 into 3", "empty 3", "pour 5 into 3", "fill 5", "pour 5 into 3",
    ]  # fmt: skip
    for (_, before), (name, after) in pairwise(way):
        assert (name, after) in pours(before)


def graph_of(*edges: tuple[str, str, str]):
    return explore(["a"], lambda state: [(name, after) for before, name, after in edges if before == state])


def test_what_is_never_left_is_a_dead_end_or_a_cycle() -> None:
    inside = set("abcd").__contains__
    chain = (("a", "goes on", "b"), ("b", "goes on", "out"))
    assert list(stuck(graph_of(*chain), inside, lambda name: True)) == []
    assert len(list(stuck(graph_of(chain[0]), inside, lambda name: True))) == 2  # b is a dead end
    cycle = (*chain, ("b", "goes on", "c"), ("c", "goes on", "b"))
    assert len(list(stuck(graph_of(*cycle), inside, lambda name: True))) == 3
    fault = (*chain, ("b", "fault", "c"), ("c", "goes on", "b"))
    assert list(stuck(graph_of(*fault), inside, lambda name: name == "goes on")) == []


def test_what_cannot_be_reached_any_more_is_found() -> None:
    graph = graph_of(("a", "on", "b"), ("b", "fault", "c"), ("c", "on", "c"), ("b", "on", "goal"))
    assert [graph.states[i] for i in cannot_reach(graph, lambda s: s == "goal", lambda name: name == "on")] == ["c"]
