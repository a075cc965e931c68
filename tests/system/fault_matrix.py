"""The fault matrix: every fault in every phase of an execution, on one rig; what must hold in each cell of the table.

The arm rests within `REST_S` of the fault by the simulator's own account of its motion, or the execution is completed
as planned; the object is kept, lands as planned, or is told lost, with where. `test_fault_matrix.py` runs a part of
the table, that of `tests/verify` more, `python -m benchmarks.fault_matrix` all of it.
"""

from __future__ import annotations

import contextlib
import math
import signal
import socket
import sqlite3
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import orjson
import psutil

from executor import realtime
from planner.answer import plan_from_document
from planner.certificate import release_flight
from planner.flight import fly
from planner.geometry import tool_state
from tests.system.rig import LONG_LOB, OTHER_INTERFACES, Rig

REST_S = 0.150  # [s] of the controller's time from the fault to rest: the promise of docs/executor.md
ORDINARY_S = 0.030  # [s] more without real-time scheduling: its watchdog is slower
LANDED_M = 0.01  # [m] landing error of an object that was let go as planned
FAR_RAD = 1.2  # [rad] of the base: half of the longest approach, to either side
SWING_RAD = 0.25  # [rad] of a motion of `fling calibrate lag`
APPROACHING_RAD_S = 1.5  # [rad/s] the rig approaches at up to 2 rad/s, twice the usual speed, which is harder to stop
FASTEST_RAD_S = 2.5  # [rad/s] from which the promise holds; a stop takes 3 to 5 ms more for each 0.1 rad/s
LAUNCHING_RAD_S = 2.35
TURNING_RAD_S = 2.0  # [rad/s] of the base in a motion that is replaced
TURN_RAD = 2.2  # [rad] to either side, from which and to which it turns: 2 s, enough to certify what replaces it
JOINS_AT = 0.75  # [-] of that turn, where it is replaced
ANSWERED_S = 10.0  # [s] longest wait for the answer to a replacement
BRAKING_RAD_S = 1.5  # [rad/s] in the middle of the throw's brake
THROW = {**LONG_LOB, "velocities": [0.92 * v for v in LONG_LOB["velocities"]]}
PUBLISHED_S = 2.0  # [s] a heartbeat comes four times a second
POLL_S = 0.0005  # [s] between two looks at the controller while a moment is awaited


ROBOTIQ = 'kind = "robotiq"\nmodel = "2f85"\n'  # the gripper of `GRIPPER_FAULTS`
GRIP_SENSOR = 'output = "tool_digital"\nopen_level = true\ngrip_input = 4\n'  # that of `INPUT_FAULTS`

Undo = Callable[[], None]


# Phases


@dataclass(frozen=True)
class Phase:
    """A part of an execution.

    Attributes:
        name: as in the table.
        begin: queues an execution in a mode; returns its id.
        await_moment: returns when the phase has come.
        holds: whether the gripper holds its object then, and is not told to let go.
    """

    name: str
    begin: Callable[[Rig, str], str]
    await_moment: Callable[[Rig, str], None]
    holds: bool = True


def _begin_far(rig: Rig, mode: str) -> str:
    """Queues a small motion whose start is the farther one of two, to either side of home."""
    side = -FAR_RAD if rig.state()["q"][0] > 0.0 else FAR_RAD
    start = [side, *rig.cell.home[1:].tolist()]
    goal = [start[0] + 0.02, *start[1:]]
    release = {"kind": "joint", "positions": goal, "velocities": [0.0] * 6}
    return rig.queue_plan_when_ready(rig.plan(release, start={"positions": start}), mode)


def _begin_throw(rig: Rig, mode: str) -> str:
    return rig.queue_plan_when_ready(_throw(rig), mode)


def _throw(rig: Rig) -> str:
    return rig.plan(THROW, limits={"velocity": FASTEST_RAD_S})


def _begin_way_home(rig: Rig, mode: str) -> str:
    """Throws, and queues a motion at home: its approach is the way home, once the gripper is closed."""
    thrown = rig.end(rig.queue_plan_when_ready(_throw(rig), mode))
    assert thrown.outcome == "completed", thrown.reason
    return rig.queue_when_ready(_swing(rig, 0.02), mode)


