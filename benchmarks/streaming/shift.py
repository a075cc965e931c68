"""A shift of picks and throws: `python -m benchmarks.streaming.shift [--learn 40] [--count 200] [--kill-every-s 600]`.

A service, an executor and a simulated controller with a hidden truth, in real time. Objects lie on six places of a
feeder, each displaced at random, and are filled up again; some grips take nothing, as an input shows. They are thrown
into two bins in turn. A first job of `--learn` objects is what the cell learns from, by the landings that its camera
sees; then comes the shift. Every `--kill-every-s` the executor or the service is killed at a random instant of a
motion, and every `--fault-every-s` one of FAULTS comes over the robot; where that stops the job, its cause is removed,
and the job acknowledged and resumed, as an operator would. Told for each of `--jobs`: cycles an hour, objects by what
became of them, the share in the bin as the camera saw it, with its interval, the share that truly lies in it (one
report of the camera in twenty is mistaken), and beside both the odds that the plans gave.
"""

from __future__ import annotations

import argparse
import os
import signal
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import fling
from benchmarks.learning.whole_stack import CELL, Laboratory, drawn_truth, running_cell
from executor.robot import simulator_client

HOST = "127.0.62.31"
PORT = 8763
DOWN = [float(np.pi), 0.0, 0.0]
HEIGHT_M = 0.1  # of the tool centre point at a pick
PLACES = [[x, y, HEIGHT_M] for x in (0.42, 0.5) for y in (0.1, 0.2, 0.3)]
FEEDER = f"""
[feeder]
places = {PLACES}
reach_m = 0.03
scatter_m = 0.003
refill_s = 8.0
missed = 0.02
"""
GRIP = "grip_input = 4"
BINS = [
    {"kind": "target", "position": [x, y, 0.0], "opening": {"radius_m": 0.15, "rim_height_m": 0.15}}
    for x, y in ((1.1, -0.3), (1.0, -0.55))
]
POLICY = {"missed_grip": "retry", "missed_throw": "skip", "attempts": 3}
LOOK_S = 0.5
SECONDARY = 30002  # port of the controller's secondary interface
KILLED = ("executor", "api")  # modules of the processes that a kill takes, in turn
# Of a robot, and of its network; each ends what the arm does, and needs somebody who puts it right.
FAULTS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("protective_stop", {"runtime": "stopped"}),
    ("emergency_stop", {}),
    ("safeguard_stop", {}),
    ("power_loss", {}),
    ("stop_program", {}),
    ("speed_slider", {"fraction": 0.5}),
    ("close_connection", {"role": "inputs", "reset": True}),
    ("stall_connection", {"role": "receive"}),
    ("freeze", {"duration_s": 0.5}),
    ("object_lost", {}),
    ("offline", {}),
)
LASTS_S = 3.0  # of a fault, until somebody is there
RUNNING = 7  # robot mode: power on, brakes off
POWERED_S = 30.0  # until the arm has power and its brakes are off


