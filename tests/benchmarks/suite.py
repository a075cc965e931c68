"""One run: sets by back ends, then what was feasible, peers, the second judge, and the report."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from planner.backends.casadi_nlp import warm
from tests.benchmarks import report
from tests.benchmarks.audit import Audit, audit
from tests.benchmarks.known import known_motion
from tests.benchmarks.peers import PEERS, Peer, PeerMissing
from tests.benchmarks.peers.sdu_method import Tally, tally
from tests.benchmarks.record import Record, machine
from tests.benchmarks.runner import Runner, measured, supported
from tests.benchmarks.sets import ANYWHERE, build, cell
from tests.benchmarks.task import Row, Task

# Problems a set in the quick run. The SDU targets are 28 and 35 whatever is asked.
QUICK = {
    "pose": 200,
    "point": 200,
    "target": 200,
    "hard": 64,
    "robust": 100,
    "robust-30": 60,
    "pose-anywhere": 200,
    "point-anywhere": 200,
    "target-anywhere": 200,
    "robust-anywhere": 100,
    "robust-30-anywhere": 60,
    "unreachable": 24,
    "too-fast": 24,
    "sdu-near": 28,
    "sdu-far": 35,
}
PAIRS = {"sdu-near-pairs": 2800, "sdu-far-pairs": 2800}
REFUSED = ("unreachable", "too-fast")
PEER_TASKS = 24  # `pose` problems that peers are given too
SDU_STRIDE = 5  # every fifth release point for the rebuilt SDU method in the quick run
REFERENCE = "known"  # the back end's name of the slow search


@dataclass(frozen=True)
class Choice:
    """What to run, and where to write."""

    sets: tuple[str, ...]
    backends: tuple[str, ...]
    count: int | None
    seed: int
    judged: int
    peers: bool
    out: Path
    rows: Path
    resume: bool
    given: tuple[str, ...] = ()


def run(choice: Choice) -> None:
    """Runs everything chosen and writes the report; solvers are built first, as `fling warm` does."""
    _say("solvers compiled" if warm() else "no C compiler: interpreted solvers")
    gc.collect()
    gc.freeze()  # as the service's planner processes do
    about = machine() | {"command": " ".join(["fling bench", *choice.given])}
    record, runner = Record(choice.rows / "rows.jsonl", choice.resume), Runner()
    tasks = {name: build(name, choice.count or {**QUICK, **PAIRS}[name], choice.seed) for name in choice.sets}
    there = supported(next(iter(tasks.values()))[0].problem)
    for name, group in tasks.items():
        _run_set(group, _backends(name, there, choice.backends), record, runner)
    if choice.peers and "pose" in tasks:
        _run_peers(tasks["pose"][:PEER_TASKS], record)
    for group in tasks.values():
        _search(group, record)
    judged = _audited(choice) if choice.judged else Audit(0, 0, ())
    _say(f"{judged.judged} certified plans judged by other libraries, {len(judged.wrong)} wrong")
    report.write(choice.out, about, record.rows, judged, _rebuilt(choice))
    _say(f"written: {choice.out}/README.md")


def _audited(choice: Choice) -> Audit:
    return audit(choice.judged, choice.seed, processes=2, rows=choice.rows / "audit.jsonl", resume=choice.resume)


def _backends(name: str, there: tuple[str, ...], wanted: tuple[str, ...]) -> list[str]:
    """Returns Ruckig as the reference, then what was asked for.

    Refusals and pairs are asked of `auto` alone; sets from anywhere of `auto` and Ruckig.
    """
    if name in REFUSED or name in PAIRS:
        return ["auto"]
    chosen = [b for b in there if not wanted or b in wanted or b == "ruckig"]
    if name.endswith(ANYWHERE):
        chosen = [b for b in chosen if b in ("ruckig", "auto")]
    if name.startswith("robust"):
        chosen = [b for b in chosen if b in ("casadi", "auto")]
    return sorted(chosen, key=lambda b: b != "ruckig")


def _rebuilt(choice: Choice) -> dict[str, Tally]:
    """Returns the SDU method's score: on every tenth release point, or on all where the pairs are run."""
    parts = [part for part in ("near", "far") if choice.peers and f"sdu-{part}" in choice.sets]
    stride = 1 if any(name in PAIRS for name in choice.sets) else SDU_STRIDE
    return {part: tally(part, cell("sdu-table"), stride) for part in parts}


def _run_set(tasks: list[Task], backends: list[str], record: Record, runner: Runner) -> None:
    for backend in backends:
        for task in tasks:
            if not record.has(task.name, backend):
                record.add(runner.run(task, backend)[0])
        own = [r for r in record.rows if r.backend == backend and r.group == tasks[0].group]
        _say(f"{tasks[0].group:18} {backend:10} {sum(r.certified for r in own)} of {len(own)} certified")


def _run_peers(tasks: list[Task], record: Record) -> None:
    for name, peer in PEERS.items():
        try:
            for task in tasks[: peer.tasks or len(tasks)]:
                if not record.has(task.name, name):
                    peer.prepare(task.problem.cell)
                    record.add(_peer_row(name, peer, task))
        except PeerMissing as missing:
            _say(f"peer {name}: {missing}")
            continue
        own = [r for r in record.rows if r.backend == name]
        _say(f"pose               {name:10} {sum(r.certified for r in own)} of {len(own)} certified")


def _peer_row(name: str, peer: Peer, task: Task) -> Row:
    answer = peer.solve(task.problem)
    if answer.motion is None:
        return Row(task.name, name, "failed", solve_s=answer.solve_s, cpu_s=answer.solve_s, reason=answer.reason)
    row = measured(task, name, answer.motion, answer.solve_s, peer.ignored)
    row.cpu_s = answer.solve_s
    return row


def _search(tasks: list[Task], record: Record) -> None:
    """Looks for any motion where no back end and no peer found one, so that "feasible" does not depend on them."""
    for task in _unsolved(tasks, record):
        if task.state is None or task.problem.is_robust or record.has(task.name, REFERENCE):
            continue
        motion = known_motion(task.problem, task.state)
        row = Row(task.name, REFERENCE, "failed" if motion is None else "certified")
        if motion is not None:
            row = measured(replace(task, problem=replace(task.problem, release=task.state)), REFERENCE, motion, 0.0)
        record.add(row)


def _unsolved(tasks: list[Task], record: Record) -> Iterator[Task]:
    certified = {row.task for row in record.rows if row.certified}
    return (task for task in tasks if task.name not in certified)


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
