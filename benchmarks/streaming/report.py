"""The report of the streaming part.

`python -m benchmarks.streaming [--throws 100] [--runs 5] [--out FOLDER]`; `python -m benchmarks` runs it too.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.results import machine, write_report
from benchmarks.streaming.arms import IDEAL, MEASURED
from benchmarks.streaming.bins import BinThrows, throw_into_bins
from benchmarks.streaming.loops import TRIES, compare_loops
from benchmarks.streaming.throws import throw_series

ROOT = Path(__file__).parents[2]
INTO_BINS = 30  # throws into bins behind walls
BUSY = 2  # busy processes beside the second series of throws: one per core

THROWS_HEAD = (
    "| arm, beside | outcomes | cycles without a command | release speed error p50 / max | landing error p50 / max | "
    "slips, in all, longest | taken by the host |",
    "| --- | --- | --- | --- | --- | --- | --- |",
)
LOOPS_HEAD = (
    "| loop | cycles without a command | tracking error [rad] | release speed error [rad/s] | landing error [m] "
    "| slipped [ms] |",
    "| --- | --- | --- | --- | --- | --- |",
)
METHOD = """\
Simulated controller and stream share one processor, the controller at the higher priority: every cycle that begins
without a fresh command counts. When the virtual machine stalls, the controller's clock *slips* (docs/simulator.md).
Release speed error: of the worst joint. Taken by the host: steal of /proc/stat, all processors together."""


def main() -> None:
    """Runs the streaming part and writes `streaming.md`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--throws", type=int, default=100)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "benchmarks")
    options = parser.parse_args()
    write_report(streaming_report(options.throws, options.runs), options.out, "streaming.md")
    print(f"wrote {options.out / 'streaming.md'}")


def streaming_report(count: int, runs: int) -> str:
    """Measures and returns the report.

    Args:
        count: Throws per series.
        runs: Runs per loop that count.
    """
    where = machine()
    with tempfile.TemporaryDirectory() as folder:
        quiet = throw_series(Path(folder) / "quiet", count, "speedj", 0)
        loops = compare_loops(Path(folder) / "loops", runs)
        busy = _beside_busy_processes(Path(folder) / "busy", count)
        measured = throw_series(Path(folder) / "measured", count, "speedj", 0, arm=MEASURED)
        bins = {arm: throw_into_bins(Path(folder) / f"bins-{arm}", INTO_BINS, arm=arm) for arm in (IDEAL, MEASURED)}
    lines = [
        "# Streaming",
        "",
        f"{where['date']}, {where['processor']}, {where['system']}; load {where['load']}; commit {where['commit']}.",
        "ur5e-sim, a target throw; cycles without a fresh command are counted by the simulator; every run counts.",
        METHOD,
        "",
        f"## {count} throws in a row",
        "",
        *THROWS_HEAD,
        _throws_row(f"{IDEAL}, nothing", quiet),
        _throws_row(f"{IDEAL}, {BUSY} busy processes", busy),
        _throws_row(f"{MEASURED}, nothing", measured),
        "",
        *_reasons(quiet, busy, measured),
        f"## Fling's loop and the plain one, {IDEAL}, worst of {runs} runs each",
        "",
        "Plain: `initPeriod; speedJ; waitPeriod` of ur_rtde's documentation, with the same commands and a known lag.",
        "It follows the wall clock, so a slip, which no real controller has, shifts it: of",
        f"{TRIES * runs} runs of every loop, the {runs} with the least slip count.",
        "",
        *LOOPS_HEAD,
        *(_loop_row(name, worst) for name, worst in loops.items()),
        "",
        *_bins_section(bins),
    ]
    return "\n".join(lines)


def _beside_busy_processes(folder: Path, count: int) -> dict[str, Any]:
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(BUSY)]
    try:
        return throw_series(folder, count, "speedj", BUSY)
    finally:
        for process in busy:
            process.kill()
            process.wait()


def _throws_row(beside: str, found: dict[str, Any]) -> str:
    outcomes = ", ".join(f"{count} {name}" for name, count in found["outcomes"].items())
    speed = found["release_velocity_error_share"]
    landing = found["landing_error_m"]
    cycles = found["cycles"]
    slips = found["slips"]
    total = sum(cycles[key] for key in ("none", "one", "more"))
    silent = f"{cycles['none']} of {total} ({found['cycles_without_command_share']:.1e})"
    return (
        f"| {beside} | {outcomes} | {silent} "
        f"| {_percent(speed, 'median')} / {_percent(speed, 'max')} "
        f"| {_millimetres(landing, 'median')} / {_millimetres(landing, 'max')} "
        f"| {slips['count']} in {found['duration_s']:.0f} s, {slips['total_s']:.2f} s, {1e3 * slips['max_s']:.1f} ms "
        f"| {found['stolen_s']:.1f} s |"
    )


def _reasons(*series: dict[str, Any]) -> list[str]:
    """Returns the reasons of throws that were not completed."""
    reasons = [f"{reason} ({count})" for found in series for reason, count in found["reasons"].items()]
    return [f"Not completed: {'; '.join(reasons)}.", ""] if reasons else []


def _loop_row(name: str, worst: dict[str, float]) -> str:
    return (
        f"| {name} | {worst['cycles_without_command']:.0f} | {worst['tracking_error_max_rad']:.4f} "
        f"| {worst['release_velocity_error_rad_s']:.4f} | {worst['landing_error_m']:.4f} "
        f"| {1e3 * worst['slipped_s']:.1f} |"
    )


def _bins_section(bins: dict[str, BinThrows]) -> list[str]:
    text = "The simulator stops the object at walls and bins; its gripper scatters by a third of the release window."
    return ["## Into bins behind walls", "", text, "", *(_bins_line(arm, found) for arm, found in bins.items()), ""]


def _bins_line(arm: str, found: BinThrows) -> str:
    landed = ", ".join(f"{count} {surface}" for surface, count in found.landed_on.most_common()) or "nothing"
    error = f"{1e3 * median(found.errors_m):.1f} / {1e3 * max(found.errors_m):.1f} mm" if found.errors_m else "–"
    return (
        f"* {arm}: **{found.inside} of {found.executed} lie inside**, {found.held} were held. Landed on: {landed}. "
        f"Distance from the planned landing point, p50 / max: {error}. Requests without a plan: {found.refused}."
    )


def _percent(values: dict[str, float], key: str) -> str:
    return f"{100.0 * values[key]:.3f} %" if values else "–"


def _millimetres(values: dict[str, float], key: str) -> str:
    return f"{1000.0 * values[key]:.1f} mm" if values else "–"
