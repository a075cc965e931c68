"""Throws into bins on a belt: `python -m benchmarks.streaming.belt [--throws 50] [--lead-s 3] [--passing] [--seed 0]`.

On a simulated controller of its own, in real time. A bin of 12 cm radius passes in front of the arm at 0.1 to 0.5 m/s,
to either side or aslant; it is seen once, exactly. With `--passing` a camera is triggered in passing before the throw,
at a state that is drawn, and the arm goes home after it. Counts where the objects landed, and what was refused.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from planner.answer import plan_document
from planner.errors import PlannerError
from planner.planning import plan
from planner.request import problem_from_request
from store import new_id
from tests.system.rig import Rig

BIN = {"radius_m": 0.12, "rim_height_m": 0.15}
SPEEDS_M_S = (0.1, 0.5)
SLANT_RAD = 0.5  # [rad] of the belt against the arm's side
PASSES_M = ((0.9, 1.3), (-0.3, 0.3))  # [m] along x and y, a second after the earliest start
PASSING_S = 1.0  # [s] by which a passage before the throw has it later, about
CAMERA_M = ((0.4, 0.6), (-0.3, 0.3), (0.4, 0.6))  # [m] of the passage along x, y and z
CAMERA_M_S = 0.5  # [m/s] at most, to any side
PULSE_S = 0.03  # [s] of the camera's trigger
WAITS_S = 7.0  # [s] before its start, at which a plan is executed at the soonest: an arm waits for less than 10


def request(rng: np.random.Generator, now_s: float, lead_s: float, is_passing: bool = False) -> dict[str, Any]:
    """Returns a request for a throw into a bin that passes, seen now, with its earliest start a lead from now [s]."""
    angle = float(rng.uniform(-SLANT_RAD, SLANT_RAD)) + rng.choice([0.5, -0.5]) * np.pi
    velocity = float(rng.uniform(*SPEEDS_M_S)) * np.array([np.cos(angle), np.sin(angle), 0.0])
    passes_s = lead_s + 1.0 + PASSING_S * is_passing
    place = np.array([*(rng.uniform(*each) for each in PASSES_M), 0.0]) - passes_s * velocity
    seen = {"position": place.tolist(), "velocity": velocity.tolist(), "observed_at_s": now_s}
    release = {"kind": "target", **seen, "opening": BIN}
    asked = _passing(rng, release) if is_passing else {"release": release}
    return {"cell": "rig", **asked, "starts_not_before_s": now_s + lead_s}


def _passing(rng: np.random.Generator, release: dict[str, Any]) -> dict[str, Any]:
    """Returns the motion of a request that passes a camera before it throws, and ends at home."""
    place = [float(rng.uniform(*each)) for each in CAMERA_M]
    sideways = rng.normal(size=3)
    velocity = float(rng.uniform(0.1, CAMERA_M_S)) * sideways / np.linalg.norm(sideways)
    camera = {
        "name": "camera",
        "state": {"kind": "point", "position": place, "velocity": velocity.tolist()},
        "outputs": [
            {"output": "standard_digital", "index": 5, "level": i == 0, "offset_s": PULSE_S * i} for i in range(2)
        ],
    }
    throw = {"name": "throw", "state": release, "releases": True}
    return {"passages": [camera, throw], "end": {"kind": "home"}}


def throw_once(rig: Rig, asked: dict[str, Any], tally: Counter[str], errors_m: list[float]) -> None:
    """Throws into a bin, and notes what became of it."""
    try:
        found = plan(problem_from_request(asked, rig.cell))
    except PlannerError as refused:
        tally["no plan"] += 1
        print(refused, flush=True)
        return
    document = plan_document(found, asked, new_id(), "2026-01-01T00:00:00Z")
    rig.add_plan(document)
    rig.until(lambda: rig.state()["t"] > document["starts_at_s"] - WAITS_S)
    row = rig.end(rig.queue_plan(document["id"]))
    numbers = row.metrics or {}
    if row.outcome == "completed" and numbers.get("landing_error_m") is not None:
        tally[f"landed on {numbers['landed_on']}"] += 1
        errors_m.append(numbers["landing_error_m"])
    else:
        tally[f"{row.outcome}: {(row.reason or '')[:40]}"] += 1
    if rig.is_latched():
        rig.acknowledge()


def main() -> None:
    """Throws, and prints the result."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.streaming.belt", description=__doc__)
    parser.add_argument("--throws", type=int, default=50)
    parser.add_argument("--lead-s", type=float, default=3.0)
    parser.add_argument("--passing", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    tally: Counter[str] = Counter()
    errors_m: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig(Path(folder))
        try:
            rig.start()
            for _ in range(given.throws):
                rig.throw_when_ready()  # to near the start
                throw_once(rig, request(rng, rig.state()["t"], given.lead_s, given.passing), tally, errors_m)
        finally:
            rig.stop()
    p50, most = 1e3 * np.percentile(errors_m or [np.nan], [50, 100])
    print(f"{dict(tally)}; {p50:.1f} mm from the planned place in the bin (p50), at most {most:.1f} mm")


if __name__ == "__main__":
    main()
