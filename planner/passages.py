"""Passages: the states and lines that a motion passes one after another, and the outputs that switch about each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array, read_only
from planner.cell import Cell
from planner.errors import FieldError
from planner.fields import Choice, Field, Flag, Kinds, Number, Record, RecordList, Text, Vector, Whole, YesOr, required
from planner.grippers import OUTPUTS
from planner.releases import KINDS, POSE, JointRelease, PoseRelease, Release, SteadyLine, release_document
from planner.trajectory import Trajectory

PASSAGES_MAX = 20
OUTPUTS_MAX = 8  # switched about one passage: a controller's bank of outputs has no more
OFFSET_MAX_S = 2.0  # [s] of an output from its passage; catches milliseconds
NAME_MAX = 64  # characters of a passage's name
ROUNDING = 1e-6  # [ticks] of a time in floating point
TIME_MAX_S = 60.0  # [s] of a passage: a motion may take no longer
NOT_YET = "is not supported yet"


@dataclass(frozen=True)
class OutputSwitch:
    """A digital output that switches at a fixed time about a passage.

    Attributes:
        output, index: kind and number of the output.
        level: that it changes to.
        offset_s: from the passage to the edge [s]; negative before it.
        offset_m: place on a line from whose passing `offset_s` counts, from its start [m]; None: the start, or a state.
    """

    output: str
    index: int
    level: bool
    offset_s: float = 0.0
    offset_m: float | None = None

    def as_document(self) -> dict[str, Any]:
        """Returns the fields in the shape of `POST /plan`."""
        return {name: value for name, value in asdict(self).items() if value is not None}


@dataclass(frozen=True, eq=False)
class Passage:
    """A state that a motion passes at a tick, or a line that begins there.

    Attributes:
        name: that its request gives it.
        state: what is required of the state, as of a release; or the line.
        outputs: what switches about it.
        releases: whether an object leaves the tool there.
        gripper: name of the gripper that lets it go; empty: the cell's own.
        not_before_s: earliest time from the motion's start [s].
        at_s: time from the motion's start, rounded to a tick [s]; None: as soon as possible.
    """

    name: str
    state: Release
    outputs: tuple[OutputSwitch, ...] = ()
    releases: bool = False
    not_before_s: float = 0.0
    at_s: float | None = None
    gripper: str = ""

    @property
    def is_timed(self) -> bool:
        """Whether it may be too soon."""
        return self.at_s is not None or self.not_before_s > 0.0

    def ticks(self, rate_hz: float) -> int:
        """Returns the number of ticks that it lasts: 0 of a state; a line goes on to a whole tick."""
        return math.ceil(self.state.lasts_s * rate_hz - ROUNDING)

    def offset_s(self, switch: OutputSwitch) -> float:
        """Returns the time from its tick to the edge of one of its outputs [s]."""
        if switch.offset_m is None or not isinstance(self.state, SteadyLine):
            return switch.offset_s
        return switch.offset_m / self.state.speed_m_s + switch.offset_s

    def first_tick(self, rate_hz: float) -> int:
        """Returns the first tick at which it may be passed."""
        return math.ceil(self.not_before_s * rate_hz - ROUNDING) if self.at_s is None else round(self.at_s * rate_hz)

    def is_in_time(self, tick: int, rate_hz: float) -> bool:
        """Returns whether it may be passed at a tick."""
        first = self.first_tick(rate_hz)
        return tick == first if self.at_s is not None else tick >= first


class OutputEdge(NamedTuple):
    """An output's edge in a plan; times are on the plan's clock [s].

    Attributes:
        passage: number of its passage.
        switch: the output, and the level that it changes to.
        command_time_s: when the output is commanded: its delay and the arm's lag before the edge.
        edge_time_s: when it is to change; of a gripper, when its object is to leave.
        lets_go: whether it is a gripper's.
    """

    passage: int
    switch: OutputSwitch
    command_time_s: float
    edge_time_s: float
    lets_go: bool = False


SWITCH = Record(
    "OutputSwitchRequest",
    "A digital output that switches about a passage.",
    {
        "output": required(Choice(tuple(OUTPUTS)), "Kind of the output."),
        "index": required(Whole(0, max(OUTPUTS.values()) - 1), "Number of the output."),
        "level": required(Flag(), "Level that it changes to."),
        "offset_s": Field(
            Number(-OFFSET_MAX_S, OFFSET_MAX_S),
            "Time from the passage to the edge [s]; negative: before it.",
            default=0.0,
        ),
        "offset_m": Field(
            Number(0.0), "Place on a line, from its start [m]: `offset_s` counts from when the tool is there."
        ),
    },
)


def _check_passage(given: dict[str, Any], path: str, errors: list[FieldError]) -> None:
    if ("state" in given) == ("line" in given):
        errors.append(FieldError(f"{path}.state", "give either state or line"))
    elif "line" in given and "releases" in given:
        errors.append(FieldError(f"{path}.releases", "a line lets nothing go: give a state"))


PASSAGE = Record(
    "PassageRequest",
    "A state to pass at speed, exactly on a tick, or a line that begins on one.",
    {
        "name": required(Text(NAME_MAX), "Name of the passage, of its own in the motion."),
        "state": Field(
            Kinds({name: kind.record for name, kind in KINDS.items()}),
            "The state, of any kind of `release`. Give either a state or a line.",
        ),
        "line": Field(SteadyLine.record, "The straight line."),
        "releases": Field(
            YesOr(NAME_MAX),
            "true: the object leaves the tool here. A name: it leaves that one of the cell's `[grippers]`, and the "
            "state is one of its tool centre point. Each gripper lets go at one passage at most.",
        ),
        "outputs": Field(RecordList(SWITCH, 0, OUTPUTS_MAX), "What switches about it; absent: nothing."),
        "at_s": Field(
            Number(above=0.0, most=TIME_MAX_S),
            "Time of the passage from the motion's start, rounded to a tick [s]; absent: as soon as possible.",
        ),
        "not_before_s": Field(
            Number(above=0.0, most=TIME_MAX_S), "Earliest time of the passage from the motion's start [s]."
        ),
    },
    _check_passage,
)
PASSAGES = RecordList(PASSAGE, 1, PASSAGES_MAX)
END = Kinds(
    {
        "rest": Record("RestEndRequest", "At rest, anywhere.", {}),
        "home": Record("HomeEndRequest", "At rest in the cell's home.", {}),
        "joint": Record(
            "JointEndRequest",
            "At rest in a joint position.",
            {"positions": required(Vector(6), "Joint positions [rad].")},
        ),
        "pose": Record(
            "PoseEndRequest",
            "At rest with the tool in a pose.",
            {"pose": required(POSE, "Pose of the tool centre point, in `frame`.")},
        ),
    }
)


def passages_from_json(given: Sequence[Mapping[str, Any]], X_WR: Array) -> tuple[Passage, ...]:
    """Returns the passages in the world.

    Args:
        given: as read by `PASSAGES`.
        X_WR: pose of the request's frame.
    """
    return tuple(
        Passage(
            name=each["name"],
            state=_state_from_json(each, X_WR),
            outputs=tuple(OutputSwitch(**switch) for switch in each.get("outputs", ())),
            releases="releases" in each,
            gripper=gripper_named(each),
            not_before_s=each.get("not_before_s", 0.0),
            at_s=each.get("at_s"),
        )
        for each in given
    )


def gripper_named(passage: Mapping[str, Any]) -> str:
    """Returns the name of the gripper that a passage of a request lets go of; empty: the cell's own, or none."""
    releases = passage.get("releases")
    return releases if isinstance(releases, str) else ""


