"""Delay and jitter of hidden grippers from calibration throws: soonest ones, not all alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.learning.hidden_cells import HiddenCell, hidden_cell, throw
from benchmarks.learning.plans import PlannedThrow
from learning import ObservedThrow, ReleasePosterior, ThrowTable, learn_release, prior_state, throw_table

THROWS = 10
RESET_AFTER = (2, 6)  # throws after which the next ones are planned with what is known by then
ASSESSED_AFTER = (6, 10)
NO_SHIFT = np.zeros(2)
CAMERA_STD_M = 0.003
SPEED_VARIANCE = np.full(6, 0.005**2)  # [m], [rad^2/s^2]: what a user knows of the sensors
DRAWS = 2000  # states from which a quantile is taken


@dataclass(frozen=True)
class CalibrationResult:
    """One cell after n throws: errors of delay and jitter [s], the delay's tolerance [s], and whether 90 % cover."""

    throws: int
    delay_error_s: float
    jitter_error_s: float
    tolerance_s: float
    is_covered: bool
    score: float


def gripper_report(throws: list[PlannedThrow], seed: int, cells: int = 100) -> str:
    """Returns a table of the errors after 6 and 10 throws."""
    results = calibrated_cells(throws, seed, cells)
    lines = [f"Gripper: {cells} hidden cells, seed {seed}", ""]
    lines += [
        "| throws | delay within max(1 ms, 2 jitter/√n) | median, p90, largest error [ms] | jitter, rms error [ms] |"
    ]
    lines[-1] += " 90 % interval covers | error / std, rms |"
    lines += ["|---|---|---|---|---|---|"]
    for n in ASSESSED_AFTER:
        some = [result for result in results if result.throws == n]
        errors = 1e3 * np.abs([r.delay_error_s for r in some])
        within = np.mean([abs(r.delay_error_s) <= r.tolerance_s for r in some])
        jitter = 1e3 * np.sqrt(np.mean(np.square([r.jitter_error_s for r in some])))
        p50, p90, most = np.quantile(errors, (0.5, 0.9, 1.0))
        covered = np.mean([r.is_covered for r in some])
        score = np.sqrt(np.mean(np.square([r.score for r in some])))
        lines.append(
            f"| {n} | {within:.0%} | {p50:.2f}, {p90:.2f}, {most:.1f} | {jitter:.2f} | {covered:.0%} | {score:.2f} |"
        )
    return "\n".join(lines)


def calibrated_cells(throws: list[PlannedThrow], seed: int, cells: int) -> list[CalibrationResult]:
    """Returns the results of every cell: a tenth has a prior 80 ms off, not 20, another a camera of 20 % outliers."""
    soonest = [planned for planned in throws if planned.window_s == 0.0]
    tables = [throw_table(planned.problem, planned.trajectory) for planned in soonest]
    results = []
    for k in range(cells):
        rng = np.random.default_rng([seed, k])
        results += _calibrate(
            rng, hidden_cell(rng, off_s=0.080 if k % 10 == 0 else 0.020, poor=k % 10 == 1), soonest, tables
        )
    return results


def _calibrate(
    rng: np.random.Generator, cell: HiddenCell, soonest: list[PlannedThrow], tables: list[ThrowTable]
) -> list[CalibrationResult]:
    prior = prior_state(cell.assumed_delay_s, 0.0)
    lead = cell.assumed_delay_s
    seen: list[ObservedThrow] = []
    results = []
    for n in range(1, THROWS + 1):
        i = int(rng.integers(len(soonest)))
        true = throw(rng, cell, soonest[i], float(cell.openings(rng, 1)[0]) - lead, NO_SHIFT)
        table = tables[i].deviated(true.deviation)
        seen.append(ObservedThrow(table, lead, true.seen, CAMERA_STD_M, SPEED_VARIANCE))
        if n in (*RESET_AFTER, *ASSESSED_AFTER):
            posterior = learn_release(seen, prior)
            lead = float(posterior.state[0]) if n in RESET_AFTER else lead
            results += [_result(cell, posterior, n)] if n in ASSESSED_AFTER else []
    return results


def _result(cell: HiddenCell, posterior: ReleasePosterior, n: int) -> CalibrationResult:
    delay, jitter = cell.true_delay()
    error = float(posterior.state[0]) - delay
    low, high = np.quantile(posterior.drawn(np.random.default_rng(0), DRAWS)[0][:, 0], (0.05, 0.95))
    tolerance = max(0.001, 2.0 * jitter / np.sqrt(n))
    score = error / float(np.sqrt(posterior.state_covariance[0, 0]))
    return CalibrationResult(n, error, posterior.jitter - jitter, tolerance, bool(low <= delay <= high), score)
