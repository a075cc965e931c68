"""A shift of picks and throws: `python -m benchmarks.streaming.shift [--learn 40] [--count 200] [--kill-every-s 600]`.

A service, an executor and a simulated controller with a hidden truth, in real time. Objects lie on six places of a
feeder, each displaced at random, and are filled up again; some grips take nothing, as an input shows. They are thrown
into two bins in turn. A first job of `--learn` objects is what the cell learns from, by the landings that its camera
sees; then comes the shift. Every `--kill-every-s` the executor or the service is killed at a random instant of a
motion; where that stops the job, it is acknowledged and resumed, as an operator would. Told: cycles an hour, objects by
what became of them, the share in the bin as the camera saw it, with its interval, the share that truly lies in it (one
report of the camera in twenty is mistaken), and beside both the odds that the plans gave.
"""

from __future__ import annotations

import argparse
import os
import signal
import socket
import time
from pathlib import Path

import numpy as np

import fling
from benchmarks.learning.whole_stack import CELL, Laboratory, drawn_truth, running_cell

HOST = "127.0.62.31"
PORT = 8763
DOWN = [float(np.pi), 0.0, 0.0]
HEIGHT_M = 0.1  # of the tool centre point at a pick
PLACES = [[x, y, HEIGHT_M] for x in (0.42, 0.5) for y in (0.1, 0.2, 0.3)]
FEEDER = f"""
[feeder]
places = {PLACES}
reach_m = 0.02
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


def main() -> None:
    """Runs the shift, and prints what came of it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.streaming.shift", description=__doc__)
    parser.add_argument("--learn", type=int, default=40, help="objects of the job that the cell learns from")
    parser.add_argument("--count", type=int, default=200, help="objects of the shift")
    parser.add_argument("--kill-every-s", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    truth = drawn_truth(rng, "ur5-measured").text + FEEDER
    with running_cell(truth, host=HOST, port=PORT, gripper=GRIP) as lab:
        lab.command("calibrate", "lag", "--cell", CELL, "--adopt")
        if given.learn:
            print("learning:", told(lab, worked(lab, given.learn, np.inf, rng)), flush=True)
            lab.command("calibrate", "landings", "--cell", CELL, "--adopt")
        print("the shift:", told(lab, worked(lab, given.count, given.kill_every_s, rng)))


def worked(lab: Laboratory, count: int, kill_every_s: float, rng: np.random.Generator) -> tuple[str, int, int]:
    """Orders a job and sees it through; returns its id, and the number of kills and of resumptions."""
    picks = [{"pose": {"position": PLACES[k % len(PLACES)], "rotation_vector": DOWN}} for k in range(count)]
    request = {"cell": CELL, "picks": picks, "targets": BINS, "policy": POLICY}
    id = lab.client.order_job(request)["id"]
    kills = resumed = 0
    next_kill = time.monotonic() + kill_every_s * float(rng.uniform(0.5, 1.5))
    while True:
        time.sleep(LOOK_S)
        try:
            job = lab.client.get(f"/jobs/{id}")
            if job["state"] == "finished" and job["outcome"] == "stopped":
                print(f"  stopped: {job['reason']}", flush=True)
                lab.acknowledge()
                opened()
                lab.client.post(f"/jobs/{id}/resume")
                resumed += 1
        except (fling.ServiceRefusal, OSError):  # the service was killed, and starts again
            continue
        if job["state"] == "finished" and job["outcome"] != "stopped":
            return id, kills, resumed
        if time.monotonic() > next_kill and job["current"] is not None:
            killed(lab.processes, KILLED[kills % len(KILLED)])
            kills += 1
            next_kill = time.monotonic() + kill_every_s * float(rng.uniform(0.5, 1.5))


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


def told(lab: Laboratory, ended: tuple[str, int, int]) -> str:
    """Returns what became of a job's objects, and what the odds of its plans were."""
    id, kills, resumed = ended
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
    what = f"{record['objects']}; {rate}; {hits}; {kills} kills, {resumed} resumed"
    return f"{what}; {twice} executions of two objects, {len(without)} objects without a place"


if __name__ == "__main__":
    main()
