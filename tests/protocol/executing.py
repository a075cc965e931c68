"""The executor, the store and the people: queue, claim, run, keep on the disk, deliver, recover."""

from __future__ import annotations

from collections.abc import Iterator

from tests.protocol.state import CONNECTED, ENDED, LATCHING, ProtocolState, StreamerState, is_awake
from tests.protocol.streaming import SLOTS, program_ended
from tests.protocol.transitions import FAULT, PERSON, PROGRESS, Happening, Planted, published, transition

REPEATED = "a restarted executor repeats the gripper's command"
TWO_WRITERS = "a stop writes its outcome at once"
OVERWRITTEN = "an outcome is written over another"
SPARED = "a frozen stream outlives its executor"
FORGOTTEN = "a claim whose answer was lost is forgotten"


def _works(state: ProtocolState, *at: str) -> bool:
    """Whether the executor runs, and is at one of these."""
    return state.executor in at and not state.frozen


def _finished(state: ProtocolState, outcome: str) -> Happening:
    """Writes an outcome into the current execution; what else was known of it does not matter any more."""
    over = {"row": "finished", "asked": False, "swap": "", "runs": 0, "openings": 0}
    return f"finished: {outcome}", state._replace(written=min(state.written + 1, 2), **over)


# People


@transition("an execution is queued", PERSON, "store.executions.ExecutionRepository.queue_execution")
def queue(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """A cell has one unfinished execution; the stream that is left of the one before becomes the orphan.

    One orphan is followed at a time: the next execution is not queued while there would be two.
    """
    if state.row not in ("none", "finished") or not state.database or state.kept:
        return
    after = state._replace(row="queued", written=0)
    left = state.stream
    if left is not None:
        if left.parent or state.orphan is not None:
            return
        moved = {name: "orphan" for name in ("program", "inputs") if getattr(state, name) == "stream"}
        after = after._replace(stream=None, orphan=left, **moved)
    yield "queued", after


@transition(
    "a stop is asked for",
    PERSON,
    "store.executions.ExecutionRepository.request_abort",
    "executor.stop_listener.StopListener._answer",
)
def ask_to_stop(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if state.row == "queued" and state.database:
        yield _finished(state, "aborted")
    told = state.stream is not None and state.stream.abort
    if state.row == "claimed" and not told and (state.database or _works(state, "preparing", "watching")):
        yield "asks to stop", state._replace(asked=True)


@transition("a replacement is asked for", PERSON, "store.executions.ExecutionRepository.request_replacement")
def ask_to_replace(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if state.row == "claimed" and state.database and not state.swap and state.executor == "watching":
        yield "asks to replace", state._replace(swap="asked")


@transition(
    "the fault is acknowledged",
    PERSON,
    "store.cells.CellStatusRepository.request_acknowledge",
    "executor.heartbeat.Heartbeat._acknowledge",
)
def acknowledge(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """A person has looked: the arm stands, and the execution has its outcome."""
    if state.fault and _works(state, "idle") and state.database and state.row == "finished" and state.arm == "rest":
        yield "acknowledges", state._replace(fault=False)


@transition("the executor is asked to end", PERSON, "executor.__main__.main")
def terminate(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if state.executor != "down" and not state.ending:
        yield "ends executor", state._replace(ending=True)


# Start and recovery


@transition("the executor starts", PROGRESS, "executor.daemon.Daemon.take", "executor.records.journal.Journal.__init__")
def start(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """It takes a second to start, in which a stream that is awake has braked, which takes two tenths."""
    if state.executor == "down" and not any(_brakes(state, slot) for slot in SLOTS):
        yield "starts executor", state._replace(executor="starting")


def _brakes(state: ProtocolState, slot: str) -> bool:
    streamer = getattr(state, slot)
    return is_awake(streamer) and streamer.phase in CONNECTED


@transition(
    "the executor ends a stream that an earlier one left",
    PROGRESS,
    "executor.daemon.Daemon.recover",
    "executor.stream_process.end_orphan",
)
def end_orphans(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if not _works(state, "starting"):
        return
    after = state._replace(executor="recovering")
    yield "", after if SPARED in planted else after._replace(stream=None, orphan=None, inputs="")


@transition("the executor finds what an earlier one left", PROGRESS, "executor.daemon.Daemon.recover")
def find_lost(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """Results come first: what the database could not take yet is no lost execution."""
    if not _works(state, "recovering") or state.kept or not state.database:
        return
    if state.row == "claimed":
        yield "", state._replace(executor="halting", fault=True)
    else:
        yield "", state._replace(executor="closing")


@transition(
    "the executor ends whatever program plays",
    PROGRESS,
    "executor.daemon.Daemon._stop_controller",
    "executor.robot.primary.stop_program",
)
def halt(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """Over a dead link it gives up after half a second, long after the watchdog has tripped."""
    if not _works(state, "halting") or (not state.link and state.watchdog):
        return
    after = state._replace(executor="closing")
    if REPEATED in planted and state.link and state.openings:
        yield "opens", after._replace(gripper="opening", openings=2)
    elif state.link and state.program:
        yield "ends", program_ended(after)
    else:
        yield "", after


@transition(
    "the executor closes what an earlier one left",
    PROGRESS,
    "store.executions.ExecutionRepository.close_open_executions",
)
def close(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if not _works(state, "closing") or not state.database:
        return
    after = state._replace(executor="idle")
    yield _finished(after, "executor_lost") if state.row in ("queued", "claimed") else ("", after)


# One execution


@transition(
    "the executor ends",
    PROGRESS,
    "executor.daemon.Daemon.run",
    "store.cells.CellStatusRepository.leave_cell",
)
def leave_cell(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if _works(state, "idle") and state.ending:
        yield "", state._replace(executor="down", ending=False)


@transition(
    "the executor claims",
    PROGRESS,
    "executor.daemon.Daemon._poll",
    "store.executions.ExecutionRepository.claim_execution",
)
def claim(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """A claim whose answer was lost is made again: an executor that claims runs nothing."""
    if not _works(state, "idle") or state.kept or not state.database:
        return
    if state.row == "queued":
        yield "preparing", state._replace(row="claimed", executor="preparing")
    elif state.row == "claimed" and FORGOTTEN not in planted:
        yield "", state._replace(executor="preparing")


@transition("the answer to a claim is lost", FAULT, "store.database.writing")
def lose_claim(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if _works(state, "idle") and not state.kept and state.database and state.row == "queued":
        yield "loses a claim", state._replace(row="claimed")


@transition(
    "the executor refuses",
    PROGRESS,
    "executor.daemon.Daemon._admit",
    "executor.execution.Execution.prepare",
)
def refuse(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """For whatever reason; always where a fault is latched."""
    if _works(state, "preparing"):
        yield "", state._replace(executor="resulting", verdict="refused")


@transition("the executor aborts before anything moves", PROGRESS, "executor.daemon.Daemon._run_execution")
def abort_unstarted(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if _works(state, "preparing") and (state.asked or state.ending) and not state.fault:
        yield "", state._replace(executor="resulting", verdict="aborted", asked=False)


@transition(
    "the executor starts the stream",
    PROGRESS,
    "executor.execution.Execution.start",
    "executor.supervision.StreamRun._spawn",
    "executor.stream_process.SpareStream.take",
)
def spawn(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """Somebody may have asked for a stop since that was looked for."""
    fit = state.link and state.arm == "rest" and not state.fault
    if _works(state, "preparing") and fit and state.stream is None:
        yield "", state._replace(executor="watching", stream=StreamerState(), runs=min(state.runs + 1, 2))


@transition(
    "the executor passes on a stop",
    PROGRESS,
    "executor.daemon.Daemon._watch",
    "executor.supervision.StreamRun.abort",
)
def pass_on(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    left = state.stream
    if not _works(state, "watching") or left is None or left.abort or left.phase in ENDED:
        return
    if state.asked or state.ending:
        after = state._replace(stream=left._replace(abort=True), asked=False)
        yield _finished(after, "aborted") if TWO_WRITERS in planted else ("", after)


@transition(
    "the executor offers a plan to the stream",
    PROGRESS,
    "executor.replacer.Replacer._look",
    "executor.execution.Execution.replace",
    "executor.supervision.StreamRun.offer",
)
def offer(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if state.swap == "asked" and _works(state, "watching", "saving", "resulting"):
        yield from published("does not join", state._replace(swap=""))
        if state.stream is not None and state.stream.phase in ("launching", "joined", "opening", "told"):
            yield "", state._replace(swap="offered")


@transition("the executor withdraws an offer", PROGRESS, "executor.supervision.StreamRun.offer")
def withdraw(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """The run has ended without an answer."""
    if state.swap == "offered" and _works(state, "saving", "resulting"):
        yield from published("does not join", state._replace(swap=""))


@transition("the executor finds the run ended in order", PROGRESS, "executor.supervision.StreamRun._result")
def note_end(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if _works(state, "watching") and state.stream is not None and state.stream.phase == "done":
        verdict = state.stream.verdict
        yield "", state._replace(executor="resulting", verdict=verdict, stream=None, asked=False)


@transition(
    "the executor ends a stream that failed",
    PROGRESS,
    "executor.supervision.StreamRun._watch",
    "executor.supervision.StreamRun._make_safe",
    "executor.stream_process.ChildProcess.is_frozen",
)
def end_stream(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    left = state.stream
    if _works(state, "watching") and left is not None and (left.frozen or left.phase in ("failed", "dead")):
        verdict = "executor_lost" if left.frozen else left.verdict
        inputs = "" if state.inputs == "stream" else state.inputs
        known = {"executor": "saving", "verdict": verdict, "asked": False}
        yield "", state._replace(**known, stream=StreamerState("dead"), inputs=inputs)


@transition(
    "the executor closes the gripper again",
    PROGRESS,
    "executor.supervision.StreamRun._hold_object",
    "executor.robot.gripper_hold.GripperHold.hold",
)
def hold(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """By its own clock, before the release; the object may have left by then."""
    if _works(state, "saving") and state.link and state.openings and state.gripper != "shut":
        yield "shuts", state._replace(gripper="shut")


@transition(
    "the executor ends the program of a stream that failed",
    PROGRESS,
    "executor.supervision.StreamRun._make_safe",
    "executor.robot.primary.ProgramWatch.stop",
)
def end_its_program(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """Over a dead link the watchdog has tripped before the result is made, which takes longer."""
    if not _works(state, "saving") or (not state.link and state.watchdog):
        return
    after = state._replace(executor="resulting", stream=None)
    yield ("ends", program_ended(after)) if state.program and state.link else ("", after)


@transition(
    "the executor latches a fault",
    PROGRESS,
    "executor.daemon.Daemon._keep",
    "executor.records.journal.Journal.latch",
)
def latch(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if _works(state, "resulting") and not state.swap:
        yield "", state._replace(executor="keeping", fault=state.fault or state.verdict in LATCHING)


@transition("the executor keeps the result", PROGRESS, "executor.records.journal.Journal.keep")
def keep(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if _works(state, "keeping"):
        yield "", state._replace(executor="idle", kept=state.verdict, verdict="")


@transition(
    "the executor delivers the result",
    PROGRESS,
    "executor.records.journal.deliver",
    "executor.records.journal.Journal.deliver",
    "store.executions.ExecutionRepository.finish_execution",
)
def deliver(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """Again, where its answer was lost, or the executor was killed before it had deleted the result."""
    if not _works(state, "idle", "recovering") or not state.kept or not state.database:
        return
    if state.row == "finished" and not (OVERWRITTEN in planted and state.written < 2):
        yield "", state._replace(kept="")
    else:
        yield _finished(state, state.kept)


# What happens to it


@transition("the executor is killed", FAULT)
def kill_executor(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """The kernel sends its stream SIGTERM."""
    if state.executor != "down":
        left = state.stream
        if left is not None:
            left = None if left.phase in ENDED else left._replace(parent=False, abort=False)
        gone = {"executor": "down", "frozen": False, "ending": False, "verdict": "", "swap": ""}
        yield "kills executor", state._replace(**gone, stream=left)


@transition("the executor is frozen", FAULT)
def freeze_executor(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if state.executor != "down" and not state.frozen:
        yield "freezes executor", state._replace(frozen=True)


@transition("the executor is woken", PROGRESS)
def wake_executor(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if state.frozen:
        yield "wakes executor", state._replace(frozen=False)


@transition("the link is cut", FAULT)
def cut_link(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if state.link:
        yield "cuts the link", state._replace(link=False)


@transition("the link comes back", PROGRESS)
def mend_link(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if not state.link:
        yield "mends the link", state._replace(link=True)


@transition("the database is gone", FAULT)
def lose_database(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if state.database:
        yield "loses the database", state._replace(database=False)


@transition("the database is back", PROGRESS)
def mend_database(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if not state.database:
        yield "mends the database", state._replace(database=True)
