"""Fling's loop beside the plain loop of ur_rtde's documentation, with the same plan and the same simulated arm.

`python -m benchmarks.streaming.loops [--count 5] [--busy 2]`. The plain loop is `initPeriod(); speedJ(...);
waitPeriod(t)`, with the trajectory indexed by count. It sends the same commands as Fling and opens the gripper with the
same one, so the arm's lag is accounted for; its own drift and its missed cycles remain. It runs as documented, and once
more with real-time priority, on the processor and at the priorities of Fling's loop.

When the machine stalls, the simulated controller's clock slips. Fling's loop follows the controller's timestamps; the
plain one follows the wall clock, so a slip, which no real controller has, shifts it. Therefore every loop runs `TRIES`
times as often as requested, and the runs with the least slip count.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from executor.realtime import default_core
from executor.robot import simulator_client
from planner.certificate import release_flight
from planner.flight import fly
from planner.planning import plan
from planner.problem import ThrowProblem
from planner.request import problem_from_request
from planner.stream_rows import sample_rows
from planner.trajectory import Trajectory
from tests.system.rig import LOB, ROOT, Rig
from tests.system.rig import rows_of as rows_of_csv

TRIES = 3  # runs for each one that counts
MEASURED = ("tracking_error_max_rad", "release_velocity_error_rad_s", "landing_error_m")  # of a run, in its metrics

PLAIN = """
import sys, json, os, time
job = json.load(sys.stdin)
if job["realtime"]:
    os.sched_setaffinity(0, {job["core"]})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(51))
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface
from rtde_io import RTDEIOInterface
dt = job["dt"]
receive = RTDEReceiveInterface(job["host"], 1.0 / dt)
control = RTDEControlInterface(job["host"], 1.0 / dt)
io = RTDEIOInterface(job["host"])
if job["realtime"]:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
io.setToolDigitalOut(0, False)
control.moveJ(job["start"], 1.0, 1.4)
found = []
for i, qd in enumerate(job["qd"]):
    t = control.initPeriod()
    control.speedJ(qd, 40.0, dt)
    if i == job["output_row"]:
        io.setToolDigitalOut(0, True)
    found.append((receive.getActualQ(), receive.getActualQd(), receive.getTimestamp(), time.monotonic()))
    control.waitPeriod(t)
control.speedStop(20.0)
control.stopScript()
print(json.dumps(found), flush=True)
os._exit(0)
"""


def main() -> None:
    """Streams with every loop and prints one JSON document."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=5)
    parser.add_argument("--busy", type=int, default=0, help="number of busy processes beside it")
    options = parser.parse_args()
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(options.busy)]
    try:
        with tempfile.TemporaryDirectory() as folder:
            print(json.dumps(compare_loops(Path(folder), options.count), indent=1))
    finally:
        for process in busy:
            process.kill()
            process.wait()


def compare_loops(folder: Path, count: int) -> dict[str, Any]:
    """Returns the worst values of each loop over the `count` runs with the least slip."""
    rig = Rig(folder)
    request = {"cell": "rig", "release": LOB, "backend": "ruckig", "release_window_s": 0.0, "time_limit_s": 30.0}
    problem = problem_from_request(request, rig.cell)
    trajectory = plan(problem).trajectory
    rig.start()
    try:
        runs = {
            "Fling": [_fling(rig) for _ in range(TRIES * count)],
            "plain": [_plain(rig, problem, trajectory, False) for _ in range(TRIES * count)],
            "plain, real-time": [_plain(rig, problem, trajectory, True) for _ in range(TRIES * count)],
        }
    finally:
        rig.stop()
    least = {name: sorted(found, key=lambda run: run["slipped_s"])[:count] for name, found in runs.items()}
    return {name: {key: max(run[key] for run in found) for key in found[0]} for name, found in least.items()}


def _fling(rig: Rig) -> dict[str, float]:
    """Returns the values of one throw by the executor; infinite if it is not completed."""
    if rig.is_latched():
        rig.recover()
        rig.acknowledge()
    simulator_client.request(rig.host, "reset_stats")
    row = rig.throw(LOB)
    recording = rig.store.recording(row.id)
    metrics = row.metrics or {}
    assert recording is not None
    names, numbers = rows_of_csv(recording.csv)
    timestamps, received = (numbers[:, names.index(name)] for name in ("timestamp_s", "host_s"))
    found = {"slipped_s": _slip(timestamps, received), "cycles_without_command": _silent_cycles(rig)}
    return found | {key: metrics[key] if row.outcome == "completed" else math.inf for key in MEASURED}


def _plain(rig: Rig, problem: ThrowProblem, trajectory: Trajectory, realtime: bool) -> dict[str, float]:
    """Returns the values of one throw by the plain loop."""
    rows = sample_rows(rig.cell, trajectory, throws=True)
    dt = trajectory.dt
    job = {
        "host": rig.host,
        "dt": dt,
        "start": trajectory.q[0].tolist(),
        "qd": rows.qd.tolist(),
        "output_row": rows.output_row,
        "realtime": realtime,
        "core": default_core({}),
    }
    before = len(rig.world()["releases"])
    simulator_client.request(rig.host, "reset_stats")
    answer = subprocess.run(
        [sys.executable, "-c", PLAIN], input=json.dumps(job), capture_output=True, text=True, check=True, cwd=ROOT
    )
    silent = _silent_cycles(rig)
    q, qd, timestamps, received = (np.array(x) for x in zip(*json.loads(answer.stdout.splitlines()[-1]), strict=True))
    clock = rows.first_clock_s + np.arange(len(q)) * dt - rig.cell.timing.lag_s  # measured just after row i was sent
    planned_q, planned_qd, _ = trajectory.at(clock)
    release = round((trajectory.release_time_s - clock[0]) / dt)
    rig.until(lambda: len(rig.world()["releases"]) > before)
    flown = rig.world()["releases"][-1]
    landed = fly(flown["position_m"], flown["velocity_m_s"], problem.plane_z, problem.gravity, problem.drag)
    planned = release_flight(problem, trajectory)
    assert landed is not None and planned is not None
    return {
        "slipped_s": _slip(timestamps, received),
        "cycles_without_command": silent,
        "tracking_error_max_rad": float(np.abs(q - planned_q).max()),
        "release_velocity_error_rad_s": float(np.abs(qd[release] - planned_qd[release]).max()),
        "landing_error_m": float(np.linalg.norm(landed.landing_point - planned.landing_point)),
    }


def _slip(timestamps: np.ndarray, received: np.ndarray) -> float:
    """Returns how far the controller's clock fell behind the wall clock over the recorded states [s]."""
    return float((received[-1] - received[0]) - (timestamps[-1] - timestamps[0]))


def _silent_cycles(rig: Rig) -> int:
    return int(simulator_client.request(rig.host, "stats")["commands_per_cycle"]["none"])


if __name__ == "__main__":
    main()
