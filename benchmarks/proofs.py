"""How many certified plans `fling verify` proves, in what time, and whether it accepts one that breaks a limit.

`python -m benchmarks.proofs --count 2000 [--cells 50] [--resume]`. Plans are those of `benchmarks.mutations`, of all
arms and kinds of release in cells with every limit, and those of the audit's problems, in turns. Of the first every
limit is drawn inside what the plan needs: a thousandth of its peak, or a millimetre. The verifier has to refuse each.
With `--chains` they are the audit's motions of passages, and what is wrong is a passage: a millimetre or a milliradian
off, a hundredth too fast, or a tick late. With `--kind` they are of learnt cells, of bodies, at moving targets or of
two grippers, see `benchmarks.proofs_of_kinds`.
"""

from __future__ import annotations

import argparse
import copy
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, zip_longest
from itertools import count as numbers
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.audit import drawn_tasks
from benchmarks.mutations import certified_plans, mutations
from benchmarks.proofs_of_kinds import ToldPlan, told_plans
from benchmarks.results import add_row, kept_rows
from planner.cell import Cell
from planner.errors import Infeasible, InvalidProblem, PlannerError, SolverFailed
from planner.passages import passed_documents
from planner.planning import SearchHints, plan
from planner.problem import ThrowProblem
from planner.request import problem_from_request, request_document
from planner.trajectory import Trajectory
from verifier import Status, findings

INSIDE = 1e-3  # [-] of a peak, or [m, rad], by which a limit is drawn inside it
SLOW = 0.05  # [m/s, rad/s] of which a hundredth is more than twice what is allowed of a velocity
QUICK = SearchHints(offers_nearest=False)  # the nearest request is most of a refusal's time
KINDS = ("profile", "body", "moving", "grippers")
ROWS = Path(__file__).parents[1] / "build" / "benchmarks" / "proofs.jsonl"


def document_of(problem: ThrowProblem, trajectory: Trajectory) -> tuple[dict[str, Any], Cell]:
    """Returns what a plan's document says of a motion, and the cell, whose limits are the problem's."""
    cell = replace(problem.cell, limits=problem.limits)
    document = {
        "cell": cell.name,
        "cell_sha256": cell.sha256,
        "request": request_document(problem, problem.release),
        "sample_rate_hz": trajectory.sample_rate_hz,
        "release": {"index": trajectory.release_index} if problem.throws or not problem.passages else None,
        "passages": passed_documents(problem.cell, problem.passages, trajectory) if problem.passages else [],
        **({} if problem.starts_at_s is None else {"starts_at_s": problem.starts_at_s}),
        "trajectory": {
            "positions": trajectory.q.tolist(),
            "velocities": trajectory.qd.tolist(),
            "accelerations": trajectory.qdd.tolist(),
        },
    }
    return document, cell


def is_accepted(problem: ThrowProblem, trajectory: Trajectory) -> bool:
    """Returns whether the verifier proves a motion for a problem: it stops at the first check that is not proven."""
    return all(each.status is Status.PROVEN for each in findings(*document_of(problem, trajectory)))


def _plans(count: int, seed: int, cells: int) -> Iterator[tuple[str, ThrowProblem, Trajectory, bool]]:
    """Yields plans by their names, and whether their limits are drawn in: those of cells with every limit."""
    own = ((name, problem, motion, True) for name, problem, motion in certified_plans(count, seed))
    audited = _audited(count, seed, cells)
    for both in zip_longest(own, audited):
        yield from (each for each in both if each is not None)


def _audited(count: int, seed: int, cells: int) -> Iterator[tuple[str, ThrowProblem, Trajectory, bool]]:
    for task in drawn_tasks(count, seed, cells):
        try:
            yield task.name, task.problem, plan(task.problem).trajectory, False
        except (Infeasible, SolverFailed):
            continue


def _chains(count: int, seed: int) -> Iterator[tuple[str, ThrowProblem, Trajectory, bool]]:
    """Yields the audit's motions of passages."""
    from audit.problems import drawn_problem  # by foreign code, which need not be there

    found = 0
    for index in numbers():
        drawn = drawn_problem(seed, index)
        if drawn.request is None or "passages" not in drawn.request:
            continue
        try:
            made = plan(problem_from_request(drawn.request, drawn.cell), QUICK)
        except PlannerError:
            continue
        yield f"{seed}/{index}/{drawn.kind}", made.problem, made.trajectory, False
        found += 1
        if found == count:
            return


