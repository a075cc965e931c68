"""The streaming process, the controller and the gripper.

A tick of the stream checks its connection, then whether somebody asks for a stop, then goes on. It is one step of the
model, but for the tick that opens the gripper: there a process may be killed or frozen between the check and the
command.
"""

from __future__ import annotations

from collections.abc import Iterator

from tests.protocol.state import CONNECTED, ENDED, MOVING, STANDING, ProtocolState, StreamerState, is_awake
from tests.protocol.transitions import FAULT, PROGRESS, Happening, Planted, published, transition

SLOTS = ("stream", "orphan")
ALONE = "a stream goes on without its executor and without the watchdog"
LATE_SWAP = "a plan takes over after the tick at which it begins"
HANGS = "a stream that hangs in its library comes to the end of its call"
BRAKED = ("approaching", "launching", "joined", "told", "flown")  # phases from which a stream brakes


def asked_of(state: ProtocolState, streamer: StreamerState, planted: Planted = frozenset()) -> str:
    """Returns the outcome of a request to stop that a stream finds at its next tick; "" without one."""
    if streamer.abort:
        return "aborted"
    is_alone = state.frozen or not streamer.parent
    return "executor_lost" if is_alone and ALONE not in planted else ""


def ended(state: ProtocolState, slot: str, phase: str, verdict: str) -> ProtocolState:
    """Ends a streaming process: its connections go with it; what it reported stays with its executor."""
    streamer = getattr(state, slot)
    left = StreamerState(phase, parent=True, verdict=verdict) if streamer.parent else None
    inputs = "" if state.inputs == slot else state.inputs
    return state._replace(**{slot: left, "inputs": inputs})


def program_ended(state: ProtocolState) -> ProtocolState:
    """Ends whatever program plays: the controller stops the arm, and disarms its watchdog."""
    arm = "stopping" if state.arm == "moving" else state.arm
    return state._replace(program="", watchdog=False, arm=arm)


def _awake(state: ProtocolState, *phases: str) -> Iterator[tuple[str, StreamerState]]:
    """Yields the streaming processes that run and are in one of these phases."""
    for slot in SLOTS:
        streamer = getattr(state, slot)
        if is_awake(streamer) and streamer.phase in phases:
            yield slot, streamer


def _connected(state: ProtocolState, *phases: str) -> Iterator[tuple[str, StreamerState]]:
    """Yields those whose tick finds its program playing, over a link."""
    for slot, streamer in _awake(state, *phases):
        if state.link and state.program == slot:
            yield slot, streamer


def _unasked(state: ProtocolState, planted: Planted, *phases: str) -> Iterator[tuple[str, StreamerState]]:
    """Yields those whose tick finds nobody asking for a stop, either."""
    for slot, streamer in _connected(state, *phases):
        if not asked_of(state, streamer, planted):
            yield slot, streamer


def _on(state: ProtocolState, slot: str, phase: str, **changes: object) -> ProtocolState:
    """Returns the state with a stream in another phase."""
    return state._replace(**{slot: getattr(state, slot)._replace(phase=phase), **changes})


# From the start to the first motion


