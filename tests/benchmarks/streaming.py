"""The streaming half of the benchmark: throws in a row, and our loop beside ur_rtde's documented one.

`python -m tests.benchmarks.streaming [--throws 100] [--runs 5] [--out FOLDER]`; `fling bench` runs it too.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from tests.benchmarks.loops import TRIES, compare
from tests.benchmarks.record import machine
from tests.benchmarks.throws import throws

ROOT = Path(__file__).parents[2]
BUSY = 2  # processes that spin beside the second series: one a core


def main() -> None:
    """Runs everything and writes `streaming.md`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--throws", type=int, default=100)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "benchmarks")
    options = parser.parse_args()
    (options.out / "streaming.md").write_text(report(options.throws, options.runs))
    print(f"wrote {options.out / 'streaming.md'}")


def report(count: int, runs: int) -> str:
    """Returns the report, measured now."""
    where = machine()
    with tempfile.TemporaryDirectory() as folder:
        quiet = throws(Path(folder) / "quiet", count, "speedj", 0)
        loops = compare(Path(folder) / "loops", runs)
        busy = _beside_busy_processes(Path(folder) / "busy", count)
    lines = [
        "# Streaming", "",
        f"{where['date']}, {where['processor']}, {where['system']}; load {where['load']}; commit {where['commit']}.",
        "ur5e-sim, a target throw, the simulator's own count of cycles without a fresh command; every run counts.",
        "Simulated controller and stream share one processor, the controller at the higher real-time priority: what",
        "the stream does never delays it, and every cycle it begins without a fresh command counts. Where this virtual",
        "machine itself stalls, both stand still; the controller then does not catch up, its clock *slips*",
        "(docs/simulator.md): a real controller is punctual. Slips are counted from start to end, approaches included.",
        "Release speed error: largest joint against the plan's speed. Taken by the host: time for which a processor of",
        "this virtual machine was ready to run and did not, both together (steal of /proc/stat).", "",
        f"## {count} throws in a row", "",
        "| beside | outcomes | cycles without a command | release speed error p50 / max | landing error p50 / max | "
        "slips, in all, longest | taken by the host |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        _throws_row("nothing", quiet), _throws_row(f"{BUSY} spinning processes", busy), "", *_reasons(quiet, busy),
        f"## Our loop and the plain one, worst of {runs} runs each", "",
        "Plain: `initPeriod; speedJ; waitPeriod` of ur_rtde's documentation, sending the same rows, the lag known. It",
        "goes by the wall clock, so a slip shifts it, which no real controller does: of",
        f"{TRIES * runs} runs of every loop those {runs} count during which the controller's clock slipped least.", "",
        "| loop | cycles without a command | tracking error [rad] | release speed error [rad/s] | landing error [m] "
        "| slipped [ms] |",
        "| --- | --- | --- | --- | --- | --- |",
        *(_loop_row(name, worst) for name, worst in loops.items()), "",
    ]  # fmt: skip
    return "\n".join(lines)


def _beside_busy_processes(folder: Path, count: int) -> dict[str, Any]:
    spinning = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(BUSY)]
    try:
        return throws(folder, count, "speedj", BUSY)
    finally:
        for process in spinning:
            process.kill()
            process.wait()


def _throws_row(beside: str, found: dict[str, Any]) -> str:
    outcomes = ", ".join(f"{count} {name}" for name, count in found["outcomes"].items())
    speed, landing = found["release_velocity_error_share"], found["landing_error_m"]
    cycles, slips = found["cycles"], found["slips"]
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
    """Returns why throws were not completed."""
    told = [f"{reason} ({count})" for found in series for reason, count in found["reasons"].items()]
    return [f"Not completed: {'; '.join(told)}.", ""] if told else []


def _loop_row(name: str, worst: dict[str, float]) -> str:
    return (
        f"| {name} | {worst['cycles_without_command']:.0f} | {worst['tracking_error_max_rad']:.4f} "
        f"| {worst['release_velocity_error_rad_s']:.4f} | {worst['landing_error_m']:.4f} "
        f"| {1e3 * worst['slipped_s']:.1f} |"
    )


def _percent(values: dict[str, float], key: str) -> str:
    return f"{100.0 * values[key]:.3f} %" if values else "–"


def _millimetres(values: dict[str, float], key: str) -> str:
    return f"{1000.0 * values[key]:.1f} mm" if values else "–"


if __name__ == "__main__":
    main()