def _begin_calibration(rig: Rig, mode: str) -> str:
    """Queues a motion as `fling calibrate lag` makes it: all joints about home, from rest to rest, without a throw."""
    return rig.queue_when_ready(_swing(rig, SWING_RAD), mode)


def _swing(rig: Rig, amplitude_rad: float) -> dict[str, Any]:
    goal = (rig.cell.home + amplitude_rad * np.array([1, 1, -1, 1, -1, 1])).tolist()
    return {"kind": "joint", "positions": goal, "velocities": [0.0] * 6}


def _begin_turn(rig: Rig, mode: str) -> str:
    """Queues a turn of the base from the nearer side to the other, and plans what is to replace it."""
    first = rig.plan_of(_turn(rig, math.copysign(TURN_RAD, rig.state()["q"][0])))
    _replacement(rig, first)
    return rig.queue_plan_when_ready(first, mode)


def _turn(rig: Rig, begins: float) -> dict[str, Any]:
    """Returns a request for a turn of the base from an angle to the other side, from rest to rest."""
    start, goal = ([angle, *rig.cell.home[1:].tolist()] for angle in (begins, -begins))
    passages = [{"name": "there", "state": {"kind": "joint", "positions": goal, "velocities": [0.0] * 6}}]
    return {"start": {"positions": start}, "passages": passages, "limits": {"velocity": TURNING_RAD_S}}


def _replacement(rig: Rig, first: str) -> tuple[str, float, float]:
    """Returns the id of what replaces a turn, the base's angle there [rad], and towards which side it turns."""
    row = rig.store.plan(first)
    assert row is not None
    motion = plan_from_document(orjson.loads(row.document), rig.cell)[1]
    turned = np.abs(motion.q[:, 0] - motion.q[0, 0])
    tick = int(np.searchsorted(turned, JOINS_AT * turned[-1]))
    state = {"positions": motion.q, "velocities": motion.qd, "accelerations": motion.qdd}
    goal = motion.q[-1] + 0.2 * np.array([-np.sign(motion.q[-1, 0]), 1.0, -1.0, 1.0, -1.0, 1.0])
    passages = [{"name": "there", "state": {"kind": "joint", "positions": goal.tolist(), "velocities": [0.0] * 6}}]
    start = {name: values[tick].tolist() for name, values in state.items()}
    id = rig.plan_of({"start": start, "passages": passages, "limits": {"velocity": TURNING_RAD_S}})
    return id, float(motion.q[tick, 0]), float(np.sign(motion.q[-1, 0]))


def _approaching(rig: Rig, id: str) -> None:
    rig.until(lambda: rig.row(id).state == "approaching" and rig.speed() > APPROACHING_RAD_S, period=POLL_S)


def _launching(rig: Rig, id: str) -> None:
    rig.in_launch(id, LAUNCHING_RAD_S)


def _swinging(rig: Rig, id: str) -> None:
    rig.in_launch(id, 1.0)


def _before_command(rig: Rig, id: str) -> None:
    _at_command(rig, id, -1.0)


def _after_command(rig: Rig, id: str) -> None:
    _at_command(rig, id, 1.0)


def _at_command(rig: Rig, id: str, ticks: float) -> None:
    """Waits for the tick of the gripper's command, and so many ticks more.

    The joint that goes farthest tells how far the plan was sent; the state of one cycle shows what was sent in the one
    before. The command is sent with the plan's row one delay before the release.
    """
    motion = rig.motion(id)
    opens_s = motion.release_time_s - rig.cell.gripper.delay_s
    launch = motion.at(np.linspace(0.0, motion.release_time_s, 2))[0]
    joint = int(np.abs(launch[1] - launch[0]).argmax())
    when = motion.at(np.array([opens_s + (ticks - 1.0) * motion.dt]))[0][0, joint]
    ahead = np.sign(launch[1, joint] - launch[0, joint])
    rig.in_launch(id)
    rig.until(lambda: ahead * (rig.state()["target_q"][joint] - when) >= 0.0, period=POLL_S)


def _flying(rig: Rig, id: str) -> None:
    _launching(rig, id)
    rig.until(lambda: rig.world()["in_flight"], period=POLL_S)


def _braking(rig: Rig, id: str) -> None:
    _flying(rig, id)
    rig.until(lambda: rig.speed() < BRAKING_RAD_S, period=POLL_S)


