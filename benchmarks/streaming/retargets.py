"""Retargeting running throws: `python -m benchmarks.streaming.retargets [--calls 100] [--seed 0] [--per-run 3]`.

A service, an executor and a simulated controller as processes of their own, in real time. A throw that waits for some
seconds in a swing from side to side is given other targets at random instants. Times are from the call to the answer,
at which the stream has the new plan; the motion joins it a lead later. With `--hold-s 0` an ordinary throw of half a
second is retargeted instead.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.streaming.replacements import BUSY
from tests.system.rig import Rig
from tests.system.service import RigService

READY_S = 120.0  # [s] for a service to load its solvers
SWING_RAD = 0.35  # [rad] to each side of home
ASIDE = np.array([1.0, 0.3, -0.4, 0.3, 0.2, 0.5])  # of it, by joint
PERIOD_S = 0.8  # [s] of a swing
APART_S = (0.3, 1.2)  # [s] between two calls
TARGETS_M = ((0.9, 1.3), (-0.5, 0.5))  # [m] along x and y, on the floor


@dataclass
class RetargetTally:
    """What became of the calls."""

    answers: Counter[str] = field(default_factory=Counter)
    runs: Counter[str] = field(default_factory=Counter)
    taken_s: list[float] = field(default_factory=list)
    planned_s: list[float] = field(default_factory=list)
    ahead_s: list[float] = field(default_factory=list)
    missed: int = 0
    landed_off_m: list[float] = field(default_factory=list)

    def words(self) -> str:
        """Returns the result."""
        p50, p99 = 1e3 * np.percentile(self.taken_s or [np.nan], [50, 99])
        planned = 1e3 * float(np.median(self.planned_s or [np.nan]))
        ahead = 1e3 * float(np.median(self.ahead_s or [np.nan]))
        off = 1e3 * max(self.landed_off_m, default=np.nan)
        return (
            f"answers {dict(self.answers)}; runs {dict(self.runs)}; second attempts {self.missed}\n"
            f"call to swapped plan p50 {p50:.0f} ms, p99 {p99:.0f} ms, the search {planned:.0f} ms (p50)\n"
            f"the motion joins {ahead:.0f} ms after the call\n"
            f"{len(self.landed_off_m)} landings, at most {off:.1f} mm off the last target"
        )


def target(rng: np.random.Generator) -> dict[str, Any]:
    """Returns a release that hits a random place on the floor."""
    x, y = (float(rng.uniform(*each)) for each in TARGETS_M)
    return {"kind": "target", "position": [x, y, 0.0]}


def waiting_throw(rig: Rig, release: dict[str, Any], hold_s: float) -> dict[str, Any]:
    """Returns a request for a throw after a swing of about `hold_s` [s]."""
    passages = []
    for number in range(round(hold_s / PERIOD_S)):
        q = rig.cell.home + SWING_RAD * (-1.0) ** number * ASIDE
        state = {"kind": "joint", "positions": q.tolist(), "velocities": [0.0] * 6}
        passages.append({"name": str(number), "state": state, "not_before_s": PERIOD_S * (number + 1)})
    passages.append({"name": "throw", "state": release, "releases": True})
    return {"cell": "rig", "passages": passages}


def clock_s(rig: Rig, id: str) -> float:
    """Returns the motion's time of a run [s]; before its start negative."""
    told = rig.store.newest_event(id, "telemetry")
    begun = rig.row(id).state in ("streaming", "braking")
    return -1.0 if told is None or not begun else float(told.data["clock_s"])


def throw_once(
    rig: Rig, service: RigService, rng: np.random.Generator, tally: RetargetTally, calls: int, hold_s: float
) -> None:
    """Throws once, with some calls on the way."""
    last = target(rng)
    made = service.http.post("/plan", json=waiting_throw(rig, last, hold_s))
    if made.status_code != 201:
        tally.runs["not planned"] += 1
        return
    id = rig.queue_plan_when_ready(made.json()["id"])
    for _ in range(calls):
        due_s = clock_s(rig, id) + float(rng.uniform(*APART_S)) if hold_s else 0.0
        rig.until(lambda due_s=due_s: rig.row(id).state == "finished" or clock_s(rig, id) >= max(due_s, 0.0))
        if rig.row(id).state == "finished":
            break
        asked = target(rng)
        called_s = clock_s(rig, id)
        begun_s = time.monotonic()
        answer = service.http.post("/cells/rig/retarget", json={"release": asked})
        taken_s = time.monotonic() - begun_s
        if answer.status_code == 202:
            last = asked
            tally.answers["joined"] += 1
            tally.taken_s.append(taken_s)
            tally.planned_s.append(answer.json()["solver"]["solve_time_s"])
            tally.ahead_s.append(answer.json()["request"]["start"]["at_s"] - called_s)
        else:
            problem = answer.json()
            tally.answers[f"{problem['type']}: {problem['detail'][:60]}"] += 1
    row = rig.end(id)
    tally.missed += sum(each["reason"].startswith("tick passed") for each in row.replacements or ())
    tally.runs[str(row.outcome)] += 1
    if row.outcome == "completed" and row.metrics is not None:
        off = np.subtract(row.metrics["landing_point"], last["position"])
        tally.landed_off_m.append(float(np.linalg.norm(off)))
    elif row.outcome not in (*BUSY, "held"):
        print(row.outcome, row.reason)
    if rig.is_latched():
        rig.acknowledge()


def main() -> None:
    """Retargets until there were enough calls, and prints the result."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.streaming.retargets", description=__doc__)
    parser.add_argument("--calls", type=int, default=100)
    parser.add_argument("--per-run", type=int, default=3)
    parser.add_argument("--hold-s", type=float, default=4.0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    tally = RetargetTally()
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig(Path(folder))
        try:
            rig.start()
            with RigService(rig) as service:
                rig.until(lambda: service.http.get("/readyz").status_code == 200, READY_S)
                while sum(tally.answers.values()) < given.calls:
                    throw_once(rig, service, rng, tally, given.per_run, given.hold_s)
        finally:
            rig.stop()
    print(tally.words())


if __name__ == "__main__":
    main()
