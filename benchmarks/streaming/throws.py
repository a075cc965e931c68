"""A series of throws: outcomes, missed cycles as the simulator counts them, release and landing errors.

`python -m benchmarks.streaming.throws --count 100 [--busy 2] [--apart]`; `--busy N` runs N busy processes beside it,
`--apart` runs the simulated controller on another processor than the stream.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.streaming.arms import IDEAL, MEASURED, simulator_options
from executor.doctor import stolen_s
from executor.robot import simulator_client
from tests.system.rig import LOB, Rig

BUSY_LOOP = "while True: pass"


def main() -> None:
    """Runs the series and prints one JSON document."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--busy", type=int, default=0, help="number of busy processes beside it")
    parser.add_argument("--mode", default="speedj", choices=["speedj", "servoj", "script"])
    parser.add_argument("--measured", action="store_true", help=f"{MEASURED}, instead of the {IDEAL}")
    parser.add_argument("--apart", action="store_true", help="simulator on another processor than the stream")
    options = parser.parse_args()
    busy = [subprocess.Popen([sys.executable, "-c", BUSY_LOOP]) for _ in range(options.busy)]
    try:
        with tempfile.TemporaryDirectory() as folder:
            arm = MEASURED if options.measured else IDEAL
            how = (options.mode, options.busy, options.apart, arm)
            print(json.dumps(throw_series(Path(folder), options.count, *how), indent=1))
    finally:
        for process in busy:
            process.kill()
            process.wait()


def throw_series(
    folder: Path, count: int, mode: str, busy: int, apart: bool = False, arm: str = IDEAL
) -> dict[str, Any]:
    """Returns the statistics of a series of throws.

    Args:
        folder: Folder for store and logs.
        count: Number of throws.
        mode: "speedj", "servoj" or "script".
        busy: Number of busy processes beside it, for the record.
        apart: Whether the simulator runs on another processor than the stream.
        arm: The arm that throws.
    """
    rig = Rig(folder)
    core = ["--core", str(min(os.sched_getaffinity(0)))] if apart else []
    rig.start_simulator(*core, *simulator_options(folder, arm))
    rig.start_executor()
    try:
        simulator_client.request(rig.host, "reset_stats")
        before = stolen_s()
        rows = []
        for _ in range(count):
            if rig.is_latched():
                rig.recover()
                rig.acknowledge()
            rows.append(rig.throw(LOB, mode))
        stats = simulator_client.request(rig.host, "stats")
        stolen = stolen_s() - before
    finally:
        rig.stop()
    return {
        "throws": count,
        "mode": mode,
        "arm": arm,
        "busy_processes": busy,
        "stolen_s": stolen,
        **_summary(rows, stats),
    }


def _summary(rows: list[Any], stats: dict[str, Any]) -> dict[str, Any]:
    cycles = stats["commands_per_cycle"]
    done = [row.metrics for row in rows if row.outcome == "completed"]
    total = cycles["none"] + cycles["one"] + cycles["more"]
    return {
        "outcomes": dict(Counter(row.outcome for row in rows)),
        "reasons": dict(Counter(row.reason for row in rows if row.reason)),
        "cycles": cycles,
        "cycles_without_command_share": cycles["none"] / max(total, 1),
        "slips": stats["slips"],
        "duration_s": stats["t"],
        "missed_ticks": sum(m["missed_ticks"] for m in done),
        "realtime": all(m["realtime"] for m in done),
        "release_velocity_error_share": _spread([m["release_velocity_error_share"] for m in done]),
        "landing_error_m": _spread([m["landing_error_m"] for m in done]),
        "tracking_error_max_rad": _spread([m["tracking_error_max_rad"] for m in done]),
        "period_max_s": _spread([m["period_max_s"] for m in done]),
    }


def _spread(values: list[float]) -> dict[str, float]:
    known = [v for v in values if v is not None]
    return {"median": float(np.median(known)), "max": float(np.max(known))} if known else {}


if __name__ == "__main__":
    main()
