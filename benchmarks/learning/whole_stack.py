"""A hidden cell through the whole stack: service, executor and simulated controller, with the commands of the docs.

`python -m benchmarks.learning.whole_stack sitting --seed N` follows docs/learning.md on one fresh cell, with throws
before and after; `… grippers --cells 10` calibrates one hidden gripper after another. Both throw in real time. Landings
are scored by the truth; the calibration sees the camera's alone.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import secrets
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import fling
from planner.cell_folder import default_cells_folder

CELL = "ur5e-sim"
HOST = "127.0.40.21"
PORT = 8740
HIT_M = 0.05  # [m] of a throw that counts as a hit in the tables
TRIES = 4  # of a throw that a busy machine made late
RELEASES = {"soonest": {"release_window_s": 0.0}, "default": {}}
SHAPES = ("gaussian", "skewed", "quantised")
FLING = "from api.cli import main; main()"  # the command line, of the interpreter that runs this
UP_S = 300.0  # [s] until everything runs, on a busy machine
SEEN_S = 0.3  # [s] the executor's heartbeat comes four times a second
HEAD = (
    "| throws | | outcomes | median miss [mm] | p90 | within 5 cm | odds of that |",
    "|---|---|---|---|---|---|---|",
)
GRIPPERS_HEAD = (
    "| cell | truth: delay, jitter [ms] | found: delay ±, jitter [ms] | lead off [ms] | allowed |",
    "|---|---|---|---|---|",
)


@dataclass(frozen=True)
class HiddenTruth:
    """What a fresh cell truly is, apart from its cell file (lag 20 ms, delay 40 ms)."""

    lag_s: float
    delay_s: float
    jitter_s: float
    shape: str
    text: str


def drawn_truth(rng: np.random.Generator, disturbance: str = "none") -> HiddenTruth:
    """Returns a hidden cell: timing, gripper, release, object, base, arm and camera all differ from the cell file."""
    lag = 0.020 + rng.uniform(-0.008, 0.012)
    shape = str(rng.choice(SHAPES))
    delay = float(np.clip(0.040 + rng.normal(0.0, 0.020), 0.020, 0.120))
    jitter = rng.uniform(0.0005, 0.006)
    gain = (1.0 + rng.uniform(-0.03, 0.03) + rng.uniform(-0.01, 0.01, 6)).round(4).tolist()
    lines = [
        f"seed = {rng.integers(1_000_000)}",
        f"[timing]\nlag_s = {lag:.5f}\nfirst_order_s = {rng.uniform(0.0, 0.004):.5f}\ngain = {gain}",
        f'[gripper]\ndelay_s = {delay:.5f}\njitter_s = {jitter:.5f}\njitter_shape = "{shape}"',
        f"[release]\nspeed_factor = {rng.uniform(0.96, 1.04):.4f}",
        f"[object]\ndrag_coefficient = {rng.uniform(0.0, 0.4):.3f}",
        f'[arm]\ndisturbance = "{disturbance}"\novershoot = {rng.uniform(0.0, 0.02):.4f}',
        f"base_offset_m = {[*rng.uniform(-0.008, 0.008, 2).round(5).tolist(), 0.0]}",
        "[camera]\nstd_m = 0.003\noutlier_share = 0.05\noutlier_std_m = 0.2",
    ]
    return HiddenTruth(lag, delay, jitter, shape, "\n".join(lines) + "\n")


@contextmanager
def running_cell(
    truth: str, tables: str = "", host: str = HOST, port: int = PORT, gripper: str = ""
) -> Iterator[Laboratory]:
    """Starts everything for a fresh cell with a hidden truth, and more `tables` and `gripper` in its file; stops it."""
    with tempfile.TemporaryDirectory(prefix="fling-hidden-") as temporary:
        folder = Path(temporary)
        url = f"http://127.0.0.1:{port}"
        text = (default_cells_folder() / f"{CELL}.toml").read_text()
        text = text.replace("[gripper]\n", f"[gripper]\n{gripper}\n")
        (folder / f"{CELL}.toml").write_text(re.sub(r'host\s*=\s*"[^"]*"', f'host = "{host}"', text) + tables)
        (folder / "truth.toml").write_text(truth)
        database = f"sqlite:///{folder / 'fling.db'}"
        settings = {"FLING_DATABASE_URL": database, "FLING_CELLS": str(folder), "FLING_DATA": str(folder),
                    "FLING_DEFAULT_CELL": CELL, "FLING_PORT": str(port), "FLING_APPROACH_PACE": "2"}  # fmt: skip
        with _fling_up(settings, folder / "truth.toml", folder / "log.txt") as up, fling.Client(url) as client:
            yield Laboratory(client, url, up)


@contextmanager
def _fling_up(settings: dict[str, str], truth: Path, log: Path) -> Iterator[int]:
    """Runs `fling up` until the block ends; returns its process."""
    line = [sys.executable, "-P", "-c", FLING, "up", "--truth", str(truth), "--reveal"]
    with log.open("w") as out, subprocess.Popen(line, env={**os.environ, **settings}, stdout=out, stderr=out) as up:
        try:
            deadline = time.monotonic() + UP_S
            while "Fling is up" not in log.read_text():
                if up.poll() is not None or time.monotonic() > deadline:
                    raise RuntimeError(f"fling up does not start:\n{log.read_text()}")
                time.sleep(0.2)
            yield up.pid
        finally:
            up.send_signal(signal.SIGINT)


@dataclass(frozen=True)
class Laboratory:
    """A running cell, who works at it, and the process that runs its processes."""

    client: fling.Client
    url: str
    processes: int

    def command(self, *words: str) -> dict[str, Any]:
        """Runs a command of `fling` as the docs have it, once more where the machine was too busy."""
        line = [sys.executable, "-P", "-c", FLING, *words, "--json", "--url", self.url]
        for _ in range(TRIES):
            done = subprocess.run(line, capture_output=True, text=True, check=False)
            if done.returncode == 0:
                return dict(json.loads(done.stdout))
            print(f"  {' '.join(words)}: {done.stderr.strip().splitlines()[-1:]}", flush=True)
            self.acknowledge()
        raise RuntimeError(f"fling {' '.join(words)} fails: see above")

    def acknowledge(self) -> None:
        """Clears a fault that this machine, not the cell, has caused."""
        self.client.post(f"/cells/{CELL}/acknowledge")
        time.sleep(SEEN_S)

    def throw(self, target: list[float], release: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Plans and executes one throw; returns plan and execution."""
        request = {"release": {"kind": "target", "position": target}, **release}
        plan = dict(self.client.plan(request, trajectory=False).document)
        return plan, self.executed(plan)

    def executed(self, plan: dict[str, Any]) -> dict[str, Any]:
        """Executes a plan, and again where the machine was too busy; returns the execution."""
        done = self._executed(plan)
        for _ in range(TRIES - 1):
            if done["outcome"] in ("completed", "held"):
                break
            self.acknowledge()
            done = self._executed(plan)
        return done

    def _executed(self, plan: dict[str, Any]) -> dict[str, Any]:
        return self.client.finished(self.client.execute(plan["id"])["id"])