def _state_from_json(given: Mapping[str, Any], X_WR: Array) -> Release:
    """Returns the state or the line of a passage in the world."""
    if "line" in given:
        return SteadyLine.from_json(given["line"], X_WR)
    return KINDS[given["state"]["kind"]].from_json(given["state"], X_WR)


def passage_document(passage: Passage) -> dict[str, Any]:
    """Returns a passage in the shape of `POST /plan`, in the world frame."""
    state = passage.state
    stated = {"line": state.to_json()} if isinstance(state, SteadyLine) else {"state": release_document(state)}
    document: dict[str, Any] = {"name": passage.name, **stated}
    if passage.releases:
        document["releases"] = passage.gripper or True
    if passage.at_s is not None:
        document["at_s"] = passage.at_s
    if passage.not_before_s > 0.0:
        document["not_before_s"] = passage.not_before_s
    return {**document, "outputs": [switch.as_document() for switch in passage.outputs]}


def end_from_json(given: Mapping[str, Any], home: Array, X_WR: Array) -> Release | None:
    """Returns the state at rest in which a motion ends; None for rest anywhere.

    Args:
        given: as read by `END`.
        home: joint positions of the cell's home (6,) [rad].
        X_WR: pose of the request's frame.
    """
    still = read_only(np.zeros(6))
    if given["kind"] == "rest":
        return None
    if given["kind"] == "pose":
        at_rest = {"linear": [0.0, 0.0, 0.0], "angular": [0.0, 0.0, 0.0]}
        return PoseRelease.from_json({"pose": given["pose"], "twist": at_rest}, X_WR)
    return JointRelease(home if given["kind"] == "home" else read_only(given["positions"]), still)


