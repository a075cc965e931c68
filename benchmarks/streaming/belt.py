"""Throws into bins on a belt: `python -m benchmarks.streaming.belt [--throws 50] [--lead-s 3] [--seed 0]`.

On a simulated controller of its own, in real time. A bin of 12 cm radius passes in front of the arm at 0.1 to 0.5 m/s,
to either side or aslant; it is seen once, exactly. Counts where the objects landed, and what was refused.
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


def request(rng: np.random.Generator, now_s: float, lead_s: float) -> dict[str, Any]:
    """Returns a request for a throw into a bin that passes, seen now, with its earliest start a lead from now [s]."""
    angle = float(rng.uniform(-SLANT_RAD, SLANT_RAD)) + rng.choice([0.5, -0.5]) * np.pi
    velocity = float(rng.uniform(*SPEEDS_M_S)) * np.array([np.cos(angle), np.sin(angle), 0.0])
    place = np.array([*(rng.uniform(*each) for each in PASSES_M), 0.0]) - (lead_s + 1.0) * velocity
    seen = {"position": place.tolist(), "velocity": velocity.tolist(), "observed_at_s": now_s}
    return {
        "cell": "rig",
        "release": {"kind": "target", **seen, "opening": BIN},
        "starts_not_before_s": now_s + lead_s,
    }


def throw_once(rig: Rig, asked: dict[str, Any], tally: Counter[str], errors_m: list[float]) -> None:
    """Throws into a bin, and notes what became of it."""
    try:
        found = plan(problem_from_request(asked, rig.cell))
    except PlannerError:
        tally["no plan"] += 1
        return
    document = plan_document(found, asked, new_id(), "2026-01-01T00:00:00Z")
    rig.add_plan(document)
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
                throw_once(rig, request(rng, rig.state()["t"], given.lead_s), tally, errors_m)
        finally:
            rig.stop()
    p50, most = 1e3 * np.percentile(errors_m or [np.nan], [50, 100])
    print(f"{dict(tally)}; {p50:.1f} mm from the planned place in the bin (p50), at most {most:.1f} mm")


if __name__ == "__main__":
    main()