@transition("the stream starts", PROGRESS, "executor.streaming.__main__.run", "executor.realtime.terminate_with_parent")
def load(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot, streamer in _awake(state, "starting"):
        asked = asked_of(state, streamer, planted)
        yield "", ended(state, slot, "done", asked) if asked else _on(state, slot, "connecting")


@transition("the stream connects", PROGRESS, "executor.streaming.rtde_connection.RtdeConnection.__init__")
def connect(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """The controller gives its inputs to one connection alone; the watchdog of a fresh program is off."""
    for slot, _ in _awake(state, "connecting"):
        if not state.link or state.inputs not in ("", slot):
            yield "", ended(state, slot, "failed", "refused")
        else:
            yield "plays", _on(state, slot, "connected", program=slot, inputs=slot, watchdog=False)


@transition("the stream reports that it approaches", PROGRESS, "executor.streaming.__main__.run")
def enter_approach(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot, _ in _unasked(state, planted, "connected"):
        yield from published("approaching", _on(state, slot, "gripping"))


@transition("the stream closes the gripper", PROGRESS, "executor.streaming.approach.take_object")
def grip(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """A plan that lets go of nothing leaves it alone."""
    for slot, _ in _unasked(state, planted, "gripping"):
        yield "", _on(state, slot, "arming")
        if state.gripper != "shut":
            yield "shuts", _on(state, slot, "arming", gripper="shut")


@transition("the gripper has closed on nothing", FAULT, "executor.streaming.approach.take_object")
def miss_the_grip(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """Nothing moves; what the stream has closed it opens again, and a gripper that it found closed stays so."""
    for slot, streamer in _unasked(state, planted, "arming"):
        after = state._replace(**{slot: streamer._replace(phase="stopping", verdict="refused")})
        yield "", after
        yield "opens", after._replace(gripper="open")


@transition("the stream arms the watchdog", PROGRESS, "executor.streaming.rtde_connection.RtdeConnection.arm_watchdog")
def arm(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot, _ in _unasked(state, planted, "arming"):
        yield "", _on(state, slot, "ready", watchdog=ALONE not in planted)


@transition("the stream approaches", PROGRESS, "executor.streaming.approach.approach")
def approach(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot, _ in _unasked(state, planted, "ready"):
        yield "moves", _on(state, slot, "approaching", arm="moving")
        yield "", _on(state, slot, "begun")  # the arm stands there
    for slot, _ in _unasked(state, planted, "approaching"):
        yield "", _on(state, slot, "begun")  # its rest there is not told apart from its motion


@transition("the stream begins its plan", PROGRESS, "executor.streaming.start.await_start")
def begin(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot, _ in _unasked(state, planted, "begun"):
        after = _on(state, slot, "starts moving", arm="moving") if state.arm == "rest" else None
        yield ("moves", after) if after is not None else ("", _on(state, slot, "starts moving"))


@transition("the stream reports that it streams", PROGRESS, "executor.streaming.__main__.run")
def enter_streaming(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot, _ in _unasked(state, planted, "starts moving"):
        yield from published("streaming", _on(state, slot, "launching"))


# The plan


@transition(
    "the stream answers an offer",
    PROGRESS,
    "executor.streaming.loop.Stream._answer_offer",
    "executor.streaming.loop.Stream._go_by",
    "executor.replacer.Replacer._answer",
)
def answer_offer(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """At its next tick, before anything else of it; the executor writes the answer into the store."""
    if state.swap != "offered":
        return
    for slot, streamer in _connected(state, "launching", "joined", "told", "flown", "braking"):
        late = streamer.phase == "joined" and LATE_SWAP in planted
        takes = slot == "stream" and (streamer.phase == "launching" or late)
        yield from published("joins" if takes else "does not join", state._replace(swap="", torn=late))


@transition("the stream passes the tick at which a plan may begin", PROGRESS, "executor.streaming.loop.Stream.run")
def pass_join(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot, _ in _unasked(state, planted, "launching"):
        if state.swap != "offered":
            yield "", _on(state, slot, "joined")


@transition(
    "the stream comes to the tick of the gripper's command",
    PROGRESS,
    "executor.streaming.loop.Stream._open_gripper",
    "executor.streaming.loop.Stream._keeps",
)
def come_to_command(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """Nothing is let go by a plan that throws nothing, and where the object would miss."""
    for slot, _ in _unasked(state, planted, "joined"):
        if state.swap != "offered":
            yield "", _on(state, slot, "opening")
            yield from published("braking", _on(state, slot, "flown"))


@transition(
    "the stream tells the gripper to open",
    PROGRESS,
    "executor.streaming.gripper_port.OutputPort.tell",
    "executor.streaming.loop.Stream._note_opening",
)
def open_gripper(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """The rest of a tick: whatever happened since the connection was checked, the command is sent."""
    for slot, _ in _awake(state, "opening"):
        after = _on(state, slot, "told")
        if not state.link:
            yield "", after
            continue
        own = slot == "stream"
        stray = state.stray or not own or state.row == "finished"
        openings = min(state.openings + own, 2)
        is_shut = state.gripper == "shut"
        gripper = "opening" if is_shut else state.gripper
        yield "opens" if is_shut else "", after._replace(gripper=gripper, openings=openings, stray=stray)


@transition("the stream passes the release", PROGRESS, "executor.streaming.loop.Stream._watch_gripper")
def pass_release(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot, _ in _unasked(state, planted, "told"):
        if state.gripper == "open":
            yield from published("braking", _on(state, slot, "flown"))
        elif state.gripper == "shut":  # told, and seen to stay closed
            yield from _braked(state, slot, "fault")


# Stops


@transition(
    "the stream is asked to stop",
    PROGRESS,
    "executor.streaming.state_checks.StopRequests.pending",
    "executor.streaming.loop.Stream._divert",
    "executor.streaming.approach.take_object",
)
def stop(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot, streamer in _connected(state, *STANDING, "starts moving", *BRAKED):
        asked = asked_of(state, streamer, planted)
        if asked:
            yield from _braked(state, slot, asked)


@transition(
    "the stream stops by itself",
    FAULT,
    "executor.streaming.loop.Stream._stop",
    "executor.streaming.loop.Stream._watch_gripper",
)
def stop_by_itself(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """Ticks were lost, the arm is off the plan, the gripper changed by itself."""
    for slot, _ in _unasked(state, planted, *BRAKED):
        yield from _braked(state, slot, "fault")


def _braked(state: ProtocolState, slot: str, verdict: str) -> Iterator[Happening]:
    """Begins a brake; a gripper that was told to open is told to close where the object has not left by plan."""
    streamer = getattr(state, slot)
    after = state._replace(**{slot: streamer._replace(phase="braking", verdict=verdict)})
    if streamer.phase == "told" and state.gripper != "shut":
        yield "shuts", _on(after, slot, "shut again", gripper="shut")
    else:
        yield from published("braking", after)


@transition("the stream reports that it brakes", PROGRESS, "executor.streaming.loop.Stream._brake")
def enter_braking(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot, _ in _awake(state, "shut again"):
        yield from published("braking", _on(state, slot, "braking"))


@transition("the stream brings the arm to rest", PROGRESS, "executor.streaming.loop.Schedule.command")
def come_to_rest(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot, streamer in _connected(state, "flown", "braking"):
        if state.swap != "offered" and not (streamer.phase == "flown" and asked_of(state, streamer, planted)):
            yield "rests" if state.arm == "moving" else "", _on(state, slot, "stopping", arm="rest")


@transition("the stream ends its program", PROGRESS, "executor.streaming.rtde_connection.RtdeConnection.stop")
def end_program(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot, _ in _awake(state, "stopping"):
        if not state.link:
            yield "", ended(state, slot, "failed", "fault")
        elif state.program == slot:
            yield "ends", _on(program_ended(state), slot, "leaving")
        else:
            yield "", _on(state, slot, "leaving")


@transition(
    "the stream ends",
    PROGRESS,
    "executor.streaming.rtde_connection.RtdeConnection.wait_for_rest",
    "executor.streaming.__main__.main",
)
def end(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot, streamer in _awake(state, "leaving"):
        if state.link:
            yield "", ended(state, slot, "done", streamer.verdict)
        else:
            yield "", ended(state, slot, "failed", "fault")


@transition(
    "the stream finds its link or its program gone",
    PROGRESS,
    "executor.streaming.rtde_connection.RtdeConnection.read",
    "executor.streaming.state_checks.check_state",
    "executor.streaming.__main__.main",
)
def lose(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """It sends nothing any more."""
    for slot, streamer in _awake(state, *CONNECTED):
        if (not state.link or state.program != slot) and streamer.phase not in ("opening", "stopping", "leaving"):
            yield "", ended(state, slot, "failed", "fault")


@transition(
    "the stream hangs in a call of its library",
    FAULT,
    "executor.streaming.rtde_connection.RtdeConnection._command",
)
def hang(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """The kernel ends it; the library would connect again, and repeat its command in a program without a watchdog."""
    for slot, streamer in _awake(state, *MOVING):
        if state.program != "" or streamer.phase == "opening":
            continue
        after = ended(state, slot, "failed", "fault")
        if HANGS in planted and state.link:
            yield "plays", after._replace(program=slot, arm="moving")
        else:
            yield "", after


# Controller and gripper


@transition("the watchdog ends the program", PROGRESS)
def trip(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    """No command has arrived for 20 ms (50 without real time)."""
    arrives = state.program and state.link and is_awake(getattr(state, state.program))
    if state.program and state.watchdog and not arrives:
        yield "ends", program_ended(state)


@transition("the controller has stopped the arm", PROGRESS)
def rest(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if state.arm == "stopping":
        yield "rests", state._replace(arm="rest")


@transition("the object leaves the gripper", PROGRESS)
def leave(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    if state.gripper == "opening":
        yield "leaves", state._replace(gripper="open")


# What happens to a stream


@transition("the stream is killed", FAULT)
def kill_stream(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot in SLOTS:
        streamer = getattr(state, slot)
        if streamer is not None and streamer.phase not in ENDED:
            yield f"kills {slot}", ended(state, slot, "dead", "executor_lost")


@transition("the stream is frozen", FAULT)
def freeze_stream(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot in SLOTS:
        if is_awake(streamer := getattr(state, slot)):
            yield f"freezes {slot}", state._replace(**{slot: streamer._replace(frozen=True)})


@transition("the stream is woken", FAULT)
def wake_stream(state: ProtocolState, planted: Planted) -> Iterator[Happening]:
    for slot in SLOTS:
        streamer = getattr(state, slot)
        if streamer is not None and streamer.frozen:
            yield f"wakes {slot}", state._replace(**{slot: streamer._replace(frozen=False)})
