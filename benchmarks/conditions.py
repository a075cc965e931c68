"""The same requests under other conditions: through library, command line and service, and beside other work.

    python -m benchmarks.conditions                       # 10 requests of every kind, every way and condition
    python -m benchmarks.conditions --count 100 --out build/benchmarks
    python -m benchmarks.conditions --way library --condition quiet --condition busy
    python -m benchmarks.conditions --count 100 --way command --condition busy --parallel 4

The library's answers on a quiet machine are the reference. All others must have the same back end, the same tick of the
release and the same samples to 1e-9; with other kernels of numpy and the C library, a certified plan
released within one tick. The exit status is 1 where they have not.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any

import httpx2
import numpy as np

from benchmarks.problem_sets import build
from benchmarks.results import machine, write_report
from planner.request import request_document

Request = dict[str, Any]
Answer = dict[str, Any]

ROOT = Path(__file__).parents[1]
FLING = Path(sys.executable).with_name("fling")
KINDS = ("joint", "pose", "point", "target", "robust")
BY_NAME = ("casadi", "ruckig", "toppra", "cubic", "trapezoid", "ramp")  # asked for by every fifth request, in turn
NAMED_EVERY = 5
BUSY_PROCESSES = 12
CLOSE = 1e-9  # [rad, rad/s, rad/s^2] largest difference of two samples that are the same
SHARE_WITHIN_A_TICK = 0.99  # [-] of the plans with other kernels
READY_S = 900.0
ANSWER_S = 3600.0  # [s] longest waits for the service: its start, an answer
OTHER_KERNELS = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
    "OPENBLAS_CORETYPE": "Prescott",
}


def requests(count: int, seed: int) -> list[Request]:
    """Returns `count` requests of every kind; every fifth of them names a back end."""
    named = cycle(BY_NAME)
    made = []
    for kind in KINDS:
        for i, task in enumerate(build("pose" if kind == "joint" else kind, count, seed)):
            release = task.state if kind == "joint" and task.state is not None else task.problem.release
            request = request_document(task.problem, release)
            del request["time_limit_s"]
            robust = kind == "robust"  # the textbook profiles cannot bend to a window
            request["backend"] = ("casadi" if robust else next(named)) if i % NAMED_EVERY == NAMED_EVERY - 1 else "auto"
            made.append(request)
    return made


def answer_of(document: Mapping[str, Any]) -> Answer:
    """Returns what is compared of a plan or a problem document."""
    if "trajectory" not in document:
        constraints = [violation["constraint"] for violation in document.get("violations", ())]
        return {"outcome": document["type"].rpartition("/")[2], "constraints": constraints}
    motion = document["trajectory"]
    return {
        "outcome": "planned" if document["certificate"]["valid"] else "not certified",
        "backend": document["backend"],
        "index": document["release"]["index"],
        "samples": [motion[name] for name in ("positions", "velocities", "accelerations")],
    }


# --- ways ---


def by_library(asked: Sequence[Request], environment: Mapping[str, str]) -> list[Answer]:
    """Returns the answers of one process that imports the planner."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.conditions", "--answer"],
        input=json.dumps(asked),
        capture_output=True,
        text=True,
        env=dict(environment),
        check=True,
        cwd=ROOT,
    )
    return json.loads(done.stdout)


def library_answers(asked: Sequence[Request]) -> list[Answer]:
    """Returns the planner's answers in this process."""
    from api.http import problem_document, translate
    from planner.answer import plan_document
    from planner.cell import load_cell
    from planner.errors import PlannerError
    from planner.planning import plan
    from planner.request import problem_from_request

    answers = []
    for request in asked:
        cell = load_cell(ROOT / "cells" / f"{request['cell']}.toml")
        begun = time.perf_counter()
        try:
            document = plan_document(plan(problem_from_request(request, cell)), request, "", "")
        except PlannerError as error:
            document = problem_document(translate(error), "")
        answers.append({**answer_of(document), "seconds": time.perf_counter() - begun})
    return answers