def end_document(end: Release | None) -> dict[str, Any]:
    """Returns an end in the shape of `POST /plan`, in the world frame."""
    if end is None:
        return {"kind": "rest"}
    given = release_document(end)
    return {name: value for name, value in given.items() if name not in ("velocities", "twist")}


def first_release(passages: Sequence[Passage]) -> int | None:
    """Returns the number of the first passage at which an object leaves; None where none does."""
    return next((number for number, each in enumerate(passages) if each.releases), None)


def main_state(passages: Sequence[Passage]) -> Release:
    """Returns the state at which an object leaves, the first; without one, that of the last passage."""
    number = first_release(passages)
    return passages[-1 if number is None else number].state


def first_gripper(passages: Sequence[Passage]) -> str:
    """Returns the name of the gripper that lets go first; empty: the cell's own, or none."""
    number = first_release(passages)
    return "" if number is None else passages[number].gripper


def with_main_state(passages: Sequence[Passage], state: Release) -> tuple[Passage, ...]:
    """Returns the passages with another `main_state`."""
    was = main_state(passages)
    return tuple(replace(each, state=state) if each.state is was else each for each in passages)


def released_first(passages: Sequence[Passage], passed: Sequence[int]) -> int:
    """Returns the sample of a motion's release: that of the passage where an object leaves first; else of the last."""
    number = first_release(passages)
    return passed[-1 if number is None else number]


def passed_until(passages: Sequence[Passage], trajectory: Trajectory) -> list[int]:
    """Returns the samples at which the passages of a motion end: those of their states, or the last of their lines.

    Without passages that is its release.
    """
    rate_hz = trajectory.sample_rate_hz
    if not passages:
        return [trajectory.release_index]
    return [index + each.ticks(rate_hz) for each, index in zip(passages, trajectory.passed, strict=True)]


def passage_errors(passages: Sequence[Passage], cell: Cell) -> list[FieldError]:
    """Returns every field of a request's passages that contradicts another one or the cell."""
    errors = []
    names = [each.name for each in passages]
    for i, each in enumerate(passages):
        path = f"passages[{i}]"
        if each.name in names[:i]:
            errors.append(FieldError(f"{path}.name", f"{each.name!r} is the name of another passage"))
        if each.state.aims and not each.releases:
            reason = f"a state of kind {each.state.name} lets the object go: give releases, or another kind"
            errors.append(FieldError(f"{path}.state.kind", reason))
        if each.releases and each.state.is_at_rest:
            errors.append(FieldError(f"{path}.state", "is at rest: nothing is thrown from there"))
        if reason := _wrong_gripper(passages, i, cell):
            errors.append(FieldError(f"{path}.releases", reason))
        errors += _time_errors(passages, i)
        of = cell.seen_from(each.gripper) if each.gripper in cell.grippers else cell
        for error in each.state.errors(of):
            errors.append(FieldError(error.field.replace("release.", f"{path}.state.", 1), error.reason))
        errors += _output_errors(each, f"{path}.outputs", cell)
    return errors


def _time_errors(passages: Sequence[Passage], number: int) -> list[FieldError]:
    """Returns what is wrong with the time of a passage: it has two, or one before it is no earlier."""
    asked = passages[number]
    if asked.at_s is None:
        return []
    if asked.not_before_s > 0.0:
        return [FieldError(f"passages[{number}].not_before_s", "give either at_s or not_before_s")]
    before = [(max(each.at_s or 0.0, each.not_before_s) + each.state.lasts_s, each.name) for each in passages[:number]]
    latest_s, name = max(before, default=(0.0, ""))
    if asked.at_s > latest_s:
        return []
    reason = f"must be above {latest_s:.12g}, when {name!r} before it is passed at the soonest; it is {asked.at_s:.12g}"
    return [FieldError(f"passages[{number}].at_s", reason)]


def _wrong_gripper(passages: Sequence[Passage], number: int, cell: Cell) -> str:
    """Returns why a passage cannot let go of an object; empty where it can, or lets none go."""
    asked = passages[number]
    if not asked.releases:
        return ""
    if asked.gripper and asked.gripper not in cell.grippers:
        names = ", ".join(name for name in cell.grippers if name) or "none besides [gripper]"
        return f"{asked.gripper!r} is no gripper of the cell: there are {names}"
    same = (each.name for each in passages[:number] if each.releases and each.gripper == asked.gripper)
    before = next(same, None)
    if before is None:
        return ""
    several = "; a cell with [grippers] has more objects to let go" if not cell.grippers else ""
    return f"{before!r} lets the object go already{several}"