def _replacing(rig: Rig, id: str) -> None:
    """Waits for the tick at which another plan takes over, which was asked for as soon as the motion began."""
    plan_id, joins_at, side = _replacement(rig, rig.row(id).plan_id)
    rig.until(lambda: rig.row(id).state in ("streaming", "finished"), period=POLL_S)
    asked = rig.store.request_replacement(id, plan_id, "test")
    assert asked is not None, rig.row(id).reason
    rig.until(lambda: rig.row(id).replacements, ANSWERED_S, POLL_S)
    (found,) = rig.row(id).replacements or ()
    assert found["joins_s"] is not None, found["reason"]
    assert side * rig.state()["target_q"][0] < side * joins_at, "the plan took over before it was said"
    rig.until(lambda: side * (rig.state()["target_q"][0] - joins_at) >= 0.0, period=POLL_S)


PHASES = (
    Phase("approach", _begin_far, _approaching),
    Phase("launch", _begin_throw, _launching),
    Phase("before the command", _begin_throw, _before_command, holds=False),
    Phase("after the command", _begin_throw, _after_command, holds=False),
    Phase("flight", _begin_throw, _flying, holds=False),
    Phase("brake", _begin_throw, _braking, holds=False),
    Phase("way home", _begin_way_home, _approaching),
    Phase("calibration", _begin_calibration, _swinging),
    Phase("replacing", _begin_turn, _replacing),
)


# Faults

Trigger = Callable[[], object]


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong.

    Attributes:
        name: as in the table.
        prepare: finds what it needs, once an execution runs; what it returns makes it happen, at once.
        outcomes: that an execution may have that it ended.
        harmless: whether the run may go on to its end.
        longer_s: by which the arm may rest later: the streaming process, alive and in control, bears it before it
            brakes, or the controller brakes by itself, and less hard [s].
        leaves_nobody: whether nobody is left who could say where an object went.
        lets_go: whether it opens the gripper itself.
        unseen: names of phases in which nothing tells what became of the object.
    """

    name: str
    prepare: Callable[[Rig], Trigger]
    outcomes: tuple[str, ...]
    harmless: bool = False
    longer_s: float = 0.0
    leaves_nobody: bool = False
    lets_go: bool = False
    unseen: tuple[str, ...] = ()


def _told(name: str, **parameters: Any) -> Callable[[Rig], Trigger]:
    """Returns what causes a fault of the simulated controller."""
    return lambda rig: lambda: rig.fault(name, **parameters)


def _signalled(process: str, number: signal.Signals) -> Callable[[Rig], Trigger]:
    """Returns what sends a signal to a process."""

    def prepare(rig: Rig) -> Trigger:
        found = _process(rig, process)
        return lambda: found.send_signal(number)

    return prepare


def _frozen(duration_s: float, *processes: str) -> Callable[[Rig], Trigger]:
    """Returns what freezes processes for a while."""

    def prepare(rig: Rig) -> Trigger:
        found = [_process(rig, process) for process in processes]

        def freeze() -> None:
            for process in found:
                process.send_signal(signal.SIGSTOP)
            time.sleep(duration_s)
            for process in found:
                with contextlib.suppress(psutil.NoSuchProcess):  # it was killed meanwhile
                    process.send_signal(signal.SIGCONT)

        return freeze

    return prepare


def _process(rig: Rig, name: str) -> psutil.Process:
    assert rig.executor is not None
    return rig.streamer() if name == "stream" else psutil.Process(rig.executor.pid)


def _both_killed(rig: Rig) -> Trigger:
    found = [_process(rig, "daemon"), _process(rig, "stream")]
    return lambda: [process.kill() for process in found]


def _killed_behind(*stalled: str) -> Callable[[Rig], Trigger]:
    """Returns what kills the stream while the connections of some interfaces are silent: no stop gets over them."""

    def prepare(rig: Rig) -> Trigger:
        stream = _process(rig, "stream")
        for role in stalled:
            rig.fault("stall_connection", role=role)
        return stream.kill

    return prepare


def _all_stalled(rig: Rig) -> Trigger:
    return lambda: [rig.fault("stall_connection", role=role) for role in ("any", *OTHER_INTERFACES)]


def _script(port: int, text: str) -> Callable[[Rig], Trigger]:
    """Returns what sends a script of another client, which stays connected until the arm rests."""

    def prepare(rig: Rig) -> Trigger:
        other = socket.create_connection((rig.host, port))

        def send() -> Undo:
            other.sendall(text.encode())
            return other.close

        return send

    return prepare


def _gripper_switched(opens: bool) -> Callable[[Rig], Trigger]:
    """Returns what sets the gripper's output as another client, by a secondary program beside ours."""

    def prepare(rig: Rig) -> Trigger:
        gripper = rig.cell.gripper
        level = gripper.open_level == opens
        return _script(30002, f"sec other():\n  set_tool_digital_out({gripper.index}, {level})\nend\n")(rig)

    return prepare