def thrown_row(lab: Laboratory, rng: np.random.Generator, kind: str, count: int, when: str) -> str:
    """Throws at `count` targets all around; returns a line of the table."""
    outcomes: Counter[str] = Counter()
    misses = []
    odds = []
    while sum(outcomes.values()) < count:
        distance = rng.uniform(1.0, 1.5)
        angle = rng.uniform(-np.pi, np.pi)
        target = [distance * np.cos(angle), distance * np.sin(angle), 0.0]
        try:
            plan, done = lab.throw(target, RELEASES[kind])
        except fling.ServiceRefusal:
            continue  # not every target can be thrown at
        outcomes[done["outcome"]] += 1
        point = (done["metrics"] or {}).get("landing_point")
        if point is not None:
            misses.append(float(np.hypot(point[0] - target[0], point[1] - target[1])))
            odds.append(_odds_of_5_cm(plan))
    words = ", ".join(f"{n} {name}" for name, n in outcomes.items())
    if not misses:
        return f"| {kind} | {when} | {words} | – | – | – | – |"
    p50, p90 = (1e3 * np.quantile(misses, q) for q in (0.5, 0.9))
    hits = sum(miss <= HIT_M for miss in misses)
    return f"| {kind} | {when} | {words} | {p50:.0f} | {p90:.0f} | {hits} of {len(misses)} | {np.mean(odds):.2f} |"


def _odds_of_5_cm(plan: dict[str, Any]) -> float:
    """Returns the odds of 5 cm by the plan's landing ellipse: the plan's own are of its tolerance."""
    rng = np.random.default_rng(0)
    ellipse = plan["landing_ellipse"]
    points = rng.multivariate_normal(ellipse["center"], ellipse["covariance_m2"], 4000)
    return float((np.linalg.norm(points - plan["request"]["release"]["position"][:2], axis=1) <= HIT_M).mean())