def _output_errors(passage: Passage, path: str, cell: Cell) -> list[FieldError]:
    """Returns the outputs that do not exist, are the gripper's own, off the line, or are to switch twice at once."""
    errors = []
    outputs = passage.outputs
    length = passage.state.length_m if isinstance(passage.state, SteadyLine) else None
    tick_s = 1.0 / cell.robot.sample_rate_hz
    own = []
    for gripper in (cell.gripper, *(each.gripper for each in cell.grippers.values())):
        own += [] if gripper.link is not None else [(gripper.output, gripper.index)]
        if gripper.second is not None:
            own.append((gripper.second.output, gripper.second.index))
    for i, each in enumerate(outputs):
        line = (each.output, each.index)
        if each.index >= OUTPUTS[each.output]:
            reason = f"{each.index} is none of the {OUTPUTS[each.output]} outputs of kind {each.output}"
            errors.append(FieldError(f"{path}[{i}].index", reason))
        if line in own:
            errors.append(FieldError(f"{path}[{i}]", "is the gripper's own output: give the passage `releases`"))
        if each.offset_m is not None and (length is None or each.offset_m > length * (1.0 + ROUNDING)):
            where = "a state has no length: give offset_s" if length is None else f"the line ends after {length:g} m"
            errors.append(FieldError(f"{path}[{i}].offset_m", where))
        same = [other for other in outputs[:i] if line == (other.output, other.index)]
        offset_s = passage.offset_s(each)
        if any(is_closer(offset_s, passage.offset_s(other), tick_s) for other in same):
            reason = f"{offset_s:g} s is less than a tick of {1e3 * tick_s:g} ms from another edge of this output"
            errors.append(FieldError(f"{path}[{i}].offset_s", reason))
    return errors


def is_closer(one_s: float, other_s: float, tick_s: float) -> bool:
    """Returns whether two edges about one passage, at offsets from it [s], are less than a tick apart."""
    return abs(one_s - other_s) < (1.0 - ROUNDING) * tick_s


def crowded_edges(edges: Sequence[OutputEdge], tick_s: float) -> tuple[OutputEdge, OutputEdge] | None:
    """Returns two edges of one output that are less than a tick apart: no controller makes both. None without any."""
    last: dict[tuple[str, int], OutputEdge] = {}
    for edge in edges:
        line = (edge.switch.output, edge.switch.index)
        if line in last and edge.edge_time_s - last[line].edge_time_s < (1.0 - ROUNDING) * tick_s:
            return last[line], edge
        last[line] = edge
    return None


def output_edges(cell: Cell, passages: Sequence[Passage], trajectory: Trajectory) -> list[OutputEdge]:
    """Returns the edges of a motion's outputs in the order of their commands.

    Of several grippers the one that lets go first is not among them: the tick grid is laid through its command.
    """
    edges = []
    lets_go = [number for number, passage in enumerate(passages) if passage.releases]
    for number, passage in enumerate(passages):
        passed_s = trajectory.passed[number] / trajectory.sample_rate_hz
        for switch in passage.outputs:
            edge_s = passed_s + passage.offset_s(switch)
            command_s = edge_s - cell.digital_output(switch.output, switch.index).delay_s - cell.timing.lag_s
            edges.append(OutputEdge(number, switch, command_s, edge_s))
        if number in lets_go[1:]:
            gripper = cell.seen_from(passage.gripper).gripper
            switch = OutputSwitch(gripper.output, gripper.index, gripper.open_level)
            edges.append(OutputEdge(number, switch, passed_s - gripper.delay_s - cell.timing.lag_s, passed_s, True))
    return sorted(edges, key=lambda edge: edge.command_time_s)


def passed_documents(cell: Cell, passages: Sequence[Passage], trajectory: Trajectory) -> list[dict[str, Any]]:
    """Returns of each passage of a motion its name, the samples at which it begins and ends, and its outputs' times."""
    edges = output_edges(cell, passages, trajectory)
    until = passed_until(passages, trajectory)
    return [
        {
            "name": passage.name,
            "index": index,
            "end_index": end_index,
            "outputs": [
                {
                    **edge.switch.as_document(),
                    "command_time_s": edge.command_time_s,
                    "edge_time_s": edge.edge_time_s,
                }
                for switch in passage.outputs
                for edge in edges
                if edge.switch is switch
            ],
        }
        for passage, index, end_index in zip(passages, trajectory.passed, until, strict=True)
    ]