def main() -> None:
    """Runs the shift, and prints what came of it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.streaming.shift", description=__doc__)
    parser.add_argument("--learn", type=int, default=40, help="objects of the job that the cell learns from")
    parser.add_argument("--count", type=int, default=200, help="objects of the shift")
    parser.add_argument("--jobs", type=int, default=1, help="such shifts, one after another")
    parser.add_argument("--kill-every-s", type=float, default=600.0)
    parser.add_argument("--fault-every-s", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    truth = drawn_truth(rng, "ur5-measured").text + FEEDER
    troubles = Troubles(given.kill_every_s, given.fault_every_s, rng)
    with running_cell(truth, host=HOST, port=PORT, gripper=GRIP) as lab:
        lab.command("calibrate", "lag", "--cell", CELL, "--adopt")
        if given.learn:
            print("learning:", told(lab, worked(lab, given.learn, None)), flush=True)
            lab.command("calibrate", "landings", "--cell", CELL, "--adopt")
        troubles.begin()
        for number in range(given.jobs):
            print(f"shift {number + 1}:", told(lab, worked(lab, given.count, troubles)), flush=True)


class Troubles:
    """What goes wrong in a shift, each at a random instant of a motion: a process is killed, or the robot has a fault.

    Args:
        kill_every_s, fault_every_s: between two, half of it to one and a half [s].
        rng: draws the instants, and the order of FAULTS.
    """

    def __init__(self, kill_every_s: float, fault_every_s: float, rng: np.random.Generator) -> None:
        self._rng = rng
        self._every_s: dict[Callable[[Laboratory], None], float] = {
            self._kill: kill_every_s,
            self._cause: fault_every_s,
        }
        self._at_s: dict[Callable[[Laboratory], None], float] = {}
        self._faults = rng.permutation(len(FAULTS))
        self.kills = 0
        self.faults = 0

    def begin(self) -> None:
        """Draws when the first will come."""
        for kind in self._every_s:
            self._draw(kind)

    def come(self, lab: Laboratory) -> None:
        """Lets those happen whose time has come."""
        for kind, at_s in self._at_s.items():
            if time.monotonic() > at_s:
                time.sleep(float(self._rng.uniform(0.0, LOOK_S)))
                kind(lab)
                self._draw(kind)

    def _draw(self, kind: Callable[[Laboratory], None]) -> None:
        self._at_s[kind] = time.monotonic() + self._every_s[kind] * float(self._rng.uniform(0.5, 1.5))

    def _kill(self, lab: Laboratory) -> None:
        killed(lab.processes, KILLED[self.kills % len(KILLED)])
        self.kills += 1

    def _cause(self, lab: Laboratory) -> None:
        name, parameters = FAULTS[self._faults[self.faults % len(FAULTS)]]
        print(f"  fault: {name} {parameters or ''}", flush=True)
        simulator_client.request(HOST, "fault", name=name, **parameters)
        self.faults += 1
        time.sleep(LASTS_S)
        mended()


@dataclass(frozen=True)
class Worked:
    """A job that has ended, and how often it was resumed."""

    id: str
    resumed: int
    troubles: str


def worked(lab: Laboratory, count: int, troubles: Troubles | None) -> Worked:
    """Orders a job, and sees it through."""
    picks = [{"pose": {"position": PLACES[k % len(PLACES)], "rotation_vector": DOWN}} for k in range(count)]
    request = {"cell": CELL, "picks": picks, "targets": BINS, "policy": POLICY}
    id = lab.client.order_job(request)["id"]
    before = (troubles.kills, troubles.faults) if troubles else (0, 0)
    resumed = 0
    while True:
        time.sleep(LOOK_S)
        try:
            job = lab.client.get(f"/jobs/{id}")
            if job["state"] == "finished" and job["outcome"] == "stopped":
                print(f"  stopped: {job['reason']}", flush=True)
                mended()
                powered(lab)
                lab.acknowledge()
                opened()
                lab.client.post(f"/jobs/{id}/resume")
                resumed += 1
        except (fling.ServiceRefusal, OSError) as error:  # the service was killed and starts again, or not yet in order
            print(f"  {error}", flush=True)
            continue
        if job["state"] == "finished" and job["outcome"] != "stopped":
            after = (troubles.kills, troubles.faults) if troubles else (0, 0)
            return Worked(id, resumed, f"{after[0] - before[0]} kills, {after[1] - before[1]} faults")
        if troubles is not None and job["current"] is not None:
            troubles.come(lab)


def mended() -> None:
    """Removes the causes of faults as somebody beside the robot would."""
    causes: tuple[tuple[str, dict[str, Any]], ...] = (
        ("offline", {"on": False}),
        ("stall_connection", {"role": "any", "on": False}),
        ("clear", {}),
        ("speed_slider", {"fraction": 1.0}),
    )
    for name, parameters in causes:
        simulator_client.request(HOST, "fault", name=name, **parameters)


def powered(lab: Laboratory) -> None:
    """Gives the arm power and releases its brakes, where they are not."""
    if simulator_client.request(HOST, "state")["robot_mode"] == RUNNING:
        return
    for action in ("power_on", "brake_release"):
        answer = lab.client.post(f"/cells/{CELL}/robot", {"action": action})
        deadline = time.monotonic() + POWERED_S
        while answer["state"] == "waiting" and time.monotonic() < deadline:
            time.sleep(LOOK_S)
            answer = lab.client.get(f"/cells/{CELL}/state")["robot_request"]


def opened() -> None:
    """Opens the gripper, as an operator takes what it holds out."""
    with socket.create_connection((HOST, SECONDARY)) as pendant:
        pendant.sendall(b"sec empty():\n  set_tool_digital_out(0, True)\nend\n")
        time.sleep(LOOK_S)


def killed(parent: int, module: str) -> None:
    """Kills the child of a process that runs a module."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            line = (folder / "cmdline").read_bytes().split(b"\0")
            owner = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
        except OSError:
            continue
        if owner == parent and module.encode() in line:
            print(f"  {module} is killed", flush=True)
            os.kill(int(folder.name), signal.SIGKILL)


def told(lab: Laboratory, ended: Worked) -> str:
    """Returns what became of a job's objects, and what the odds of its plans were."""
    id = ended.id
    record = lab.client.get(f"/jobs/{id}")["record"]
    results = lab.client.job_results(id)
    seen = [each for each in results if each["result"] in ("hit", "miss")]
    plans = {each["plan_id"]: lab.client.get(f"/plans/{each['plan_id']}?trajectory=false") for each in seen}
    odds = [plan["hit_probability"]["value"] for plan in plans.values() if plan.get("hit_probability")]
    runs = [lab.client.get(f"/executions/{each['execution_id']}")["metrics"] for each in seen]
    truly = f"{np.mean([run['landed_on'] == 'bin' for run in runs]):.1%}" if runs else "–"
    share, interval = record["hit_share"], record["hit_interval"]
    rate = f"{record['cycles_per_hour']:.0f} cycles an hour, {record['cycle_time_s']:.2f} s a cycle"
    hits = f"{share:.1%} in the bin ({interval[0]:.1%} to {interval[1]:.1%})" if share is not None else "none seen"
    expected = f"{np.mean(odds):.1%}" if odds else "–"
    twice = len(seen) - len({each["execution_id"] for each in seen})
    without = [each["pick"] for each in results if each["object_at"] is None]
    hits = f"{hits}, truly {truly}, by the odds {expected}"
    what = f"{record['objects']}; {rate}; {hits}; {ended.troubles}, {ended.resumed} resumed"
    return f"{what}; {twice} executions of two objects, {len(without)} objects without a place"


if __name__ == "__main__":
    main()