def _database_locked(rig: Rig) -> Trigger:
    """Another process holds the database until the arm rests."""
    other = sqlite3.connect(rig.url.removeprefix("sqlite:///"))

    def lock() -> Undo:
        other.execute("BEGIN EXCLUSIVE")
        return other.close

    return lock


def _gripper_told(text: str) -> Callable[[Rig], Trigger]:
    """Returns what sends a command to a gripper with a socket, as another client of it."""

    def prepare(rig: Rig) -> Trigger:
        assert rig.cell.gripper.link is not None
        return _script(rig.cell.gripper.link.port, text)(rig)

    return prepare


LOST = ("executor_lost",)
GRIPPER = ("released_early", "not_released")
CATEGORY_2_S = 0.03  # [s] the controller's own stop of this category brakes at 20 rad/s^2, a program's end at 30
OUTPUT_S = 0.03  # [s] a script begins at the next cycle, and the output changes one lag later
LINK = ("link_lost", "aborted", "late")
PLAYS = "def other():\n  while True:\n    sync()\n  end\nend\n"
MOVES = "movej([0, -1, 1, 0, 0, 0], a=1.4, v=1)\n"
LONG_S = (0.3, 3.0)  # [s] of freezing

# Commands go by the control connection, and the heartbeat of a program in the controller by that of IO.
FAULTS = (
    Fault("stream killed", _signalled("stream", signal.SIGKILL), LOST),
    Fault("stream killed, dashboard stalled", _killed_behind("dashboard"), LOST),
    Fault("stream killed, no stop gets through", _killed_behind("dashboard", "primary"), LOST),
    Fault("daemon killed", _signalled("daemon", signal.SIGKILL), LOST),
    Fault("daemon and stream killed", _both_killed, LOST, leaves_nobody=True),
    Fault("stream frozen 5 ms", _frozen(0.005, "stream"), (*LOST, "late"), harmless=True),
    Fault("stream frozen 30 ms", _frozen(0.03, "stream"), (*LOST, "late"), harmless=True),
    *(Fault(f"stream frozen {1e3 * s:.0f} ms", _frozen(s, "stream"), LOST) for s in LONG_S),
    Fault("daemon frozen 5 ms", _frozen(0.005, "daemon"), LOST, harmless=True),
    *(Fault(f"daemon frozen {1e3 * s:.0f} ms", _frozen(s, "daemon"), LOST) for s in (0.03, *LONG_S)),
    Fault("daemon and stream frozen 3000 ms", _frozen(3.0, "daemon", "stream"), (*LOST, "late")),
    Fault("cable out", _told("offline"), LINK),
    Fault("every connection silent", _all_stalled, LINK),
    Fault("control connection reset", _told("close_connection", role="inputs", reset=True), LINK),
    Fault("control connection closed", _told("close_connection", role="inputs"), LINK),
    Fault("receive connection reset", _told("close_connection", role="receive", reset=True), LINK),
    Fault("control connection stalled", _told("stall_connection", role="inputs"), LINK),
    Fault("output connection reset", _told("close_connection", role="io", reset=True), LINK),
    Fault("output connection closed", _told("close_connection", role="io"), LINK),
    Fault("output connection stalled", _told("stall_connection", role="io"), LINK),
    Fault("every switch lost", _told("disturb_connection", role="io", drop=1.0), LINK),
    Fault("receive connection stalled", _told("stall_connection", role="receive"), LINK),
    Fault("controller frozen 500 ms", _told("freeze", duration_s=0.5), LINK),
    Fault(
        "half of the states lost",
        _told("disturb_connection", role="receive", drop=0.5),
        LINK,
        harmless=True,
        longer_s=0.06,
    ),
    Fault("every command lost", _told("disturb_connection", role="inputs", drop=1.0), LINK),
    Fault("another client's program", _script(30002, PLAYS), ("foreign_program",)),
    Fault("another client's motion", _script(30001, MOVES), ("foreign_program",)),
    Fault("gripper opened by another client", _gripper_switched(True), GRIPPER, True, OUTPUT_S, lets_go=True),
    Fault("gripper closed by another client", _gripper_switched(False), GRIPPER, True, OUTPUT_S),
    Fault("protective stop", _told("protective_stop"), ("protective_stop",), longer_s=CATEGORY_2_S),
    Fault(
        "protective stop, program stopped",
        _told("protective_stop", runtime="stopped"),
        ("protective_stop",),
        longer_s=CATEGORY_2_S,
    ),
    Fault(
        "protective stop, program playing",
        _told("protective_stop", runtime="playing"),
        ("protective_stop",),
        longer_s=CATEGORY_2_S,
    ),
    Fault("safeguard stop", _told("safeguard_stop"), ("protective_stop",), longer_s=CATEGORY_2_S),
    Fault("emergency stop", _told("emergency_stop"), ("emergency_stop",)),
    Fault("program stopped", _told("stop_program"), ("aborted",)),
    Fault("program paused", _told("pause_program"), ("aborted",)),
    Fault("speed slider at 50 %", _told("speed_slider", fraction=0.5), ("aborted",)),
    Fault("power lost", _told("power_loss"), ("power_off",)),
    Fault("database locked", _database_locked, (), harmless=True),
)
SILENT_S = 0.15  # [s] after which a gripper that does not answer ends a run
SEEN_S = 0.03  # [s] until fingers that move are asked for where they are, and have moved enough
COMMANDED = ("before the command", "after the command")  # fingers that open do not tell that they opened on nothing
GRIPPER_FAULTS = (  # of a gripper on a network, in the phases of a throw; with the object gone nothing is left to fail
    Fault("gripper silent", _told("stall_connection", role="gripper"), GRIPPER, True, SILENT_S),
    Fault("gripper late by 300 ms", _told("disturb_connection", role="gripper", delay_s=0.3), GRIPPER, True, SILENT_S),
    Fault("gripper's connection closed", _told("close_connection", role="gripper"), GRIPPER, True),
    Fault("object lost by the gripper", _told("object_lost"), GRIPPER, True, SEEN_S, lets_go=True, unseen=COMMANDED),
    Fault("networked gripper opened", _gripper_told("SET POS 0 GTO 1\n"), GRIPPER, True, SEEN_S, lets_go=True),
)
INPUT_FAULTS = (  # of a gripper on an output, whose grip an input shows; in the phases of a throw likewise
    Fault("object lost, as an input shows", _told("object_lost"), GRIPPER, True, lets_go=True, unseen=COMMANDED),
)
STREAMED = tuple(phase for phase in PHASES if phase.await_moment is _replacing)  # a script cannot be replaced
THROWS = tuple(phase for phase in PHASES if phase.begin is _begin_throw)
PHASE = {phase.name: phase for phase in PHASES}
FAULT = {fault.name: fault for fault in (*FAULTS, *GRIPPER_FAULTS, *INPUT_FAULTS)}


