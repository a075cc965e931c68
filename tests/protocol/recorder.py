"""Records a run of the real processes: the store's events, and every state that the controller publishes."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from itertools import pairwise

from executor.preflight import gripper_is_open
from executor.robot import RobotState
from executor.robot.session import RtdeReceiver
from executor.rtde_packages import RTDE_PORT
from executor.streaming.state_checks import PLAYING
from tests.protocol.traces import ANSWERS, CONTROLLER, RecordedAct, RecordedTrace
from tests.system.rig import Rig

MOVES_RAD_S = 0.01  # [rad/s] measured speed of an arm that moves; the executor takes it for rest below this, too
KNOWN = ("completed", "aborted", "refused", "executor_lost")  # outcomes that the model tells apart
RATE_HZ = 500.0


class ProtocolRecorder:
    """Records from `with` to its end; the controller's states over a connection of its own, so that none is missed."""

    def __init__(self, rig: Rig, name: str) -> None:
        self.rig = rig
        self.name = name
        self.ids: list[str] = []
        self.acts: list[tuple[str, int, float]] = []  # act, store events and the controller's time by then [s]
        self._states: list[RobotState] = []
        self._over = threading.Event()

    def __enter__(self) -> ProtocolRecorder:
        self._socket = socket.create_connection((self.rig.host, RTDE_PORT), 5.0)
        self._receiver = RtdeReceiver(self._socket, RATE_HZ)
        self._released = len(self.rig.world()["releases"])
        self._thread = threading.Thread(target=self._receive, daemon=True)
        self._thread.start()
        self.rig.until(lambda: self._states)
        return self

    def __exit__(self, *_: object) -> None:
        end = self.rig.state()["t"]
        self.rig.until(lambda: self._states[-1].timestamp_s >= end)
        self._over.set()
        self._thread.join()
        self._socket.close()

    def _receive(self) -> None:
        while not self._over.is_set():
            self._states.append(self._receiver.receive())

    def follow(self, id: str) -> str:
        """Follows an execution that was queued since the recording began."""
        self.ids.append(id)
        return id

    def act(self, name: str, does: Callable[[], object]) -> None:
        """Does something to a process, or asks for something."""
        self.acts.append((name, len(self._store()), self._states[-1].timestamp_s))
        does()

    def trace(self) -> RecordedTrace:
        """Returns what was recorded, once it is over."""
        controller = self._controller()
        times = [at for at, _ in controller]
        acts = [RecordedAct(act, seen, sum(t <= at for t in times)) for act, seen, at in self.acts]
        answers = [
            ANSWERS[answer["joins_s"] is None] for id in self.ids for answer in self.rig.row(id).replacements or ()
        ]
        gripper = "open" if gripper_is_open(self.rig.cell, self._states[0]) else "shut"
        return RecordedTrace(self.name, gripper, self._store(), answers, [event for _, event in controller], acts)

    def _store(self) -> list[str]:
        """Returns states and outcomes of the executions, as their events tell them."""
        return [_told(event.data) for id in self.ids for event in self.rig.store.events(id) if event.kind == "state"]

    def _controller(self) -> list[tuple[float, str]]:
        """Returns what the controller's states show, and the simulator's record of releases: time [s], event."""
        found: list[tuple[float, str]] = []
        for before, after in pairwise(self._states):
            plays = [each.runtime_state == PLAYING for each in (before, after)]
            opens = [gripper_is_open(self.rig.cell, each) for each in (before, after)]
            if plays[0] != plays[1]:
                found.append((after.timestamp_s, "plays" if plays[1] else "ends"))
            if opens[0] != opens[1]:
                found.append((after.timestamp_s, "opens" if opens[1] else "shuts"))
        found += [(release["t"], "leaves") for release in self.rig.world()["releases"][self._released :]]
        begun = [at for at, event in found if event == "plays"]
        for begins, ends in zip(begun, [*begun[1:], float("inf")], strict=True):
            moving = [s.timestamp_s for s in self._states if begins <= s.timestamp_s < ends and _moves(s)]
            if moving:
                found += [(moving[0], "moves"), (moving[-1], "rests")]
        return sorted(found, key=lambda each: (each[0], CONTROLLER.index(each[1])))


def _moves(state: RobotState) -> bool:
    return max(map(abs, state.qd)) > MOVES_RAD_S


def _told(data: dict[str, str]) -> str:
    if data["state"] != "finished":
        return data["state"]
    outcome = "completed" if data["outcome"] == "held" else data["outcome"]  # in order, the object kept
    return f"finished: {outcome if outcome in KNOWN else 'fault'}"


def settled(rig: Rig) -> None:
    """Waits until the controller plays nothing and what was thrown has landed."""
    rig.until(lambda: rig.state()["t"] - rig.state()["moved_at"] > 0.2 and not rig.world()["in_flight"])
    time.sleep(0.1)  # the end of a program reaches the states
