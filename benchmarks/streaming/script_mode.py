"""Script mode beside streaming: `python -m benchmarks.streaming.script_mode [--count 50] [--out FOLDER]`.

The same throw so many times in each mode: on a machine that is left alone, beside four busy processes, and through a
link that loses packages and delays everything by a jitter. Writes `script-mode.md`.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.markdown import markdown_table
from benchmarks.results import machine, machine_words, write_report
from tests.system.rig import LOB, Rig

ROOT = Path(__file__).parents[2]
MODES = ("speedj", "script")
ALIKE_M = 1e-3  # [m] from where the first streamed throw landed
BUSY = 4  # processes
LATCHED_S = 0.6  # [s] until a fault is published: a heartbeat comes four times a second
LINK = {"jitter_s": 0.02, "drop": 0.05}
HEAD = ("conditions", "mode", "landed within 1 mm", "missed", "stopped", "refused", "furthest", "outcomes")
METHOD = f"""\
The same throw of `ur5e-sim`, each with its approach. Landed within 1 mm of where a streamed throw lands on a machine
that is left alone; missed: it left, and landed elsewhere; stopped: it did not leave as planned. The link loses
{100 * LINK["drop"]:.0f} % of the RTDE packages and delays everything on every connection by up to
{1e3 * LINK["jitter_s"]:.0f} ms."""


def main(argv: Sequence[str] | None = None) -> None:
    """Runs the table and writes it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.streaming.script_mode", description=__doc__)
    parser.add_argument("--count", type=int, default=50, help="throws in each row")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "benchmarks")
    given = parser.parse_args(argv)
    where = machine_words(machine())
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig(Path(folder))
        try:
            rig.start()
            rows = _rows(rig, given.count)
        finally:
            rig.stop()
    lines = ["# Script mode and streaming", "", where, "", METHOD, "", *markdown_table(HEAD, rows)]
    write_report("\n".join(lines) + "\n", given.out, "script-mode.md")


def _rows(rig: Rig, count: int) -> list[list[str]]:
    reference = np.array((rig.quiet_throw(LOB).metrics or {})["landing_point"])
    found = []
    for name, conditions in (("left alone", _alone), ("four busy processes", _busy), ("loss and jitter", _bad_link)):
        for mode in MODES:
            with conditions(rig):
                runs = [_thrown(rig, mode) for _ in range(count)]
            rig.recover()
            found.append([name, mode, *_counted(runs, reference)])
            print(*found[-1], flush=True)
    return found


def _thrown(rig: Rig, mode: str) -> Any:
    """Throws once; a fault that it latches is acknowledged."""
    row = rig.throw(LOB, mode)
    if row.outcome != "completed":
        time.sleep(LATCHED_S)
        rig.acknowledge()
    return row


def _counted(runs: Sequence[Any], reference: np.ndarray) -> list[str]:
    landed = [
        np.linalg.norm(np.subtract(run.metrics["landing_point"], reference))
        for run in runs
        if run.metrics is not None and run.metrics["landing_point"] is not None
    ]
    alike = sum(error < ALIKE_M for error in landed)
    refused = sum(run.outcome == "refused" for run in runs)
    furthest = f"{1e3 * max(landed):.2f} mm" if landed else ""
    counts = (alike, len(landed) - alike, len(runs) - len(landed) - refused, refused)
    outcomes = ", ".join(f"{n} {outcome}" for outcome, n in Counter(run.outcome for run in runs).most_common())
    return [*map(str, counts), furthest, outcomes]


@contextmanager
def _alone(rig: Rig) -> Iterator[None]:
    yield


@contextmanager
def _busy(rig: Rig) -> Iterator[None]:
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(BUSY)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


@contextmanager
def _bad_link(rig: Rig) -> Iterator[None]:
    rig.fault("disturb_connection", role="every", **LINK)
    yield


if __name__ == "__main__":
    main()
