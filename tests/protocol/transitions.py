"""What a transition of the protocol is: who takes it, which code does it, and what of it can be observed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from tests.protocol.state import ProtocolState

Planted = frozenset[str]
Happening = tuple[str, ProtocolState]  # what is observed, "" for nothing; state after it
Rule = Callable[[ProtocolState, Planted], Iterable[Happening]]

PROGRESS = "progress"  # a process, or the controller, goes on; what was frozen or cut comes back
PERSON = "person"  # asked for by somebody
FAULT = "fault"  # may happen at any time, any number of times


@dataclass(frozen=True)
class Transition:
    """A kind of step.

    Attributes:
        name: in words.
        kind: `PROGRESS`, `PERSON` or `FAULT`.
        code: functions that do it; none where no code of executor and store does.
        rule: returns what may happen in a state; nothing where it cannot.
    """

    name: str
    kind: str
    code: tuple[str, ...]
    rule: Rule


TRANSITIONS: dict[str, Transition] = {}


def transition(name: str, kind: str, *code: str) -> Callable[[Rule], Rule]:
    """Enters a rule into `TRANSITIONS`."""

    def enter(rule: Rule) -> Rule:
        assert name not in TRANSITIONS
        TRANSITIONS[name] = Transition(name, kind, code, rule)
        return rule

    return enter


def published(event: str, after: ProtocolState) -> Iterator[Happening]:
    """Yields a happening that the store shows, unless executor or database are gone before it is written there."""
    yield event, after
    yield "", after


def happenings(state: ProtocolState, planted: Planted = frozenset()) -> Iterator[tuple[str, str, ProtocolState]]:
    """Yields what may happen next: name of the transition, what is observed of it, state after it."""
    for each in TRANSITIONS.values():
        for event, after in each.rule(state, planted):
            if after != state:
                yield each.name, event, after
