"""Starts in motion: random boundary states as Ruckig's own tests draw them, scaled to arms, against Ruckig alone.

    python -m benchmarks.moving_starts --count 2000 --seed 0 [--resume]

Positions, speeds, accelerations and limits are drawn in the units of Ruckig's tests, whose largest limit is made each
joint's own; states in which the arm touches something are drawn again. Nothing is let go, and the acceleration in which
the state is passed is free, so that Ruckig's time to the same state with the acceleration drawn for it is what is to be
beaten. Rows stay on the disk; every plan is audited by foreign code.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from audit.judge import find_faults
from benchmarks.numbered import measured_rows, numbered_parser
from planner.backends import ruckig_otg
from planner.cell import Cell, parse_cell
from planner.certificate import Examination
from planner.errors import Infeasible, InvalidProblem, SolverFailed
from planner.geometry import body_model
from planner.passages import Passage
from planner.planning import SearchHints, plan
from planner.problem import JointRelease, ThrowProblem
from planner.robots import ROBOT_NAMES
from planner.seeds import Candidate

Vector = NDArray[np.float64]

# source: ruckig test/test-target.cpp, `random_3`: standard deviations, shares of values that are not zero, and limits
POSITION_STD = 4.0
SPEED_STD = 0.8
MOVING = {"qd0": 0.9, "qdd0": 0.8, "qd1": 0.7, "qdd1": 0.6}
LIMITS = (0.08, 16.0)
ARMS = ROBOT_NAMES[:9]
CELL = """
robot = "{arm}"
[tool]
tcp_position_m = [0.0, 0.0, 0.12]
mass_kg = 0.5
capsules = [{{ from_m = [0.0, 0.0, 0.0], to_m = [0.0, 0.0, 0.1], radius_m = 0.04 }}]
[link]
kind = "sim"
"""
TIME_LIMIT_S = 30.0
LATER = 1.05  # [-] of Ruckig's time: what no plan is to be later than
ROWS = Path(__file__).parents[1] / "build" / "benchmarks" / "moving_starts.jsonl"


def drawn_problem(number: int, seed: int) -> tuple[ThrowProblem, Vector]:
    """Returns a problem, and the acceleration (6,) [rad/s^2] that Ruckig's own test would end with."""
    cell = parse_cell(CELL.format(arm=ARMS[number % len(ARMS)]), "arm")
    rng = np.random.default_rng([seed, number])
    while True:
        drawn = _drawn(cell, rng)
        if drawn is not None:
            return drawn


def _drawn(cell: Cell, rng: np.random.Generator) -> tuple[ThrowProblem, Vector] | None:
    """Returns a problem; None where a state is beyond its limits by itself, or touches something."""
    own = cell.limits
    unit = LIMITS[1]
    q = cell.home + rng.normal(0.0, POSITION_STD, (2, 6)) / unit * own.qd_max
    dynamic = {name: rng.normal(0.0, SPEED_STD, 6) * (rng.random(6) < share) for name, share in MOVING.items()}
    most = [rng.uniform(*LIMITS, 6) for _ in range(3)]
    most[0] += np.abs(dynamic["qd1"])
    most[1] += np.abs(dynamic["qdd1"])
    shares = [np.minimum(each / unit, 1.0) for each in most]
    names = ("qd_max", "qdd_max", "jerk_max")
    limits = replace(own, **{name: share * getattr(own, name) for name, share in zip(names, shares, strict=True)})
    scaled = {name: x / unit * (own.qdd_max if "qdd" in name else own.qd_max) for name, x in dynamic.items()}
    state = JointRelease(q[1], scaled["qd1"])
    if body_model(cell).clearances(q).least.min() < 0.0:
        return None
    try:
        problem = ThrowProblem(
            cell,
            q[0],
            state,
            limits,
            start_qd=scaled["qd0"],
            start_qdd=scaled["qdd0"],
            passages=(Passage("state", state),),
            time_limit_s=TIME_LIMIT_S,
        )
    except InvalidProblem:
        return None
    return problem, scaled["qdd1"]


def measured(number: int, seed: int) -> dict[str, Any]:
    """Returns what became of a problem: times of both, or the refusal, and the faults that the audit finds."""
    problem, qdd = drawn_problem(number, seed)
    row: dict[str, Any] = {"number": number, **_ruckig_alone(problem, qdd)}
    try:
        made = plan(problem, SearchHints(offers_nearest=False))
    except (Infeasible, SolverFailed) as refusal:
        kind = "infeasible" if isinstance(refusal, Infeasible) else "failed"
        proven = any(each.proven for each in refusal.violations)
        return {**row, "result": "proven" if proven else kind, "why": str(refusal)}
    faults = [str(fault) for fault in find_faults(problem, made.trajectory)]
    return {
        **row,
        "result": "planned",
        "time_s": made.trajectory.release_time_s,
        "status": f"{made.backend}: {made.status}",
        "faults": faults,
    }


def _ruckig_alone(problem: ThrowProblem, qdd: Vector) -> dict[str, Any]:
    """Returns Ruckig's time to the state [s], None where it refuses; and which checks its motion on ticks fails."""
    assert isinstance(problem.release, JointRelease)
    state = (problem.release.q, problem.release.qd, qdd)
    time_s = ruckig_otg.least_leg_time(problem, problem.start_state, state)
    if not np.isfinite(time_s):
        return {"ruckig_s": None, "fails": []}
    candidate = Candidate(problem.release.q, problem.release.qd, 0.0, "state")
    try:
        alone = ruckig_otg.solve(problem, candidate)
    except SolverFailed as error:
        return {"ruckig_s": time_s, "fails": [str(error)]}
    return {"ruckig_s": time_s, "fails": [c.name for c in Examination(problem, alone.trajectory).failures]}


def tally(rows: list[dict[str, Any]]) -> str:
    """Returns the result of rows in words."""
    planned = [row for row in rows if row["result"] == "planned"]
    both = [row for row in planned if row["ruckig_s"]]
    ratios = np.array([row["time_s"] / row["ruckig_s"] for row in both])
    free = np.array([not row["fails"] for row in both], np.bool_)
    refused = [row for row in rows if row["result"] != "planned"]
    lost = [row for row in refused if row["ruckig_s"] and not row["fails"]]
    lines = [
        f"{len(planned)} of {len(rows)} planned; {sum(bool(row['faults']) for row in planned)} faulty by the audit",
        f"refused: {dict(Counter(row['result'] for row in refused))}; Ruckig's motion certifies in {len(lost)} of them",
        f"over Ruckig's time: {_quantiles(ratios)}; where its own motion certifies ({free.sum()}): "
        f"{_quantiles(ratios[free])}",
        *(f"  later: {both[i]['number']} {ratios[i]:.3f} {both[i]['status']}" for i in np.flatnonzero(ratios > LATER)),
        *(f"  {row['result']}: {row['number']} {row['why'][:160]}" for row in refused),
    ]
    return "\n".join(lines)


def _quantiles(ratios: Vector) -> str:
    if not len(ratios):
        return "none"
    return f"median {np.median(ratios):.4f}, most {ratios.max():.3f}, {int((ratios > LATER).sum())} over {LATER}"


def main() -> None:
    """Measures the problems that the rows lack, and prints the result."""
    parser = numbered_parser(__doc__, 2000, ROWS)
    given = parser.parse_args()
    print(tally(measured_rows(given, lambda number: measured(number, given.seed))))


if __name__ == "__main__":
    main()