# Cells


@dataclass(frozen=True)
class CellResult:
    """What happened in one cell of the table.

    Attributes:
        phase, fault: the cell.
        outcome, reason: of the execution.
        rest_s: from the fault to the arm's last motion, by the controller's clock [s].
        landing_error_m: of the object that left; None where none did.
        landed_m: landing error of an object that was let go as planned [m].
        told: whether the execution says what became of the object.
        latched: whether a fault is latched.
        was_held, is_held: whether the gripper held an object before, and at the end.
    """

    phase: Phase
    fault: Fault
    outcome: str
    reason: str
    rest_s: float
    landing_error_m: float | None
    landed_m: float
    told: bool
    latched: bool
    was_held: bool
    is_held: bool

    def broken(self) -> list[str]:
        """Returns what does not hold in this cell, in words; empty where all does."""
        return [words for words in (self._of_the_arm(), self._of_the_object()) if words]

    def _of_the_arm(self) -> str:
        limit_s = REST_S + self.fault.longer_s + (0.0 if realtime.is_permitted() else ORDINARY_S)
        if self.outcome == "completed":
            return "" if self.fault.harmless or self.rest_s < limit_s else "the run went on"
        if self.outcome not in self.fault.outcomes or not self.reason:
            return f"{self.outcome}: {self.reason}"
        if not self.latched:
            return "no fault is latched"
        return "" if self.rest_s < limit_s else f"at rest after {1e3 * self.rest_s:.0f} ms: {self.reason}"

    def _of_the_object(self) -> str:
        error_m = self.landing_error_m
        if error_m is None:
            return "the object is gone, and never left the gripper" if self.was_held and not self.is_held else ""
        if self.phase.holds and self.outcome != "completed" and not self.fault.lets_go:
            return "the object was lost"
        if self.phase.name in self.fault.unseen:
            return ""
        is_told = (self.told or self.fault.leaves_nobody) and self.outcome != "completed"
        if error_m > self.landed_m and not is_told:
            return f"the object landed {1e3 * error_m:.0f} mm off, and nobody says so"
        return ""