def passage_mutants(document: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yields documents of a motion of passages with one fault each, and what it is."""
    tick_s = 1.0 / document["sample_rate_hz"]
    for number, passage in enumerate(document["passages"]):
        for what in ("off", "fast", "late", *(f"output {i} late" for i in range(len(passage["outputs"])))):
            changed = {**document, **{key: copy.deepcopy(document[key]) for key in ("request", "passages")}}
            asked, told = changed["request"]["passages"][number], changed["passages"][number]
            if what == "late":
                told["index"] += 1
                told["end_index"] += 1
            elif what.startswith("output"):
                told["outputs"][int(what.split()[1])]["edge_time_s"] += tick_s
            elif not _moved(asked, what == "fast"):
                continue
            yield f"{passage['name']} {what}", changed


def _moved(asked: dict[str, Any], is_faster: bool) -> bool:
    """Moves what a passage asks for, or its speed, and returns whether that is a fault; a target has its own checks."""
    if "line" in asked:
        asked["line"]["speed_m_s"] *= 1.0 + (0.01 if is_faster else 0.0)
        asked["line"]["from"]["position"][0] += 0.0 if is_faster else 1e-3
        return True
    state = asked["state"]
    if state["kind"] == "target":
        return False
    place, velocity = {
        "joint": lambda: (state["positions"], state["velocities"]),
        "pose": lambda: (state["pose"]["position"], state["twist"]["linear"]),
        "point": lambda: (state["position"], state["velocity"]),
    }[state["kind"]]()
    if is_faster:
        velocity[:] = [1.01 * each for each in velocity]
        return max(map(abs, velocity)) > SLOW  # a hundredth of less is within what is allowed of a velocity
    place[0] += 1e-3
    return True


def row_of(name: str, problem: ThrowProblem, trajectory: Trajectory, has_mutants: bool) -> dict[str, Any]:
    """Returns what was found of a plan: checks that are not proven, processor time [s], limits tried and accepted."""
    document, cell = document_of(problem, trajectory)
    begin = time.process_time()
    found = list(findings(document, cell))
    seconds = time.process_time() - begin
    tried = 0
    accepted = []
    for mutant in mutations(problem, trajectory, INSIDE) if has_mutants else ():
        tried += 1
        try:
            if is_accepted(mutant.problem(), trajectory):
                accepted.append(mutant.limit)
        except InvalidProblem:
            continue
    for what, mutant in passage_mutants(document) if document["passages"] else ():
        tried += 1
        if all(each.status is Status.PROVEN for each in findings(mutant, cell)):
            accepted.append(what)
    return {
        "task": name,
        "open": [str(each) for each in found if each.status is not Status.PROVEN],
        "seconds": seconds,
        "mutants": tried,
        "accepted": accepted,
    }


def row_of_told(told: ToldPlan) -> dict[str, Any]:
    """Returns what was found of a plan and of its faults, as `row_of`."""
    begin = time.process_time()
    found = list(findings(told.document, told.cell, told.profile))
    seconds = time.process_time() - begin
    tried = 0
    accepted = []
    for what, fault in told.faults():
        tried += 1
        if all(each.status is Status.PROVEN for each in findings(fault.document, fault.cell, fault.profile)):
            accepted.append(what)
    return {
        "task": told.name,
        "open": [str(each) for each in found if each.status is not Status.PROVEN],
        "seconds": seconds,
        "mutants": tried,
        "accepted": accepted,
    }


def summary(rows: Sequence[Mapping[str, Any]]) -> str:
    """Returns the result in lines."""
    seconds = np.array([row["seconds"] for row in rows])
    proven = [row for row in rows if not row["open"]]
    quick = sum(row["seconds"] <= 1.0 for row in proven)
    opened = Counter(chain.from_iterable({text.split(" at ")[0] for text in row["open"]} for row in rows))
    mutants = sum(row["mutants"] for row in rows if not row["open"])
    accepted = [f"{row['task']}: {limit}" for row in rows for limit in row["accepted"]]
    return "\n".join(
        [
            f"{len(proven)} of {len(rows)} certified plans proven ({quick} within 1 s of one core)",
            f"processor time p50 {np.quantile(seconds, 0.5):.3f} s, p99 {np.quantile(seconds, 0.99):.3f} s",
            f"{mutants} faults in proven plans, {len(accepted)} accepted all the same",
            *accepted,
            *(f"{count} x {text}" for text, count in opened.most_common()),
        ]
    )


def main() -> None:
    """Verifies plans and their mutants, and prints what was found."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.proofs", description=__doc__)
    parser.add_argument("--count", type=int, default=2000, help="plans")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cells", type=int, default=0, help="random cells of the audit's problems; 0: the named sets")
    parser.add_argument("--chains", action="store_true", help="motions of passages of the audit's problems")
    parser.add_argument("--kind", choices=KINDS, help="plans of learnt cells, bodies, targets, grippers")
    parser.add_argument("--rows", type=Path, default=ROWS)
    parser.add_argument("--resume", action="store_true", help="continue an interrupted run")
    parser.add_argument("--tell", action="store_true", help="say what the rows so far say")
    asked = parser.parse_args()
    done = {row["task"] for row in kept_rows(asked.rows, asked.resume or asked.tell)}
    if asked.kind is not None and not asked.tell:
        for told in told_plans(asked.kind, asked.count, asked.seed):
            if told.name not in done:
                add_row(asked.rows, row_of_told(told))
        plans = iter(())
    elif asked.chains:
        plans = _chains(asked.count, asked.seed)
    else:
        plans = _plans(-(-asked.count // 2), asked.seed, asked.cells)
    for each in plans if not asked.tell else ():
        if each[0] not in done:
            add_row(asked.rows, row_of(*each))
    print(summary(kept_rows(asked.rows, True)))


if __name__ == "__main__":
    main()
