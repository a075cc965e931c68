"""One run of ThrowBench: entries by sets, every answer judged, a row each, kept on disk."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.throwbench.entries import BUILT_IN, EntryMissing, Reply, ThrowEntry, entry_of
from benchmarks.throwbench.judge import Verdict, verify
from benchmarks.throwbench.problem_document import Problem
from benchmarks.throwbench.sets import HIDDEN, HIDDEN_COUNT, hidden_name, hidden_problems, load_set, spread

WORDS_MAX = 200  # [-] of a reason that are shown


@dataclass(frozen=True)
class ThrowRow:
    """Verdict on one answer, with the entry's times [s].

    Attributes:
        entry: Name of the entry.
        problem: "set/number".
        verdict: `Verdict.as_document()`.
        wall_s: Wall time to the answer.
        processor_s: Processor time of the entry, None where it is not known.
    """

    entry: str
    problem: str
    verdict: dict
    wall_s: float
    processor_s: float | None

    @property
    def set(self) -> str:
        """Name of the problem's set."""
        return self.problem.split("/")[0]

    @property
    def outcome(self) -> str:
        """Outcome of the verdict."""
        return self.verdict["outcome"]

    @property
    def solved(self) -> bool:
        """Whether the answer is valid."""
        return self.outcome == "solved"


@dataclass(frozen=True)
class ThrowBenchOptions:
    """What to run.

    Attributes:
        entries: As the command line names them.
        sets: Names of sets, `HIDDEN` among them.
        count: Problems per set; None for all.
        seed: Of the hidden cells.
        time_limit_s: For one answer.
        rows: File of the rows.
        resume: Whether to keep the rows that it has.
    """

    entries: tuple[str, ...]
    sets: tuple[str, ...]
    count: int | None
    seed: int
    time_limit_s: float
    rows: Path
    resume: bool = False


def chosen_problems(options: ThrowBenchOptions) -> dict[str, list[Problem]]:
    """Returns the problems of a run by the name of their set."""
    problems = {}
    for name in options.sets:
        if name == HIDDEN:
            problems[hidden_name(options.seed)] = hidden_problems(options.count or HIDDEN_COUNT, options.seed)
        else:
            problems[name] = spread(load_set(name), options.count)
    return problems


def run_entries(
    options: ThrowBenchOptions, problems: dict[str, list[Problem]]
) -> tuple[list[ThrowRow], dict[str, str]]:
    """Returns the rows of a run on `chosen_problems`, and why built-in entries are missing, by name.

    Raises:
        EntryMissing: Another entry cannot be loaded.
    """
    options.rows.parent.mkdir(parents=True, exist_ok=True)
    if not options.resume:
        options.rows.unlink(missing_ok=True)
    missing: dict[str, str] = {}
    entries = [entry_of(text) for text in options.entries]
    rows = _read(options.rows)
    for entry in entries:
        done = {row.problem for row in rows if row.entry == entry.name}
        try:
            for group in problems.values():
                _run_set(entry, [p for p in group if p["name"] not in done], options, rows)
        except EntryMissing as error:
            if entry.name not in BUILT_IN:
                raise
            missing[entry.name] = str(error)
            _log(f"{entry.name}: left out: {error}")
        finally:
            entry.close()
    wanted = {problem["name"] for group in problems.values() for problem in group}
    names = {entry.name for entry in entries}
    return [row for row in rows if row.problem in wanted and row.entry in names], missing


def _run_set(entry: ThrowEntry, problems: list[Problem], options: ThrowBenchOptions, rows: list[ThrowRow]) -> None:
    """Asks the problems of a set; the first one beforehand too, which does not count: it loads and builds."""
    if problems:
        entry.ask(problems[0], options.time_limit_s)
    for problem in problems:
        reply = entry.ask(problem, options.time_limit_s)
        verdict = verdict_on(problem, reply)
        row = ThrowRow(entry.name, problem["name"], verdict.as_document(), reply.wall_s, reply.processor_s)
        rows.append(row)
        with options.rows.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(row)) + "\n")
        _log(f"{entry.name:14} {problem['name']:28} {verdict.outcome:10} {reply.wall_s:7.2f} s  {_why(verdict)}")


def verdict_on(problem: Problem, reply: Reply) -> Verdict:
    """Returns the verdict on what came back for a problem."""
    if reply.outcome != "answered":
        return Verdict(reply.outcome, reason=reply.reason)
    return verify(problem, reply.answer)


def _why(verdict: Verdict) -> str:
    """Returns the reason of a verdict, or the first fault of each broken rule."""
    first = {fault.rule: str(fault) for fault in reversed(verdict.faults)}
    return verdict.reason.strip()[-WORDS_MAX:] or "; ".join(first.values())


def _read(file: Path) -> list[ThrowRow]:
    """Returns the rows of an interrupted run that count: crashes and lapsed time limits are asked again."""
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    rows = [ThrowRow(**json.loads(line)) for line in lines]
    return [row for row in rows if row.outcome not in ("crashed", "timed out")]


def _log(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
