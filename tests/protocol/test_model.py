"""The protocol of executor, stream, store and controller, explored to the end.

What is in it, and what is not: docs/decisions/0037-the-protocol-explored.md.
"""

from __future__ import annotations

import pkgutil
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from tests.protocol.explorer import StateGraph, cannot_reach, stuck
from tests.protocol.model import PLANTED, explored, goes_on, in_words, is_no_fault
from tests.protocol.state import ProtocolState, broken, who_can_stop
from tests.protocol.traces import RecordedTrace, refusal
from tests.protocol.transitions import TRANSITIONS

RECORDED = sorted((Path(__file__).parent / "recorded").glob("*.json"))
# What the planted faults do not need: their counterexamples are found in a smaller world.
ASIDE = (
    "the link is cut",
    "the database is gone",
    "the executor is frozen",
    "the executor is asked to end",
    "the stream stops by itself",
)


def waits_for_its_outcome(state: ProtocolState) -> bool:
    return state.row == "claimed"


@pytest.fixture(scope="module")
def graph() -> StateGraph[ProtocolState]:
    """All states, under any number of kills, freezes and losses."""
    found = explored()
    guards = Counter(len(who_can_stop(state)) for state in found.states if state.arm == "moving")
    print(f"{len(found.states):,} states, {found.step_count:,} transitions, depth {found.depth}")
    print(f"states in which the arm moves, by how many can stop it: {dict(sorted(guards.items()))}")
    return found


@pytest.mark.slow
def test_the_invariants_hold_in_every_state(graph: StateGraph[ProtocolState]) -> None:
    last = len(graph.states) - 1
    assert broken(graph.states[last]) == [], in_words(graph, last)
    assert any(state.arm == "moving" for state in graph.states)


def test_every_transition_happens(graph: StateGraph[ProtocolState]) -> None:
    assert {name for steps in graph.steps for name, _ in steps} == set(TRANSITIONS)


def test_every_claimed_execution_gets_its_outcome(graph: StateGraph[ProtocolState]) -> None:
    """Wherever the faults stop, whatever goes on by itself then leads there: there is no dead end and no cycle before.

    So it is enough that a step that is possible is taken one day; who is to start or wake an executor, mend a link or a
    database does so one day, too.
    """
    left = list(stuck(graph, waits_for_its_outcome, goes_on))
    assert left == [], in_words(graph, left[0])


def test_the_cell_can_always_complete_an_execution_again(graph: StateGraph[ProtocolState]) -> None:
    """With people who acknowledge and queue, and no further fault; a stream that stays frozen keeps nobody from it."""
    left = list(cannot_reach(graph, lambda s: (s.row, s.kept) == ("finished", "completed"), is_no_fault))
    assert left == [], in_words(graph, left[0])


@pytest.mark.parametrize("fault", [fault for fault, invariant in PLANTED.items() if invariant])
def test_a_planted_fault_is_found(fault: str) -> None:
    found = explored(frozenset([fault]), ASIDE)
    last = len(found.states) - 1
    print(in_words(found, last))
    assert PLANTED[fault] in broken(found.states[last])


@pytest.mark.parametrize("fault", [fault for fault, invariant in PLANTED.items() if not invariant])
def test_a_planted_fault_that_loses_an_outcome_is_found(fault: str) -> None:
    found = explored(frozenset([fault]), ASIDE)
    number = next(stuck(found, waits_for_its_outcome, goes_on))
    print(in_words(found, number))
    assert not any(goes_on(name) for name, _ in found.steps[number])
    assert list(stuck(explored((), ASIDE), waits_for_its_outcome, goes_on)) == []


@pytest.mark.parametrize("name", TRANSITIONS)
def test_a_transition_names_the_code_that_does_it(name: str) -> None:
    for path in TRANSITIONS[name].code:
        assert callable(pkgutil.resolve_name(path)), path


@pytest.mark.parametrize("file", RECORDED, ids=lambda file: file.stem)
def test_a_recorded_run_is_a_path(file: Path) -> None:
    assert refusal(RecordedTrace.read(file)) == ""


SPOILT = {
    "twice let go": lambda t: replace(t, controller=_after(t.controller, "opens", "shuts", "opens")),
    "two outcomes": lambda t: replace(t, store=[*t.store, "finished: aborted"]),
    "no outcome": lambda t: replace(t, store=[*t.store[:-1], "preparing"]),
    "moves without a program": lambda t: replace(t, controller=["moves", *t.controller]),
    "goes on after its program": lambda t: replace(t, controller=[*t.controller, "moves"]),
    "another outcome": lambda t: replace(t, store=[*t.store[:-1], "finished: executor_lost"]),
    "joined unasked": lambda t: replace(t, answers=["joins"]),
}


def _after(events: list[str], event: str, *more: str) -> list[str]:
    at = list(events).index(event) + 1
    return [*events[:at], *more, *events[at:]]


@pytest.mark.parametrize("spoil", SPOILT)
def test_a_run_that_breaks_the_protocol_is_no_path(spoil: str) -> None:
    throw = next(RecordedTrace.read(file) for file in RECORDED if file.stem == "throw")
    assert refusal(SPOILT[spoil](throw)) != ""


def test_the_traces_cover_what_can_be_observed() -> None:
    traces = [RecordedTrace.read(file) for file in RECORDED]
    shown = {event for t in traces for event in (*t.store, *t.answers, *t.controller, *(a.act for a in t.acts))}
    assert shown >= {"opens", "leaves", "shuts", "rests", "joins", "kills stream", "kills executor", "braking"}
    assert shown >= {f"finished: {outcome}" for outcome in ("completed", "aborted", "executor_lost")}
