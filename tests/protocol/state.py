"""The state of the protocol: store, disk, executor, its streaming process, one left over, controller, gripper.

Identities are relative: there is the current execution, and what is left of an earlier one. So a shift of any length is
a finite graph.
"""

from __future__ import annotations

from typing import NamedTuple

# Phases of a streaming process, in order. What is told apart are the moments between which it can be killed or frozen.
STANDING = ("connected", "gripping", "arming", "ready", "begun")
MOVING = ("approaching", "starts moving", "launching", "joined", "opening", "told", "flown", "shut again", "braking")
CONNECTED = (*STANDING, *MOVING, "stopping", "leaving")
ENDED = ("done", "failed", "dead")
LATCHING = ("executor_lost", "fault")  # outcomes that latch a fault; "fault" stands for all that a stream reports


class StreamerState(NamedTuple):
    """One streaming process.

    Attributes:
        phase: "starting", "connecting", one of `CONNECTED`, or one of `ENDED`.
        frozen: by a signal.
        parent: whether the executor that started it lives; SIGTERM has come where it does not.
        abort: whether the executor asks for the brake.
        verdict: outcome that it will report, or has reported.
    """

    phase: str = "starting"
    frozen: bool = False
    parent: bool = True
    abort: bool = False
    verdict: str = "completed"


class ProtocolState(NamedTuple):
    """Everything that the protocol goes by.

    Attributes:
        row: state of the current execution in the store: "none" before the first, "queued", "claimed", "finished".
        written: how often an outcome was written into it.
        database: whether the database answers.
        asked: whether somebody asked for a stop of which the stream does not know yet.
        swap: of a plan that is to replace the running one: "", "asked", "offered".
        fault: whether a fault is latched on the disk.
        kept: outcome of the result on the disk that the store may not have yet; "" without one.
        executor: what the daemon is at.
        frozen: whether the daemon is, by a signal.
        ending: whether it was asked to end.
        verdict: outcome of the run, before it is kept.
        runs: how often the current execution was started.
        stream: streaming process of the current execution.
        orphan: one of an earlier execution, whose executor has died.
        program: whose program plays on the controller: "", "stream", "orphan".
        inputs: whose connection has the controller's inputs, which it gives to one alone.
        watchdog: whether the controller's watchdog is armed.
        arm: "rest", "moving" on a command, "stopping" by the controller itself.
        link: whether packages arrive.
        gripper: "shut", "opening" (told, the object has not left), "open".
        openings: how often the current execution told it to open.
        stray: whether it was told to open for an execution that had its outcome.
        torn: whether a plan took over after the tick at which it begins.
    """

    row: str = "none"
    written: int = 0
    database: bool = True
    asked: bool = False
    swap: str = ""
    fault: bool = False
    kept: str = ""
    executor: str = "idle"
    frozen: bool = False
    ending: bool = False
    verdict: str = ""
    runs: int = 0
    stream: StreamerState | None = None
    orphan: StreamerState | None = None
    program: str = ""
    inputs: str = ""
    watchdog: bool = False
    arm: str = "rest"
    link: bool = True
    gripper: str = "shut"
    openings: int = 0
    stray: bool = False
    torn: bool = False


def is_awake(streamer: StreamerState | None) -> bool:
    """Whether a streaming process runs."""
    return streamer is not None and not streamer.frozen and streamer.phase not in ENDED


def who_can_stop(state: ProtocolState) -> list[str]:
    """Returns who is alive and ends the motion of the arm without anybody's help."""
    found = []
    if state.program and state.watchdog:
        found.append("controller")
    if state.program and state.link and is_awake(getattr(state, state.program)):
        found.append("stream")
    if state.executor in ("watching", "saving") and not state.frozen and state.link:
        found.append("executor")
    return found


INVARIANTS = {
    "the arm never moves without somebody alive who can stop it": lambda s: s.arm != "moving" or bool(who_can_stop(s)),
    "an object is let go at most once": lambda s: s.openings <= 1,
    "nothing is let go for an execution that has its outcome": lambda s: not s.stray,
    "an execution gets one outcome": lambda s: s.written == (s.row == "finished"),
    "no outcome is written while the arm moves on a command": lambda s: s.row != "finished" or s.arm != "moving",
    "an execution is started at most once": lambda s: s.runs <= 1,
    "a plan takes over before the tick at which it begins": lambda s: not s.torn,
}


def broken(state: ProtocolState) -> list[str]:
    """Returns the invariants that do not hold in a state."""
    return [words for words, holds in INVARIANTS.items() if not holds(state)]
