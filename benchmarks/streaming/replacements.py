"""Replacing running motions: `python -m benchmarks.streaming.replacements [--swaps 500] [--refused 100] [--seed 0]`.

On a simulated controller of its own, in real time. A motion from side to side is replaced at random ticks by others,
three times a run, and between these by what must be refused: late, beside the motion, for another cell. The recording
tells whether every run followed what was taken, within the jerk limit, and no tick more. Runs that ended because this
machine lost ticks prove nothing, and are counted apart.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from planner.answer import plan_document
from planner.errors import Infeasible
from planner.planning import plan
from planner.request import problem_from_request
from planner.trajectory import Trajectory
from store import ExecutionRow, new_id
from tests.system.rig import Rig, rows_of

Vector = NDArray[np.float64]

SWAPS = 3  # of a run
LIMITS = {"velocity": 0.8, "acceleration": 6.0}
SPREAD_RAD = 0.35  # [rad] about home, of the states that are passed
AHEAD_S = (1.2, 1.6)  # [s] from a request to the tick at which its plan begins
LATE_S = 0.2  # [s] before a request, at which a plan begins that is too late
MOVING_S = 0.1  # [s] after a motion's start, which is at rest where it may rest again
ANSWERED_S = 20.0
FOLLOWED_RAD = 1e-6
OFF = 1e-4  # [rad, rad/s, rad/s^2] beside the motion
BUSY = ("late", "link_lost", "tracking", "executor_lost")  # how a run ends on a machine that is too busy
STOPPED = "the program on the controller is"  # by its watchdog: at constant speed commands cannot be told to be lost
OVER = ("the motion brakes", "the motion has ended", "does not stream")  # answers of a run that ends
WRONG = ("late", "position", "velocity", "acceleration", "other cell")


@dataclass
class ReplacementTally:
    """What became of the requests."""

    asked: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    answered_s: list[float] = field(default_factory=list)

    def words(self) -> str:
        """Returns the result."""
        times = np.array(self.answered_s or [np.nan])
        p50, most = np.percentile(times, [50, 100])
        return (
            f"{dict(self.asked)}; request to answer p50 {1e3 * p50:.0f} ms, most {1e3 * most:.0f} ms\n"
            f"{len(self.wrong)} wrong{''.join(f'{chr(10)}  {each}' for each in self.wrong)}"
        )


class Run:
    """One execution, and the plans that replace what it makes."""

    def __init__(self, rig: Rig, rng: np.random.Generator, tally: ReplacementTally) -> None:
        self.rig = rig
        self.rng = rng
        self.tally = tally
        self.pieces: list[tuple[float, Trajectory]] = []

    def made(self, start: dict[str, Any] | None = None, passages: int = 6) -> tuple[str, Trajectory]:
        """Plans and stores a motion through random states; returns its id and itself."""
        while True:
            with suppress(Infeasible):
                return self._made(start, passages)

    def _made(self, start: dict[str, Any] | None, passages: int) -> tuple[str, Trajectory]:
        home = self.rig.cell.home
        states = home + self.rng.uniform(-SPREAD_RAD, SPREAD_RAD, (passages, 6))
        states[:, 0] += SPREAD_RAD * (-1.0) ** np.arange(passages)
        asked = [
            {"name": str(i), "state": {"kind": "joint", "positions": q.tolist(), "velocities": [0.0] * 6}}
            for i, q in enumerate(states)
        ]
        request = {"cell": "rig", "passages": asked, "end": {"kind": "home"}, "limits": LIMITS}
        request |= {} if start is None else {"start": start}
        found = plan(problem_from_request(request, self.rig.cell))
        document = plan_document(found, request, new_id(), "2026-01-01T00:00:00Z")
        self.rig.add_plan(document)
        return document["id"], found.trajectory

    def state_at(self, at_s: float) -> tuple[float, dict[str, Any]]:
        """Returns the tick nearest to a time [s], and the start that the motion has there."""
        begins_s, motion = next(each for each in reversed(self.pieces) if each[0] <= at_s)
        tick = round((at_s - begins_s) * motion.sample_rate_hz)
        names = {"positions": motion.q, "velocities": motion.qd, "accelerations": motion.qdd}
        return begins_s + tick * motion.dt, {name: values[tick].tolist() for name, values in names.items()}

    def go(self, refusals: int) -> ExecutionRow:
        """Plans all of a run, then makes it with its replacements; returns its end."""
        first, motion = self.made()
        self.pieces = [(0.0, motion)]
        joins_s = 0.0
        planned = []
        for _ in range(SWAPS):
            joins_s, start = self.state_at(joins_s + float(self.rng.uniform(*AHEAD_S)))
            wrong = [self._wrong(joins_s, start) for _ in range(refusals)]
            plan_id, onward = self.made(start)
            planned.append((joins_s, plan_id, wrong))
            self.pieces.append((joins_s, onward))
        id = self.rig.queue_plan_when_ready(first)
        for number, (joins_s, plan_id, wrong) in enumerate(planned, 1):
            self._await(id, joins_s - AHEAD_S[0])
            for kind, wrong_id in wrong:
                self._ask(id, wrong_id, kind)
            if not self._ask(id, plan_id, "swap", joins_s):
                del self.pieces[number:]
                break
        return self.rig.end(id)

    def _wrong(self, joins_s: float, start: dict[str, Any]) -> tuple[str, str]:
        """Returns what is wrong with a plan that must be refused, and its id."""
        kind = WRONG[int(self.rng.integers(len(WRONG)))]
        if kind == "late":
            begins_s = next(each[0] for each in reversed(self.pieces) if each[0] < joins_s - AHEAD_S[0])
            return kind, self.made(self.state_at(max(begins_s + MOVING_S, joins_s - AHEAD_S[0] - LATE_S))[1], 2)[0]
        if kind == "other cell":
            plan_id, _ = self.made(start, 2)
            row = self.rig.store.plan(plan_id)
            assert row is not None
            document = {**orjson.loads(row.document), "id": new_id(), "cell_sha256": "0" * 64}
            self.rig.add_plan(document)
            return kind, document["id"]
        name = {"position": "positions", "velocity": "velocities", "acceleration": "accelerations"}[kind]
        return kind, self.made({**start, name: [x + OFF for x in start[name]]}, 2)[0]

    def _await(self, id: str, at_s: float) -> None:
        """Waits until the motion of a run has come to a time [s]."""

        def has_come() -> bool:
            row = self.rig.row(id)
            told = [each.data for each in self.rig.store.events(id) if each.kind == "telemetry"]
            return row.state == "finished" or (bool(told) and told[-1].get("clock_s", -1.0) >= at_s)

        self.rig.until(has_come)

    def _ask(self, id: str, plan_id: str, kind: str, joins_s: float | None = None) -> bool:
        """Asks for a replacement; returns whether the plan joins."""
        begun_s = time.monotonic()
        asked = self.rig.store.request_replacement(id, plan_id, "benchmark")
        if asked is None:
            self.tally.asked["run over"] += 1
            return False
        self.rig.until(lambda: self._answer(id, asked) is not None or self.rig.row(id).state == "finished", ANSWERED_S)
        found = self._answer(id, asked)
        if found is None or self.rig.row(id).outcome in BUSY or any(words in found["reason"] for words in OVER):
            self.tally.asked["run over"] += 1
            return False
        self.tally.answered_s.append(time.monotonic() - begun_s)
        joins = found["joins_s"] is not None
        if kind == "swap" and not joins and "passed" in found["reason"]:
            self.tally.asked["swap refused as late"] += 1
        elif joins != (kind == "swap") or (joins and abs(found["joins_s"] - (joins_s or 0.0)) > FOLLOWED_RAD):
            self.tally.wrong.append(f"{kind}: {found}")
        else:
            self.tally.asked[kind if kind == "swap" else f"refused: {kind}"] += 1
        return joins

    def _answer(self, id: str, asked: str) -> dict[str, Any] | None:
        return next((dict(each) for each in self.rig.row(id).replacements or () if each["id"] == asked), None)

    def check(self, row: ExecutionRow) -> None:
        """Notes where a run did not follow what was taken."""
        if row.outcome != "completed":
            print(f"run {row.id} ended as {row.outcome}: {row.reason}", flush=True)
        if row.outcome in BUSY or (row.reason or "").startswith(STOPPED):
            self.tally.asked[f"run ended as {row.outcome}"] += 1
            return
        recording = self.rig.store.recording(row.id)
        if row.outcome != "completed" or recording is None:
            self.tally.wrong.append(f"run ended as {row.outcome}: {row.reason}")
            return
        self.tally.asked["run followed"] += 1
        names, rows = rows_of(recording.csv)
        clock = rows[:, names.index("clock_s")]
        q = rows[:, [names.index(f"planned_q_{joint}_rad") for joint in range(6)]]
        expected = q.copy()
        for begins_s, motion in self.pieces:
            later = clock >= begins_s
            expected[later] = motion.at(clock[later] - begins_s)[0]
        off = float(np.abs(q - expected)[clock >= 0.0].max())
        if off > FOLLOWED_RAD:
            self.tally.wrong.append(f"run {row.id} was {off:.3g} rad off what was taken")
        for begins_s, motion in self.pieces[1:]:
            if (np.abs(motion.jerk[0]) > self.rig.cell.limits.jerk_max * (1.0 + FOLLOWED_RAD)).any():
                self.tally.wrong.append(f"run {row.id} joined at {begins_s:.3f} s beyond the jerk limit")


def main() -> None:
    """Replaces until there were enough, and prints the result."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.streaming.replacements", description=__doc__)
    parser.add_argument("--swaps", type=int, default=500)
    parser.add_argument("--refused", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=90.0, help="longest time")
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    tally = ReplacementTally()
    ends_s = time.monotonic() + 60.0 * given.minutes
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig(Path(folder))
        try:
            rig.start()
            while tally.asked["swap"] < given.swaps and time.monotonic() < ends_s:
                refused = sum(number for kind, number in tally.asked.items() if kind.startswith("refused"))
                run = Run(rig, rng, tally)
                run.check(run.go(int(refused < given.refused)))
                if rig.is_latched():
                    rig.acknowledge()
        finally:
            print(tally.words(), flush=True)
            rig.stop()


if __name__ == "__main__":
    main()
