"""Recorded runs of the real processes, and whether the model allows them.

Store, answers to replacements and controller were each recorded in their own order; between them nothing is assumed but
that what was seen before something was done to a process had happened by then. A run is allowed where the model has a
path whose observed events are these.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from tests.protocol.model import happenings
from tests.protocol.state import ProtocolState

CONTROLLER = ("plays", "moves", "opens", "leaves", "shuts", "rests", "ends")
ANSWERS = ("joins", "does not join")
STATES = ("queued", "preparing", "approaching", "streaming", "braking")
SOURCES = ("store", "answers", "controller", "acts")


@dataclass(frozen=True)
class RecordedAct:
    """What was done to a process, or asked of it, and how many events had been seen by then."""

    act: str
    store: int
    controller: int


@dataclass(frozen=True)
class RecordedTrace:
    """One recorded run.

    Attributes:
        name: what was done.
        gripper: "shut" or "open", as it began.
        store: states and outcomes of the executions, in order.
        answers: to replacements.
        controller: what its states show, in order.
        acts: in order.
    """

    name: str
    gripper: str
    store: Sequence[str]
    answers: Sequence[str]
    controller: Sequence[str]
    acts: Sequence[RecordedAct] = field(default_factory=tuple)

    def write(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{self.name.replace(' ', '-')}.json").write_text(json.dumps(asdict(self), indent=1) + "\n")

    @classmethod
    def read(cls, file: Path) -> RecordedTrace:
        fields = json.loads(file.read_text())
        return cls(**{**fields, "acts": [RecordedAct(**act) for act in fields["acts"]]})


def source_of(event: str) -> str:
    """Returns which sequence of a trace an event of the model belongs to."""
    if event in CONTROLLER:
        return "controller"
    if event in ANSWERS:
        return "answers"
    return "store" if event in STATES or event.startswith("finished: ") else "acts"


def refusal(trace: RecordedTrace) -> str:
    """Returns why the model does not allow a recorded run: how far it gets. Empty where it does."""
    sequences = {
        "store": trace.store,
        "answers": trace.answers,
        "controller": trace.controller,
        "acts": [act.act for act in trace.acts],
    }
    goal = tuple(len(sequences[source]) for source in SOURCES)
    first = (ProtocolState(gripper=trace.gripper), (0,) * len(SOURCES))
    known = {first}
    waiting = deque([first])
    farthest = first[1]
    while waiting:
        state, at = waiting.popleft()
        farthest = max(farthest, at, key=sum)
        if at == goal:
            return ""
        for _, event, after in happenings(state):
            then = _advanced(trace, sequences, at, event)
            if then is not None and (after, then) not in known:
                known.add((after, then))
                waiting.append((after, then))
    left = {source: list(sequences[source][i:]) for source, i in zip(SOURCES, farthest, strict=True)}
    return f"{trace.name}: the model never shows what is left: {left}"


def _advanced(
    trace: RecordedTrace, sequences: dict[str, Sequence[str]], at: tuple[int, ...], event: str
) -> tuple[int, ...] | None:
    """Returns how far each source is after an event of the model; None where it is not what was recorded next."""
    if not event:
        return at
    source = source_of(event)
    number = SOURCES.index(source)
    if at[number] == len(sequences[source]) or sequences[source][at[number]] != event:
        return None
    if source == "acts":
        act = trace.acts[at[number]]
        seen = (at[SOURCES.index("store")], at[SOURCES.index("controller")])
        if seen[0] < act.store or seen[1] < act.controller:
            return None
    return (*at[:number], at[number] + 1, *at[number + 1 :])
