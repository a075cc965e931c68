"""Random motions of 2 to 10 passages, feasible by construction, with boxes around.

    python -m benchmarks.passages --count 300 [--first 0] [--seed 0] [--audited 1] [--resume]

A motion is made first: random joint states and lines, joined by Ruckig with one share of the limits on acceleration and
jerk, the largest with which the whole is certified. What it passes is then asked for, as joint states, tool poses with
a twist, points with a velocity, and lines. So a motion is known for each, on branches that the request does not tell.
Rows stay on the disk; every plan, or one of so many, is audited by foreign code.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.numbered import measured_rows, numbered_parser
from planner.backends import ruckig_otg
from planner.cell import Cell, load_cell
from planner.certificate import Examination
from planner.errors import Infeasible, InvalidProblem, SolverFailed
from planner.geometry import body_model, tool_state
from planner.passages import Passage
from planner.planning import SearchHints, plan
from planner.problem import ThrowProblem
from planner.releases import JointRelease, PointRelease, PoseRelease, Release, SteadyLine
from planner.rotations import pose, rotation_vector_to_matrix
from planner.search import line_motions
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]
State = tuple[Vector, Vector, Vector]

CELLS = Path(__file__).parents[1] / "cells"
ARMS = ("ur3e-sim", "ur5e-sim", "ur10e-sim")
PASSAGES = (2, 10)
BOXES = (0, 4)
BOX_M = (0.05, 0.3)  # [m] sides of a box
STEP_RAD = 0.8  # [rad] of a joint from one passage to the next, at most
SPEED_SHARE = 0.4  # [-] of the joints' limits, at most
LINE_M = (0.05, 0.4)  # [m] lengths of lines
LINE_M_S = (0.05, 0.6)  # [m/s] their speeds
TURN_RAD = 0.5  # [rad] of the tool along a line, at most
LINES = {"states": 0.0, "lines": 1.0, "mixed": 0.4}  # [-] share of lines in a motion
PACES = (1.0, 0.7, 0.5, 0.3)  # [-] of the known motion, the largest that is certified
TRIES = 40  # [-] for one passage, before the motion is begun again
ROWS = Path(__file__).parents[1] / "build" / "benchmarks" / "passages.jsonl"


class Drawing:
    """One draw of a cell and of a motion in it."""

    def __init__(self, number: int, seed: int) -> None:
        """Takes the number of the motion: it decides about arm and mixture."""
        self.rng = np.random.default_rng([seed, number])
        self.mixture = tuple(LINES)[number // len(ARMS) % len(LINES)]
        self.cell = self._with_boxes(load_cell(CELLS / f"{ARMS[number % len(ARMS)]}.toml"))

    def _with_boxes(self, cell: Cell) -> Cell:
        """Returns the cell with boxes about the arm, none of which its home touches."""
        reach = abs(cell.robot.a[1]) + abs(cell.robot.a[2])
        count = int(self.rng.integers(BOXES[0], BOXES[1] + 1))
        boxes: list[dict[str, list[float]]] = []
        while len(boxes) < count:
            middle = self.rng.uniform([-1.2, -1.2, 0.0], [1.2, 1.2, 1.2]) * reach
            sides = self.rng.uniform(*BOX_M, 3)
            more = [*boxes, {"lower_m": (middle - sides / 2).tolist(), "upper_m": (middle + sides / 2).tolist()}]
            around = cell.with_obstacles(*more)
            if body_model(around).clearances(cell.home[None]).least[0] >= 0.0:
                boxes = more
        return cell.with_obstacles(*boxes) if boxes else cell

    def motion(self) -> tuple[ThrowProblem, Trajectory, float]:
        """Returns a problem, a certified motion that solves it, and the pace at which it was made."""
        while True:
            count = int(self.rng.integers(PASSAGES[0], PASSAGES[1] + 1))
            passed = self._passed(count)
            found = None if passed is None else self._certified(*passed)
            if found is not None:
                return found

    def _passed(self, count: int) -> tuple[list[Passage], list[State]] | None:
        """Returns passages with the samples of each on the known motion; None where the arm got stuck."""
        passages: list[Passage] = []
        pieces: list[State] = []
        q = self.cell.home
        for number in range(count):
            for _ in range(TRIES):
                made = self._piece(q)
                if made is not None:
                    break
            else:
                return None
            state, piece = made
            passages.append(Passage(str(number), state))
            pieces.append(piece)
            q = piece[0][-1]
        return passages, pieces

    def _piece(self, near: Vector) -> tuple[Release, State] | None:
        """Returns a state or line that begins near joint positions, and its samples; None for one beyond limits."""
        limits = self.cell.limits
        q = near + self.rng.uniform(-STEP_RAD, STEP_RAD, 6)
        if ((q < limits.q_lower) | (q > limits.q_upper)).any():
            return None
        if body_model(self.cell).clearances(q[None]).least[0] < 0.0:
            return None
        if self.rng.random() < LINES[self.mixture]:
            return self._line(q)
        qd = self.rng.uniform(-SPEED_SHARE, SPEED_SHARE, 6) * limits.qd_max
        X_WT, V_WT = tool_state(self.cell, q, qd)
        states: tuple[Release, ...] = (
            JointRelease(q, qd), PoseRelease(X_WT, V_WT), PointRelease(X_WT[:3, 3], V_WT[:3])
        )  # fmt: skip
        return states[int(self.rng.integers(len(states)))], (q[None], qd[None], np.zeros((1, 6)))

    def _line(self, q: Vector) -> tuple[SteadyLine, State] | None:
        X_WT, _ = tool_state(self.cell, q, np.zeros(6))
        way = self.rng.normal(size=3)
        length = self.rng.uniform(*LINE_M)
        way *= length / np.linalg.norm(way)
        turn = self.rng.uniform(-1.0, 1.0, 3) * TURN_RAD / math.sqrt(3.0) * self.rng.integers(2)
        speed = float(self.rng.uniform(*LINE_M_S))
        X_WE = pose(X_WT[:3, 3] + way, rotation_vector_to_matrix(turn) @ X_WT[:3, :3])
        line = SteadyLine(X_WT, np.concatenate([way, turn]) * speed / length, X_WE, speed)
        try:
            (motion,) = line_motions(self._problem([Passage("", line)]), [q])
        except Infeasible:
            return None
        return line, motion

    def _problem(self, passages: list[Passage]) -> ThrowProblem:
        cell = self.cell
        return ThrowProblem(cell, cell.home, passages[-1].state, cell.limits, passages=tuple(passages))

    def _certified(self, passages: list[Passage], pieces: list[State]) -> tuple[ThrowProblem, Trajectory, float] | None:
        problem = self._problem(passages)
        for pace in PACES:
            motion = _joined(problem, pieces, pace)
            if motion is not None and Examination(problem, motion).first_failure is None:
                return problem, motion, pace
        return None


def _joined(problem: ThrowProblem, pieces: list[State], pace: float) -> Trajectory | None:
    """Returns the motion through pieces, leg by leg at one pace; None where Ruckig refuses a leg."""
    zero = np.zeros(6)
    state: State = (problem.start, zero, zero)
    rows: list[State] = [(problem.start[None], zero[None], zero[None])]
    passed = []
    tick = 0
    try:
        for piece in pieces:
            rows.append(ruckig_otg.leg(problem, state, (piece[0][0], piece[1][0], piece[2][0]), pace))
            tick += len(rows[-1][0]) - 1
            passed.append(tick)
            tick += len(piece[0]) - 1
            rows.append(piece)
            state = (piece[0][-1], piece[1][-1], piece[2][-1])
        rows.append(ruckig_otg.leg(problem, state, None, pace))
    except SolverFailed:
        return None
    arrays = [np.concatenate([row[k][int(i > 0) :] for i, row in enumerate(rows)]) for k in range(3)]
    return Trajectory(1.0 / problem.dt, *arrays, release_index=passed[-1], passage_indices=tuple(passed))


def measured(number: int, seed: int, is_audited: bool) -> dict[str, Any]:
    """Returns what became of a motion: its times, those of the known one, and the faults that the audit finds.

    Args:
        number, seed: of the motion.
        is_audited: whether there is an audit; otherwise the faults are None.
    """
    from audit.judge import find_faults

    drawing = Drawing(number, seed)
    problem, known, pace = drawing.motion()
    row: dict[str, Any] = {
        "number": number,
        "arm": problem.cell.robot.name,
        "mixture": drawing.mixture,
        "passages": len(problem.passages),
        "boxes": len(problem.cell.surroundings.keep_out),
        "known_s": known.passed[-1] * known.dt,
        "pace": pace,
    }
    begun_s = time.process_time()
    try:
        made = plan(problem, SearchHints(offers_nearest=False))
    except (Infeasible, SolverFailed, InvalidProblem) as refusal:
        return {**row, "result": type(refusal).__name__, "why": str(refusal), "cpu_s": time.process_time() - begun_s}
    cpu_s = time.process_time() - begun_s
    faults = [str(fault) for fault in find_faults(problem, made.trajectory)] if is_audited else None
    time_s = made.trajectory.passed[-1] * known.dt
    return {
        **row,
        "result": "planned",
        "time_s": time_s,
        "cpu_s": cpu_s,
        "tried": made.attempts[-1].result,
        "faults": faults,
    }


def tally(rows: list[dict[str, Any]]) -> str:
    """Returns the result of rows in words."""
    lines = []
    for mixture in (*LINES, "all"):
        some = [row for row in rows if mixture in (row["mixture"], "all")]
        planned = [row for row in some if row["result"] == "planned"]
        if not planned:
            continue
        ratios = np.array([row["time_s"] / row["known_s"] for row in planned])
        each_ms = 1e3 * np.array([row["cpu_s"] / row["passages"] for row in some])
        faulty = [bool(row["faults"]) for row in planned if row["faults"] is not None]
        lines += [
            f"{mixture}: {len(planned)} of {len(some)} planned; {sum(faulty)} of {len(faulty)} audited are faulty",
            f"  time over the known motion's: median {np.median(ratios):.3f}, most {ratios.max():.3f}",
            f"  processor time a passage: median {np.median(each_ms):.0f} ms, 9 in 10 below "
            f"{np.quantile(each_ms, 0.9):.0f} ms",
        ]
    refused = [row for row in rows if row["result"] != "planned"]
    lines.append(f"refused: {dict(Counter(row['result'] for row in refused))}")
    return "\n".join([*lines, *(f"  {row['number']} {row['mixture']}: {row['why'][:200]}" for row in refused)])


def main() -> None:
    """Measures the motions that the rows lack, and prints the result."""
    parser = numbered_parser(__doc__, 300, ROWS)
    parser.add_argument("--audited", type=int, default=1, help="one plan of so many is audited")
    given = parser.parse_args()
    print(tally(measured_rows(given, lambda number: measured(number, given.seed, number % given.audited == 0))))


if __name__ == "__main__":
    main()
