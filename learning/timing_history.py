"""Timing over many runs: the pooled estimate, and whether it differs from what the cell file says."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from learning.recordings import JOINTS
from learning.timing import weighted_mean
from planner.cell import Cell, CellSource, cell_of
from planner.errors import CellError
from store import ExecutionRow, Store

SIGNIFICANT = 3.0  # [-] standard errors that a change must exceed: 3 in 1,000 runs by chance
# [s] scatter of the lag from run to run; source: 25 throws of one session of a real UR5, 0.3 to 0.4 ms
RUN_STD_S = 0.0004
# [s] a difference below is not worth a change: the arm's speed at the release is then off by 0.015 rad/s at most
LAG_TOLERANCE_S = 0.001
POOLED_RUNS = 50  # newest runs that are pooled: an arm changes, by service or by its load
JOINT_NUMBERS = ("gain", "first_order_s", "overshoot", "joint_lag_s")


@dataclass(frozen=True)
class PooledTiming:
    """Timing of an arm over several runs.

    Attributes:
        lag_s, lag_std_s: lag and its standard error [s].
        joints: by name (`gain`, `gain_std`, …) a list of six, with None where no run shows it.
        runs: how many.
    """

    lag_s: float
    lag_std_s: float
    joints: Mapping[str, list[float | None]]
    runs: int

    def as_document(self) -> dict[str, Any]:
        """Returns the pooled timing as JSON."""
        return {"lag_s": self.lag_s, "lag_std_s": self.lag_std_s, **self.joints, "runs": self.runs}


def pool_timing(runs: Sequence[Mapping[str, Any]]) -> PooledTiming | None:
    """Returns the pooled timing of runs, each as of `TimingEstimate.as_document`, newest first; None without any."""
    newest = list(runs)[:POOLED_RUNS]
    if not newest:
        return None
    lag = weighted_mean([run["lag_s"] for run in newest], [math.hypot(run["lag_std_s"], RUN_STD_S) for run in newest])
    joints: dict[str, list[float | None]] = {}
    for name in JOINT_NUMBERS:
        std = name.removesuffix("_s") + "_std_s" if name.endswith("_s") else f"{name}_std"
        pooled = [_known_mean([r[name][j] for r in newest], [r[std][j] for r in newest]) for j in range(JOINTS)]
        joints[name] = [None if x is None else x[0] for x in pooled]
        joints[std] = [None if x is None else x[1] for x in pooled]
    return PooledTiming(*lag, joints, len(newest))


def timing_runs(store: Store, cell: Cell) -> list[tuple[ExecutionRow, dict[str, Any]]]:
    """Returns the executions whose recordings show the timing of a cell's arm, newest first, with that timing.

    A run measures the arm against its commands, whatever its plan assumed: runs under other versions of the cell file
    count, unless that version describes another arm.
    """
    rows = [(row, (row.metrics or {}).get("timing")) for row in store.executions_of_cell(cell.name)]
    shown = [(row, dict(timing)) for row, timing in rows if timing is not None]
    others = _versions_with_another_arm(store, cell)
    if not others:
        return shown
    made_for = store.cell_hashes_of_plans({row.plan_id for row, _ in shown})
    return [(row, timing) for row, timing in shown if made_for.get(row.plan_id) not in others]


def _versions_with_another_arm(store: Store, cell: Cell) -> set[str]:
    """Returns the hashes of the versions of a cell's files that describe another arm than this one."""
    found = set()
    for version in store.cell_versions(cell.name):
        if version.sha256 != cell.sha256:
            try:
                then = cell_of(CellSource(cell.name, version.text, version.calibration, version.meshes))
            except CellError:
                continue  # of an earlier version of Fling: nothing says that the arm was another
            if not _same_arm(cell, then):
                found.add(version.sha256)
    return found


def _same_arm(a: Cell, b: Cell) -> bool:
    """Returns whether two versions describe one arm: model, controller, tool mass, and calibration if both have one."""
    hashes = {file.hash for file in (a.calibration, b.calibration) if file is not None}
    is_simulated_alike = a.link.kind != "sim" or (a.sim.lag_s, a.sim.polyscope) == (b.sim.lag_s, b.sim.polyscope)
    alike = (a.robot.name, a.link, a.tool.mass_kg) == (b.robot.name, b.link, b.tool.mass_kg)
    return alike and is_simulated_alike and len(hashes) <= 1


def pooled_document(runs: Sequence[Mapping[str, Any]], assumed_s: float) -> dict[str, Any] | None:
    """Returns the pooled timing of the runs in the newest one's mode, and what it advises; None without any.

    Args:
        runs: timings, newest first.
        assumed_s: lag that plans are streamed with [s].
    """
    pooled = pool_timing([run for run in runs if run["mode"] == runs[0]["mode"]])
    if pooled is None:
        return None
    change = lag_change(pooled.lag_s, pooled.lag_std_s, assumed_s)
    advice = None if change is None else lag_advice(pooled.lag_s, pooled.lag_std_s, assumed_s)
    return {**pooled.as_document(), "mode": runs[0]["mode"], "lag_change_s": change, "advice": advice}


def lag_change(lag_s: float, lag_std_s: float, assumed_s: float) -> float | None:
    """Returns by how much a measured lag differs from the assumed one [s]; None where that is not significant."""
    change = lag_s - assumed_s
    return change if abs(change) > max(LAG_TOLERANCE_S, SIGNIFICANT * math.hypot(lag_std_s, RUN_STD_S)) else None


def lag_advice(lag_s: float, lag_std_s: float, assumed_s: float) -> str:
    """Returns in words that a measured lag differs from the assumed one, and what to do."""
    measured = f"the arm's lag is {1e3 * lag_s:.1f} ± {1e3 * lag_std_s:.1f} ms"
    return f"{measured}, plans assume {1e3 * assumed_s:.1f} ms: adopt a new profile, or set timing.lag_s to {lag_s:.4f}"


def _known_mean(values: Sequence[float | None], stds: Sequence[float | None]) -> tuple[float, float] | None:
    """Returns mean and standard error over the values that are known; None without any."""
    known = [(v, s) for v, s in zip(values, stds, strict=True) if v is not None and s is not None]
    return weighted_mean(*zip(*known, strict=True)) if known else None
