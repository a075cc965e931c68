"""A rig: simulated controller, executor and store as real processes on an address of their own."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace as changed
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import psutil

from executor.robot import Console, simulator_client
from planner.answer import plan_document, plan_from_document
from planner.cell import load_cell
from planner.planning import plan
from planner.request import problem_from_request
from planner.trajectory import Trajectory
from store import ExecutionRow, PlanRow, Store, new_id, plan_sha256, split_plan
from tests.processes import children_with
from tests.waiting import until

ROOT = Path(__file__).parents[2]
NUMBERS = count()
READY_WITHIN_S = 30.0  # [s] a busy machine imports numpy slowly
END_WITHIN_S = 60.0
QUIET_TRIES = 6
MOVING_RAD_S = 0.5  # [rad/s] in mid-launch of TOSS
FAST_RAD_S = 2.5  # [rad/s] in mid-launch of LONG_LOB, which releases at 2.6 and passes 2.8
ROBOT_RUNNING = 7  # robot_mode
ABORTED_S = 0.32  # [s] from the request to rest; at 10 rad/s^2 some 0.25 from 2 rad/s, at 5.6 (the move's own) 0.38
RESTED_S = 0.1  # [s] of the controller's time at rest: longer than a lag, so it will not move again

# From near home to 1.2 rad/s and back to rest: short, clear of everything, and it throws.
TOSS = {"kind": "joint", "positions": [0.25, -1.45, 1.45, -1.5, -1.45, 0.1],
        "velocities": [1.2, 0.6, -0.6, 0.3, 0.5, 0.2]}  # fmt: skip
NUDGE = {"kind": "joint", "positions": [0.03, -1.57, 1.57, -1.57, -1.57, 0.0], "velocities": [0.0] * 6}
FAR = {**NUDGE, "positions": [2.4, -1.57, 1.57, -1.57, -1.57, 0.0]}
LOB = {"kind": "target", "position": [1.2, 0.3, 0.0]}
OTHER_INTERFACES = ("dashboard", "robot_api", "script", "primary", "secondary")  # than RTDE
POLYSCOPE_X = {'polyscope = "5.11.1"': 'polyscope = "10.14.0"'}  # of a cell: a controller without dashboard
CELLS = {  # name of a cell -> the shipped one that it is, and what differs: 500 Hz with PolyScope 5 and X, 125 Hz
    "ur5e-sim": ("ur5e-sim", {}),
    "ur5e-sim-x": ("ur5e-sim", POLYSCOPE_X),
    "ur5-sim": ("ur5-sim", {}),
}
LONG_LOB = {  # to the same place, in a launch of 0.39 s: fast for long before the gripper gets its command
    "kind": "joint",
    "positions": [-0.793535074, -1.715249993, 0.861325679, -1.839990554, -1.394005193, -0.523414694],
    "velocities": [-2.64350457, -1.894591213, -2.563898522, -1.48043784, -1.310684348, 0.0],
}


class Rig:
    """The processes of one cell, and the operations of a test on them."""

    def __init__(
        self, folder: Path, base: str = "ur5e-sim", replace: Mapping[str, str] | None = None, url: str | None = None
    ) -> None:
        pid = os.getpid()
        self.host = f"127.{120 + next(NUMBERS) % 80}.{pid >> 8 & 255}.{pid & 255 or 1}"
        text = (ROOT / "cells" / f"{base}.toml").read_text()
        text = re.sub(r'host = "[^"]*"', f'host = "{self.host}"', text)
        for old, new in (replace or {}).items():
            assert old in text
            text = text.replace(old, new)
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / "rig.toml"
        self.path.write_text(text)
        self.folder, self.cell = folder, load_cell(self.path)
        self.url = url or f"sqlite:///{folder / 'fling.db'}"
        self.store = Store.open(self.url)
        self.environment = {**os.environ, "FLING_DATABASE_URL": self.url, "FLING_CELLS": str(folder),
                            "FLING_DATA": str(folder / "data"), "FLING_APPROACH_PACE": "2"}  # fmt: skip
        self.simulator = self.executor = None
        self.wrap: list[str] = []  # prefix of every command
        self._plans: dict[str, str] = {}
        self._queued = ""  # newest execution

    @property
    def is_polyscope_x(self) -> bool:
        """Whether the controller is one without a dashboard."""
        return self.cell.sim.polyscope.startswith("10.")

    def rewrite(self, text: str) -> None:
        """Replaces the cell file."""
        self.path.write_text(text)
        self.cell = load_cell(self.path)
        self._plans.clear()

    def set_gripper(self, table: str) -> None:
        """Gives the cell another gripper; `HOST` in its keys is the controller's address."""
        head, _, rest = self.path.read_text().partition("[gripper]\n")
        kept = [line for line in rest.splitlines(keepends=True) if not line.startswith(("output =", "open_level ="))]
        self.rewrite(f"{head}[gripper]\n{table.replace('HOST', self.host)}{''.join(kept)}")

    # processes

    def start(self) -> None:
        """Starts the simulated controller and the executor, which load at the same time."""
        self.simulator = self._launched_simulator()
        self.start_executor()
        _await_ready(self.simulator)

    def start_simulator(self, *options: str) -> None:
        """Starts the simulated controller alone."""
        self.simulator = self._launched_simulator(*options)
        _await_ready(self.simulator)

    def start_executor(self, *flags: str) -> None:
        """Starts the executor and waits for its first heartbeat."""
        began = time.time()
        self.executor = self._launched("executor", "--cell", "rig", *flags)
        _await_ready(self.executor)
        self.until(lambda: (row := self.store.cell_status("rig")) is not None and row.heartbeat_at > began
                   and row.robot.get("connected") is True)  # fmt: skip

    def _launched_simulator(self, *options: str) -> subprocess.Popen[bytes]:
        return self._launched("simulator", "--cell", str(self.path), "--protective-stop-lock-s", "0.1", *options)

    def _launched(self, module: str, *arguments: str) -> subprocess.Popen[bytes]:
        command = [*self.wrap, sys.executable, "-m", module, *arguments]
        return subprocess.Popen(command, cwd=ROOT, env=self.environment, stdout=subprocess.PIPE)

    def revive(self) -> None:
        """Starts the executor again where it was killed, and lets it run where it was frozen."""
        assert self.executor is not None
        if self.executor.poll() is not None:
            self.start_executor()
        self.executor.send_signal(signal.SIGCONT)

    def stand_up(self) -> None:
        """Brings everything back in order: executor running, robot ready, no latched fault."""
        self.revive()
        self.recover()
        if self._queued:  # a test that failed has not waited for its end
            self.end(self._queued)
        if self.is_latched():
            self.acknowledge()

    def stop(self) -> None:
        """Ends every process and closes the store."""
        for process in (self.executor, self.simulator):
            if process is not None and process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.terminate()
                process.wait(30.0)
        self.store.close()

    def streamer(self) -> psutil.Process:
        """Returns the streaming process."""
        assert self.executor is not None
        return children_with("executor.streaming", self.executor.pid)[0]

    # executions

    def plan(self, release: Mapping[str, Any], **fields: Any) -> str:
        """Plans the soonest release and stores it; returns the id."""
        return self.plan_of({"release": dict(release), "release_window_s": 0.0, **fields})

    def plan_of(self, request: Mapping[str, Any]) -> str:
        """Plans a request and stores it; returns the id. The same request is planned once."""
        key = repr(request)
        if key not in self._plans:
            request = {"cell": "rig", "backend": "ruckig", "time_limit_s": 30.0, **request}
            answer = plan(problem_from_request(request, self.cell))
            document = plan_document(answer, request, new_id(), "2026-01-01T00:00:00Z")
            self.add_plan(document)
            self._plans[key] = document["id"]
        return self._plans[key]

    def add_plan(self, document: Mapping[str, Any], **changes: Any) -> None:
        """Stores a plan document as a planner does; `changes` are fields of its row that somebody changes then."""
        summary, samples = split_plan(orjson.dumps(document, option=orjson.OPT_SERIALIZE_NUMPY))
        id = document["id"]
        head = (id, time.time(), "rig", document["cell_sha256"], document["backend"])
        row = PlanRow(*head, summary, samples=samples, sha256=plan_sha256(id, summary, samples))
        self.store.add_plan(changed(row, **changes))

    def queue(self, release: Mapping[str, Any] = TOSS, mode: str = "speedj", dry_run: bool = False) -> str:
        """Queues an execution; returns its id."""
        return self.queue_plan(self.plan(release), mode, dry_run)

    def queue_plan(self, plan_id: str, mode: str = "speedj", dry_run: bool = False) -> str:
        """Queues an execution of a stored plan; returns its id."""
        self._queued = self.store.queue_execution(plan_id, "rig", mode, dry_run, "test").id
        return self._queued

    def row(self, id: str) -> ExecutionRow:
        """Returns an execution."""
        row = self.store.execution(id)
        assert row is not None
        return row

    def document(self, id: str) -> dict[str, Any]:
        """Returns the plan of an execution."""
        row = self.store.plan(self.row(id).plan_id)
        assert row is not None
        return orjson.loads(row.document)

    def motion(self, id: str) -> Trajectory:
        """Returns the trajectory of the plan of an execution."""
        return plan_from_document(self.document(id), self.cell)[1]

    def end(self, id: str) -> ExecutionRow:
        """Waits for the end of an execution."""
        self.until(lambda: self.row(id).state == "finished", END_WITHIN_S)
        return self.row(id)

    def abort_approaching(self, id: str, speed: float) -> None:
        """Aborts an execution while the arm is on its way to the start; it ends at rest and latches nothing.

        Args:
            id: of the execution.
            speed: of the leading joint [rad/s] from which it is aborted.
        """

        def on_the_way() -> bool:
            return self.row(id).state == "approaching" and max(map(abs, self.state()["qd"])) > speed

        self.until(on_the_way, period=0.001)
        at = self.state()["t"]
        self.store.request_abort(id)
        rest_s = self.rest_time(at)
        row = self.end(id)
        assert row.outcome == "aborted", row.reason
        assert self.states(id) == ["queued", "preparing", "approaching", "braking", "finished"]
        assert rest_s < ABORTED_S
        assert max(map(abs, self.state()["qd"])) < 1e-3
        assert not self.is_latched()

    def far_from_its_start(self) -> str:
        """Queues an execution with a long approach, and waits until the arm is on its way; returns the id."""
        self.throw_when_ready(FAR)
        id = self.queue(NUDGE)
        self.until(lambda: max(map(abs, self.state()["qd"])) > MOVING_RAD_S, period=0.001)
        return id

    def states(self, id: str) -> list[str]:
        """Returns the states that an execution went through."""
        return [event.data["state"] for event in self.store.events(id) if event.kind == "state"]

    def throw(self, release: Mapping[str, Any] = TOSS, mode: str = "speedj", dry_run: bool = False) -> ExecutionRow:
        """Queues an execution and waits for its end."""
        return self.end(self.queue(release, mode, dry_run))

    def quiet_throw(self, release: Mapping[str, Any], mode: str = "speedj") -> ExecutionRow:
        """Throws until a run has missed no tick: assertions about a throw hold on a machine that is not overloaded."""
        return self.quiet_run(self.plan(release), mode)

    def quiet_run(self, plan_id: str, mode: str = "speedj") -> ExecutionRow:
        """Executes a stored plan until a run has missed no tick."""
        for _ in range(QUIET_TRIES):
            row = self.end(self.queue_plan(plan_id, mode))
            if row.outcome == "completed" and row.metrics is not None and row.metrics["missed_ticks"] == 0:
                return row
            if self.is_latched():
                self.acknowledge()
        return row

    def launch(self, speed: float) -> str:
        """Queues LONG_LOB as soon as the robot is in order, and waits until the arm moves at `speed`; returns the id.

        It shows that the previous test left everything working.
        """
        id = self.queue_when_ready(LONG_LOB)
        self.in_launch(id, speed)
        return id

    def in_launch(self, id: str, speed: float = MOVING_RAD_S) -> None:
        """Waits until an execution streams and the arm moves at `speed`."""
        self.until(lambda: self.row(id).state in ("streaming", "braking", "finished"))
        assert self.row(id).state == "streaming", self.row(id)
        self.until(lambda: max(map(abs, self.state()["qd"])) > speed, period=0.001)

    def is_latched(self) -> bool:
        """Whether a fault is latched."""
        row = self.store.cell_status("rig")
        return row is not None and row.fault is not None

    def acknowledge(self) -> None:
        """Acknowledges the latched fault."""
        self.store.request_acknowledge("rig", "test")
        self.until(lambda: not self.is_latched())

    # the controller

    def state(self) -> dict[str, Any]:
        """Returns the true state of the controller."""
        return simulator_client.request(self.host, "state")

    def world(self) -> dict[str, Any]:
        """Returns releases and landings."""
        return simulator_client.request(self.host, "world")

    def speed(self) -> float:
        """Returns the true speed of the fastest joint [rad/s]."""
        return max(map(abs, self.state()["qd"]))

    def newest_object(self) -> int:
        """Returns the number of the object that left last; 0 where none did."""
        return max((release["object"] for release in self.world()["releases"]), default=0)

    def fault(self, name: str, **parameters: Any) -> None:
        """Injects a fault."""
        simulator_client.request(self.host, "fault", name=name, **parameters)

    def recover(self) -> None:
        """Recovers the robot: every cause of a stop removed, arm powered, remote control, full speed."""
        self.fault("offline", on=False)
        for role in ("any", *OTHER_INTERFACES):
            self.fault("stall_connection", role=role, on=False)
        self.fault("disturb_connection", role="every")
        self.fault("clear")
        self.fault("local_mode", on=False)
        self.fault("speed_slider", fraction=1.0)
        self.fault("gripper_stuck", on=False)
        self.fault("outputs_stuck", on=False)
        self.fault("stall_connection", role="gripper", on=False)
        self.fault("mute", port="robot_api" if self.is_polyscope_x else "dashboard", on=False)
        if self.state()["robot_mode"] != ROBOT_RUNNING:
            console = Console(self.host)
            console.act("power_on")
            console.act("brake_release")
            console.close()

    def throw_when_ready(self, release: Mapping[str, Any] = NUDGE) -> ExecutionRow:
        """Throws as soon as the executor sees its robot in order again."""
        return self.end(self.queue_when_ready(release))

    def queue_when_ready(self, release: Mapping[str, Any], mode: str = "speedj") -> str:
        """Queues an execution until one is not refused; returns its id."""
        return self.queue_plan_when_ready(self.plan(release), mode)

    def queue_plan_when_ready(self, plan_id: str, mode: str = "speedj") -> str:
        """Queues an execution of a stored plan until one is not refused; returns its id."""

        def accepted() -> bool:
            id = self.queue_plan(plan_id, mode)
            self.until(lambda: self.row(id).state in ("approaching", "streaming", "finished"))
            return self.row(id).outcome != "refused"

        self.until(accepted, READY_WITHIN_S, period=0.05)
        return self._queued

    def robot(self) -> Mapping[str, Any]:
        """Returns the live state as the executor publishes it."""
        row = self.store.cell_status("rig")
        return {} if row is None else row.robot

    def rest_time(self, since: float) -> float:
        """Waits for rest; returns the time from `since` to the arm's last motion [s].

        Both are the controller's time, which a busy machine does not change.
        """
        self.until(lambda: (state := self.state())["t"] - state["moved_at"] > RESTED_S)
        return self.state()["moved_at"] - since

    @staticmethod
    def until(condition: Callable[[], object], within_s: float = READY_WITHIN_S, period: float = 0.01) -> None:
        """Waits for a condition, long enough for a busy machine."""
        until(condition, within_s, period)


def _await_ready(process: subprocess.Popen[bytes]) -> None:
    """Waits until a process says that it serves."""
    assert process.stdout is not None
    line = process.stdout.readline()
    process.stdout.close()
    assert line.startswith(b"ready"), line


def rows_of(csv: bytes) -> tuple[list[str], np.ndarray]:
    """Returns header and numbers (n, columns) of a recording's CSV."""
    header, *lines = csv.decode().splitlines()
    return header.split(","), np.array([[float(x) for x in line.split(",")] for line in lines])
