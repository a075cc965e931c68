"""The model: all transitions together, the faults that can be planted in it, and its explored graph in words."""

from __future__ import annotations

from collections.abc import Callable, Collection

from tests.protocol import executing, streaming
from tests.protocol.explorer import StateGraph, explore
from tests.protocol.state import ProtocolState, broken
from tests.protocol.transitions import FAULT, PROGRESS, TRANSITIONS, Planted, happenings

Steps = Callable[[ProtocolState], list[tuple[str, ProtocolState]]]

# Planted fault: the invariant that it breaks; "" where it breaks none, and an execution never gets its outcome.
PLANTED = {
    streaming.ALONE: "the arm never moves without somebody alive who can stop it",
    streaming.HANGS: "the arm never moves without somebody alive who can stop it",
    streaming.LATE_SWAP: "a plan takes over before the tick at which it begins",
    executing.REPEATED: "an object is let go at most once",
    executing.TWO_WRITERS: "no outcome is written while the arm moves on a command",
    executing.OVERWRITTEN: "an execution gets one outcome",
    executing.SPARED: "nothing is let go for an execution that has its outcome",
    executing.FORGOTTEN: "",
}


def steps(planted: Planted = frozenset(), without: Collection[str] = ()) -> Steps:
    """Returns the steps of the model with planted faults, and without some transitions."""

    def of(state: ProtocolState) -> list[tuple[str, ProtocolState]]:
        found = happenings(state, planted)
        return list(dict.fromkeys((name, after) for name, _, after in found if name not in without))

    return of


def explored(
    planted: Planted = frozenset(),
    without: Collection[str] = (),
    ends_at: Callable[[ProtocolState], bool] = lambda state: bool(broken(state)),
) -> StateGraph[ProtocolState]:
    """Returns all that can be reached; up to the first state where `ends_at` holds."""
    return explore([ProtocolState()], steps(planted, without), ends_at)


def goes_on(name: str) -> bool:
    """Whether a transition happens by itself."""
    return TRANSITIONS[name].kind == PROGRESS


def is_no_fault(name: str) -> bool:
    return TRANSITIONS[name].kind != FAULT


def in_words(graph: StateGraph[ProtocolState], number: int) -> str:
    """Returns a shortest way to a state, a step a line, with what it changes."""
    lines = []
    before = None
    for name, state in graph.way_to(number):
        lines.append("at rest, nothing queued" if before is None else f"{name}{_changes(before, state)}")
        before = state
    return "\n".join(f"{i:3} {line}" for i, line in enumerate(lines))


def _changes(before: ProtocolState, after: ProtocolState) -> str:
    found = []
    for field in ProtocolState._fields:
        old, new = getattr(before, field), getattr(after, field)
        if old == new:
            continue
        if field in ("stream", "orphan"):
            phases = ["none" if each is None else each.phase + " frozen" * each.frozen for each in (old, new)]
            old, new = phases
        if old != new:
            found.append(f"{field} {old!s} -> {new!s}")
    return f" ({', '.join(found)})" if found else ""