def run_cell(rig: Rig, phase: Phase, fault: Fault, mode: str = "speedj") -> CellResult:
    """Causes a fault in a phase of an execution in a mode, and brings the rig back in order."""
    rig.stand_up()
    id = phase.begin(rig, mode)
    rig.until(lambda: rig.row(id).state in ("approaching", "streaming"), period=POLL_S)
    trigger = fault.prepare(rig)
    newest = rig.newest_object()
    was_held = _holds(rig)
    phase.await_moment(rig, id)
    at = rig.state()["t"]
    undo = trigger()
    try:
        rig.rest_time(at)
    finally:
        if callable(undo):
            undo()
    rig.revive()
    row = rig.end(id)
    rest_s = rig.rest_time(at)
    error = _landing_error(rig, id, newest)
    measured = row.metrics is not None and row.metrics["landing_point"] is not None
    told = measured or "the object" in (row.reason or "")
    latched = row.outcome != "completed" and _latches(rig)
    return CellResult(
        phase,
        fault,
        str(row.outcome),
        row.reason or "",
        rest_s,
        error,
        _landed_m(rig, id),
        told,
        latched,
        was_held,
        _holds(rig),
    )


def _latches(rig: Rig) -> bool:
    """Returns whether a fault is latched, once the executor has had time to publish it."""
    end = time.monotonic() + PUBLISHED_S
    while not rig.is_latched() and time.monotonic() < end:
        time.sleep(POLL_S)
    return rig.is_latched()


def _holds(rig: Rig) -> bool:
    return rig.state()["gripper_holds"] is not None


def _landing_error(rig: Rig, id: str, newest: int) -> float | None:
    """Returns how far from its plan an object newer than `newest` landed [m]; None where none left the gripper."""
    number = rig.newest_object()
    if number == newest:
        return None
    rig.until(lambda: _landings(rig, number))
    planned = rig.document(id)["flight"]["landing_point"]
    return float(np.linalg.norm(np.subtract(_landings(rig, number)[0], planned)[:2]))


def _landed_m(rig: Rig, id: str) -> float:
    """Returns how far off an object may land that was let go as planned [m]: a gripper may take commands at times.

    Half a quantum sooner or later it leaves with the speed and from the place that the tool has then.
    """
    link = rig.cell.gripper.link
    problem, motion = plan_from_document(rig.document(id), rig.cell)
    nominal = release_flight(problem, motion)
    if link is None or nominal is None:
        return LANDED_M
    ticks = math.ceil(0.5 * link.quantum_s * motion.sample_rate_hz)
    shifts = []
    for k in range(motion.release_index - ticks, motion.release_index + ticks + 1):
        X_WT, V_WT = tool_state(rig.cell, motion.q[k], motion.qd[k])
        flight = fly(X_WT[:3, 3], V_WT[:3], problem.plane_z, problem.gravity, problem.drag)
        assert flight is not None
        shifts.append(float(np.linalg.norm(flight.landing_point - nominal.landing_point)))
    return LANDED_M + max(shifts)


def _landings(rig: Rig, number: int) -> list[list[float]]:
    return [landed["position_m"] for landed in rig.world()["landings"] if landed["object"] == number]