def by_command(asked: Sequence[Request], environment: Mapping[str, str]) -> list[Answer]:
    """Returns the answers of `fling plan`, each in a fresh process."""
    answers = []
    for request in asked:
        begun = time.perf_counter()
        done = subprocess.run(
            [str(FLING), "plan", "-", "--cells", str(ROOT / "cells")],
            input=json.dumps(request),
            capture_output=True,
            text=True,
            env=dict(environment),
            check=False,
        )
        document = json.loads(done.stdout or done.stderr)
        answers.append({**answer_of(document), "seconds": time.perf_counter() - begun})
    return answers


def by_service(asked: Sequence[Request], environment: Mapping[str, str]) -> list[Answer]:
    """Returns the answers of a service of its own."""
    answers = []
    with _service(environment) as url, httpx2.Client(base_url=url, timeout=ANSWER_S, trust_env=False) as client:
        for request in asked:
            begun = time.perf_counter()
            document = client.post("/plan", json=request).json()
            answers.append({**answer_of(document), "seconds": time.perf_counter() - begun})
    return answers


@contextmanager
def _service(environment: Mapping[str, str]) -> Iterator[str]:
    """Yields the address of a service that is ready."""
    with tempfile.TemporaryDirectory() as folder, socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
        free.close()
        own = {"FLING_DATABASE_URL": f"sqlite:///{folder}/fling.db", "FLING_CELLS": str(ROOT / "cells")}
        process = subprocess.Popen(
            [sys.executable, "-m", "api"], env={**environment, **own, "FLING_PORT": str(port)}, cwd=folder
        )
        try:
            _wait_until_ready(f"http://127.0.0.1:{port}/readyz", process)
            yield f"http://127.0.0.1:{port}"
        finally:
            process.send_signal(signal.SIGINT)
            process.wait()