def sitting(seed: int, count: int, disturbance: str) -> str:
    """Returns the table of one sitting: throws, calibration as docs/learning.md has it, throws."""
    rng = np.random.default_rng(seed)
    truth = drawn_truth(rng, disturbance)
    lines = [*HEAD]
    with running_cell(truth.text) as lab:
        lines += _thrown_rows(lab, rng, count, "before")
        began = time.monotonic()
        lab.command("calibrate", "lag", "--cell", CELL, "--adopt")
        found = lab.command("calibrate", "gripper", "--cell", CELL, "--adopt")
        minutes = (time.monotonic() - began) / 60.0
        lines += _thrown_rows(lab, rng, count, "after")
    numbers = f"lag {_ms(truth.lag_s)} ms, found {_ms(found['lag_s'])}; {_gripper_text(truth, found)}"
    return "\n".join([*lines, "", f"Seed {seed}; {numbers}; calibrated in {minutes:.1f} minutes.", "", truth.text])


def _thrown_rows(lab: Laboratory, rng: np.random.Generator, count: int, when: str) -> list[str]:
    rows = [thrown_row(lab, rng, kind, (count + i) // 2, when) for i, kind in enumerate(RELEASES)]
    print("\n".join(rows), flush=True)
    return rows


def grippers(seed: int, cells: range, throws: int) -> str:
    """Returns delay and jitter of hidden grippers as `fling calibrate` finds them."""
    lines = [*GRIPPERS_HEAD]
    for i in cells:
        truth = drawn_truth(np.random.default_rng([seed, i]))
        with running_cell(truth.text) as lab:
            lab.command("calibrate", "lag", "--cell", CELL, "--adopt", "--throws", "2")
            found = lab.command("calibrate", "gripper", "--cell", CELL, "--throws", str(throws))
        true_lead = truth.lag_s + truth.delay_s
        lead = found["lag_s"] + found["delay_s"]
        off = abs(lead - true_lead)
        allowed = max(0.001, 2.0 * _jitter(truth) / throws**0.5)
        real = f"{_ms(truth.delay_s)}, {_ms(_jitter(truth))} {truth.shape}"
        lines.append(f"| {i} | {real} | {_found_text(found)} | {_ms(off)} | {_ms(allowed)} |")
        print(lines[-1], flush=True)
    return "\n".join(lines)


def _jitter(truth: HiddenTruth) -> float:
    """Returns the standard deviation of the real opening, that of 10 ms steps included [s]."""
    return float(np.hypot(truth.jitter_s, 0.010 / 12**0.5 if truth.shape == "quantised" else 0.0))


def _gripper_text(truth: HiddenTruth, found: dict[str, Any]) -> str:
    real = f"delay {_ms(truth.delay_s)}, jitter {_ms(_jitter(truth))} ms ({truth.shape})"
    return f"{real}, found {_found_text(found)}"


def _found_text(found: dict[str, Any]) -> str:
    return f"{_ms(found['delay_s'])} ± {_ms(found['delay_std_s'])}, {_ms(found['jitter_s'])}"


def _ms(time_s: float) -> str:
    return f"{1e3 * time_s:.1f}"


def main() -> None:
    """Runs one sitting, or a row of grippers."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.learning.whole_stack", description=__doc__)
    parser.add_argument("what", choices=["sitting", "grippers"])
    parser.add_argument("--seed", type=int, help="of the hidden cells; default: a random one")
    parser.add_argument("--throws", type=int, help="before and after a sitting (30); of a gripper's calibration (6)")
    parser.add_argument("--cells", type=int, default=10, help="grippers")
    parser.add_argument("--first", type=int, default=0, help="number of the first gripper")
    parser.add_argument("--measured-arm", action="store_true", help="a sitting on the arm as measured on a real UR5")
    options = parser.parse_args()
    seed = secrets.randbelow(1_000_000) if options.seed is None else options.seed
    print(f"seed {seed}", flush=True)
    if options.what == "sitting":
        print(sitting(seed, options.throws or 30, "ur5-measured" if options.measured_arm else "none"))
    else:
        print(grippers(seed, range(options.first, options.first + options.cells), options.throws or 6))


if __name__ == "__main__":
    main()
