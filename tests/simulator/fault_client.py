"""The real ur_rtde client under faults, in a process of its own: it may hang or crash.

`python fault_client.py HOST SCENARIO` streams speedJ, causes the fault and prints the client's observations as JSON.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import dashboard_client
import rtde_control
import rtde_io
import rtde_receive

SPEED = [0.2, 0.0, 0.0, 0.0, 0.0, 0.0]
Seen = dict[str, Any]


def wait(condition: Callable[[], object], seconds: float = 5.0) -> bool:
    """Waits until `condition` holds, long enough for a loaded machine; returns whether it did in time."""
    until = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > until:
            return False
        time.sleep(0.005)
    return True


class FaultClient:
    """Control and receive on a simulator, and its control port."""

    def __init__(self, host: str) -> None:
        self.host = host
        self.control = rtde_control.RTDEControlInterface(host)
        self.receive = rtde_receive.RTDEReceiveInterface(host)

    def ask(self, op: str, **request: object) -> Seen:
        with socket.create_connection((self.host, 29900)) as sock:
            sock.sendall(json.dumps({"op": op, **request}).encode() + b"\n")
            return json.loads(sock.makefile().readline())

    def fault(self, name: str, **parameters: object) -> None:
        assert self.ask("fault", name=name, **parameters)["ok"]

    def stream(self, seconds: float) -> list[object]:
        """Streams speedJ; returns what each call returned or raised."""
        answers: list[object] = []
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            begin = self.control.initPeriod()
            try:
                answers.append(self.control.speedJ(SPEED, 10.0, 0.002))
            except RuntimeError as error:
                answers.append(str(error))
            self.control.waitPeriod(begin)
        return answers

    def streaming(self) -> FaultClient:
        """Streams for a moment first."""
        assert all(self.stream(0.15))
        return self


def stopped(fault: str, **parameters: object) -> Callable[[str], Seen]:
    """Returns a scenario with a stop during streaming: results of the calls, and the state that the client reads."""

    def scenario(host: str) -> Seen:
        c = FaultClient(host).streaming()
        c.fault(fault, **parameters)
        hidden = parameters.get("runtime") == "playing"
        wait(c.receive.isProtectiveStopped if hidden else lambda: c.receive.getRuntimeState() != 2)
        wait(lambda: hidden or c.stream(0.004)[-1] is False)
        answers = c.stream(0.1)
        begin = time.monotonic()
        moved = c.control.moveJ(c.receive.getActualQ(), 0.5, 1.0) if False in answers else None
        return {
            "answers": sorted(set(map(str, answers))),
            "moveJ": moved,
            "moveJ_s": time.monotonic() - begin,
            "protective": c.receive.isProtectiveStopped(),
            "emergency": c.receive.isEmergencyStopped(),
            "runtime": c.receive.getRuntimeState(),
            "safety_mode": c.receive.getSafetyMode(),
            "safety_bits": c.receive.getSafetyStatusBits(),
            "robot_mode": c.receive.getRobotMode(),
        }

    return scenario


def unlock_and_play(host: str) -> Seen:
    """After unlocking, "play" resumes the speed thread with its last target; a new upload does not."""
    c = FaultClient(host).streaming()
    c.fault("protective_stop")
    dashboard = dashboard_client.DashboardClient(host)
    dashboard.connect()
    wait(lambda: succeeds(dashboard.unlockProtectiveStop) and not c.receive.isProtectiveStopped())
    wait(lambda: succeeds(dashboard.play))
    wait(lambda: c.receive.getTargetQd()[0] == SPEED[0])
    resumed = c.receive.getTargetQd()[0]
    c.control.reuploadScript()
    wait(lambda: c.receive.getTargetQd()[0] == 0.0)
    runs = wait(c.control.isProgramRunning)
    time.sleep(0.2)
    return {"resumed": resumed, "after_upload": c.receive.getTargetQd()[0], "runs": runs}


def succeeds(call: Callable[[], object]) -> bool:
    """Whether a dashboard command is obeyed."""
    try:
        call()
    except (RuntimeError, ValueError):
        return False
    return True


def killed(host: str) -> Seen:
    c = FaultClient(host).streaming()
    with suppress(json.JSONDecodeError):  # it dies before it can answer
        c.fault("kill")
    wait(lambda: not c.control.isConnected())
    answers = c.stream(0.2)
    return {
        "last": answers[-1],
        "errors": [a for a in answers if isinstance(a, str)],
        "connected": c.control.isConnected(),
        "running": c.control.isProgramRunning(),
    }


def frozen(host: str) -> Seen:
    c = FaultClient(host).streaming()
    c.fault("freeze", duration_s=0.8)
    answers = c.stream(1.2)
    return {"answers": sorted(set(map(str, answers))), "connected": c.receive.isConnected()}


def receive_stalled(host: str) -> Seen:
    c = FaultClient(host).streaming()
    c.fault("stall_connection", role="receive")
    time.sleep(0.2)
    first = c.receive.getTimestamp()
    early = c.receive.isConnected()
    time.sleep(1.5)
    middle = c.receive.isConnected()
    lost = wait(lambda: not c.receive.isConnected())
    return {"advanced": c.receive.getTimestamp() - first, "early": early, "middle": middle, "late": not lost}


def receive_closed(host: str) -> Seen:
    c = FaultClient(host)
    c.fault("close_connection", role="receive")
    wait(lambda: not c.receive.isConnected())
    q = c.receive.getActualQ()
    connected = c.receive.isConnected()
    c.receive.reconnect()
    return {"connected": connected, "stale": len(q), "again": wait(c.receive.isConnected)}


def io_closed(host: str) -> Seen:
    c = FaultClient(host)
    io = rtde_io.RTDEIOInterface(host)
    c.fault("close_connection", role="io")
    time.sleep(0.1)
    answers: list[object] = []
    for _ in range(3):
        try:
            answers.append(io.setToolDigitalOut(0, True))
        except RuntimeError as error:
            answers.append(str(error))
        time.sleep(0.1)
    io.reconnect()
    again = io.setToolDigitalOut(0, True)
    return {"answers": answers, "again": again, "bit": wait(lambda: c.receive.getDigitalOutState(16))}


def control_closed(host: str) -> Seen:
    """ur_rtde reconnects by itself, stopping and uploading the program again; it may hang or crash doing so."""
    c = FaultClient(host).streaming()
    uploads = sum("script received" in text for _, text in c.ask("events")["events"])
    c.fault("close_connection", role="control", reset=True)
    print(json.dumps({"uploads": uploads}), flush=True)
    c.stream(0.5)
    return {"uploads": uploads}


def second_client(host: str) -> Seen:
    """Two control clients in different register ranges: both connect, but only one program can run."""
    kind = rtde_control.RTDEControlInterface
    first = kind(host, 500.0, kind.FLAG_UPLOAD_SCRIPT | kind.FLAG_UPPER_RANGE_REGISTERS | kind.FLAG_NO_EXT_FT)
    receive = rtde_receive.RTDEReceiveInterface(host)
    q = receive.getTargetQ()
    goal = [q[0] + 0.05, *q[1:]]
    alone = first.moveJ(goal, 1.0, 5.0)
    arrived = wait(lambda: abs(receive.getTargetQ()[0] - goal[0]) < 1e-6)
    second = kind(host, 500.0, kind.FLAG_UPLOAD_SCRIPT | kind.FLAG_NO_EXT_FT)
    moved = second.moveJ(q, 1.0, 5.0)
    wait(lambda: receive.getTargetQd()[0] == 0.0)
    return {
        "alone": alone,
        "arrived": arrived,
        "second": moved,
        "first_still": first.speedJ(SPEED, 1.0, 0.002),
        "speed": receive.getTargetQd()[0],
    }


def delayed(host: str) -> Seen:
    c = FaultClient(host)
    c.fault("disturb_connection", role="receive", delay_s=1.0)  # on a busy machine the controller's clock slips
    time.sleep(1.5)
    seen = c.receive.getTimestamp()
    late = c.ask("state")["t"] - seen
    c.fault("disturb_connection", role="receive", drop=0.5)
    time.sleep(0.5)
    stamps = set()
    until = time.monotonic() + 0.5
    while time.monotonic() < until:
        stamps.add(round(c.receive.getTimestamp() / 0.002))
    return {"late": late, "seen": len(stamps) / (max(stamps) - min(stamps) + 1)}


def dropped_commands(host: str) -> Seen:
    c = FaultClient(host).streaming()
    c.fault("disturb_connection", role="control", drop=0.5)
    c.ask("reset_stats")
    c.stream(0.4)
    return c.ask("stats")["commands_per_cycle"]


def slider(host: str) -> Seen:
    c = FaultClient(host).streaming()
    c.fault("speed_slider", fraction=0.5)
    wait(lambda: c.stream(0.02) and abs(c.receive.getTargetQd()[0] - SPEED[0] / 2) < 1e-9)
    return {
        "fraction": c.receive.getTargetSpeedFraction(),
        "combined": c.receive.getSpeedScalingCombined(),
        "speed": c.receive.getTargetQd()[0],
    }


def constructed(prepare: str = "", **parameters: object) -> Callable[[str], Seen]:
    """Returns a scenario that constructs the control interface under a fault."""

    def scenario(host: str) -> Seen:
        with socket.create_connection((host, 29900)) as sock:
            sock.sendall(json.dumps({"op": "fault", "name": prepare, **parameters}).encode() + b"\n")
            assert json.loads(sock.makefile().readline())["ok"]
        begin = time.monotonic()
        try:
            rtde_control.RTDEControlInterface(host)
        except RuntimeError as error:
            return {"error": str(error), "after_s": time.monotonic() - begin}
        return {"error": None, "after_s": time.monotonic() - begin}

    return scenario


SCENARIOS: dict[str, Callable[[str], Seen]] = {
    "protective_stop_paused": stopped("protective_stop"),
    "protective_stop_playing": stopped("protective_stop", runtime="playing"),
    "protective_stop_stopped": stopped("protective_stop", runtime="stopped"),
    "emergency_stop": stopped("emergency_stop"),
    "safeguard_stop": stopped("safeguard_stop"),
    "power_loss": stopped("power_loss"),
    "stop_program": stopped("stop_program"),
    "pause_program": stopped("pause_program"),
    "unlock_and_play": unlock_and_play,
    "killed": killed,
    "frozen": frozen,
    "receive_stalled": receive_stalled,
    "receive_closed": receive_closed,
    "io_closed": io_closed,
    "control_closed": control_closed,
    "second_client": second_client,
    "delayed": delayed,
    "dropped_commands": dropped_commands,
    "slider": slider,
    "local_mode": constructed("local_mode"),
    "offline": constructed("offline"),
    "mute_dashboard": constructed("mute", port="dashboard"),
    "mute_rtde": constructed("mute", port="rtde"),
    "protective_stop_before": constructed("protective_stop"),
}


if __name__ == "__main__":
    print(json.dumps(SCENARIOS[sys.argv[2]](sys.argv[1])), flush=True)
    os._exit(0)  # destructors of ur_rtde sleep for half a second each, and crash on lost sockets