def _wait_until_ready(url: str, process: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + READY_S
    while time.monotonic() < end and process.poll() is None:
        try:
            if httpx2.get(url, trust_env=False).status_code == 200:
                return
        except httpx2.HTTPError:
            pass
        time.sleep(0.2)
    raise RuntimeError("the service does not become ready")


ANSWERS_BY_WAY: dict[str, Callable[[Sequence[Request], Mapping[str, str]], list[Answer]]] = {
    "library": by_library,
    "command": by_command,
    "service": by_service,
}


def in_parallel(parts: int, way: str, asked: Sequence[Request], environment: Mapping[str, str]) -> list[Answer]:
    """Returns a way's answers in the order of the requests, which are asked in so many parts at the same time.

    Each part has a process, a service or a series of commands of its own.
    """
    answers: list[Answer] = [{}] * len(asked)
    with ThreadPoolExecutor(parts) as pool:
        made = pool.map(lambda part: ANSWERS_BY_WAY[way](asked[part::parts], environment), range(parts))
        for part, some in enumerate(made):
            answers[part::parts] = some
    return answers


# --- conditions: each yields the environment in which the answers are made ---


@contextmanager
def quiet() -> Iterator[dict[str, str]]:
    """Yields the environment as it is."""
    yield dict(os.environ)


@contextmanager
def busy() -> Iterator[dict[str, str]]:
    """Yields the environment while other processes keep every processor busy."""
    with ExitStack() as stack:
        for _ in range(BUSY_PROCESSES):
            process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            stack.callback(process.wait)
            stack.callback(process.kill)
        yield dict(os.environ)


@contextmanager
def kernels() -> Iterator[dict[str, str]]:
    """Yields an environment in which numpy, its linear algebra and the C library round otherwise."""
    yield {**os.environ, **OTHER_KERNELS}


CONDITIONS = {"quiet": quiet, "busy": busy, "kernels": kernels}


# --- comparison ---


@dataclass(frozen=True)
class Comparison:
    """Answers of one way and condition against the reference.

    Attributes:
        condition, way: where they were made.
        seconds: duration of each.
        differences: what differs, by request.
        allowed: differences that are none too many.
    """

    condition: str
    way: str
    seconds: tuple[float, ...]
    differences: tuple[str, ...]
    allowed: int

    @property
    def ok(self) -> bool:
        """Whether no more answers differ than may."""
        return len(self.differences) <= self.allowed

    def row(self) -> str:
        """Returns the row of the report's table."""
        p50, p99 = np.quantile(self.seconds, [0.5, 0.99])
        same = len(self.seconds) - len(self.differences)
        return f"| {self.condition} | {self.way} | {same} of {len(self.seconds)} | {p50:.3f} | {p99:.3f} |"


def difference(was: Answer, now: Answer, ticks: int) -> str:
    """Returns what differs between two answers, "" for the same; with `ticks`, the release alone counts, to so many."""
    if "solver-failed" in (was["outcome"], now["outcome"]) or was["outcome"] != now["outcome"]:
        return f"{was['outcome']}, then {now['outcome']}"
    if was["outcome"] != "planned":
        return "" if ticks or was["constraints"] == now["constraints"] else "other constraints"
    if abs(was["index"] - now["index"]) > ticks:
        return f"released at tick {was['index']}, then {now['index']}"
    if ticks:
        return ""
    if was["backend"] != now["backend"]:
        return f"by {was['backend']}, then by {now['backend']}"
    before = np.array(was["samples"])
    after = np.array(now["samples"])
    if before.shape != after.shape:
        return f"{before.shape[1]} samples, then {after.shape[1]}"
    off = float(np.abs(before - after).max())
    return f"samples differ by {off:.2g}" if off > CLOSE else ""


def compare(condition: str, way: str, asked: Sequence[Request], was: list[Answer], now: list[Answer]) -> Comparison:
    """Returns the comparison of answers with the reference."""
    ticks = int(condition == "kernels")
    found = []
    for i, (request, before, after) in enumerate(zip(asked, was, now, strict=True)):
        text = difference(before, after, ticks)
        if text:
            found.append(f"{i} {request['cell']} {request['release']['kind']} {request['backend']}: {text}")
    allowed = int(len(asked) * (1.0 - SHARE_WITHIN_A_TICK)) if ticks else 0
    return Comparison(condition, way, tuple(answer["seconds"] for answer in now), tuple(found), allowed)


def report(asked: Sequence[Request], reference: list[Answer], made: Sequence[Comparison], parallel: int = 1) -> str:
    """Returns the report in Markdown."""
    about = machine()
    planned = sum(answer["outcome"] == "planned" for answer in reference)
    lines = [
        "# The same answers under other conditions",
        "",
        f"{len(asked)} requests: {len(asked) // len(KINDS)} each of {', '.join(KINDS)}, one of {NAMED_EVERY} by a",
        f"named back end; {planned} planned, the others refused. The reference: the library on a quiet machine.",
        f"{about['processor']}; {about['system']}; commit {about['commit']}, {about['date']}.",
        f"Requests at a time: {parallel}, each in a process or service of its own.",
        "",
        "| condition | way | the same | p50 [s] | p99 [s] |",
        "|---|---|---|---|---|",
        *(comparison.row() for comparison in made),
        "",
        *(f"- {c.condition}, {c.way}: {text}" for c in made for text in c.differences),
    ]
    return "\n".join(lines).rstrip() + "\n"


def main(argv: Sequence[str]) -> int:
    """Runs the comparison; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10, help="requests of every kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--way", dest="ways", action="append", choices=ANSWERS_BY_WAY, help="default: all")
    parser.add_argument("--condition", dest="conditions", action="append", choices=CONDITIONS, help="default: all")
    parser.add_argument("--parallel", type=int, default=1, help="requests at a time, each by its own process")
    parser.add_argument("--out", type=Path, help="folder of the report; default: standard output")
    parser.add_argument("--answer", action="store_true", help=argparse.SUPPRESS)  # this process is `by_library`'s
    given = parser.parse_args(argv)
    if given.parallel < 1:
        parser.error(f"--parallel is {given.parallel}; at least 1")
    if given.answer:
        json.dump(library_answers(json.load(sys.stdin)), sys.stdout)
        return 0
    asked = requests(given.count, given.seed)
    reference = by_library(asked, os.environ)
    made = []
    for condition in given.conditions or CONDITIONS:
        with CONDITIONS[condition]() as environment:
            for way in given.ways or ANSWERS_BY_WAY:
                answers = in_parallel(given.parallel, way, asked, environment)
                made.append(compare(condition, way, asked, reference, answers))
                print(made[-1].row(), *made[-1].differences, sep="\n", file=sys.stderr, flush=True)
    write_report(report(asked, reference, made, given.parallel), given.out, "same-answers.md")
    return 0 if all(comparison.ok for comparison in made) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
