"""Output edges by the simulator's own account, through the whole stack: service, executor, simulated controller.

`python -m benchmarks.learning.output_edges known --seed N` passes a row of parts, with eight edges of an output about
each, by a cell file that states each output's delay; `… hidden` by one that states none, before and after `fling
calibrate outputs --adopt`. An edge is off by what the simulated device did less what the plan
said. A run in which this machine lost a tick is made again, and told.
"""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.learning.whole_stack import Laboratory, running_cell
from benchmarks.markdown import markdown_table
from executor.robot import simulator_client

HOST = "127.0.61.1"
PORT = 8761
PARTS = 5
EDGES = 8  # about each part, an output of its own
PULSE_S = 0.04  # [s] between two edges: several times the scatter of the delays
TICK_S = 0.002
DELAY_MAX_S = 0.03  # [s] of a drawn delay
JITTERS_S = (0.0002, 0.002)  # [s] of a drawn deviation
BEFORE = 40  # edges without a calibration
LEARNT = ("delay_s", "delay_std_s", "jitter_s")
HEAD = ("output", "delay, jitter [ms]", "found: delay, ±, jitter", "edges", "mean off [ms]", "largest [ms]")


def drawn_outputs(rng: np.random.Generator, hidden: bool) -> tuple[str, str, list[tuple[float, float]]]:
    """Returns tables of a cell file, a truth file, and delay and jitter of each output [s]."""
    jitters = rng.uniform(*JITTERS_S, PARTS) if hidden else np.zeros(PARTS)
    timings = [*zip(rng.uniform(0.0, DELAY_MAX_S, PARTS).tolist(), jitters.tolist(), strict=True)]
    cell = ""
    truth = f"seed = {rng.integers(1_000_000)}\n"
    for i, (delay_s, jitter_s) in enumerate(timings):
        stated = "" if hidden else f"delay_s = {delay_s}\n"
        cell += f'\n[outputs.flash_{i}]\noutput = "standard_digital"\nindex = {i}\nsense_input = {i + 8}\n{stated}'
        truth += f"[outputs.flash_{i}]\ndelay_s = {delay_s}\njitter_s = {jitter_s}\n"
    return cell, truth, timings


def row_of_parts(rng: np.random.Generator) -> dict[str, Any]:
    """Returns a motion over a row of parts, with edges anywhere between the ticks."""
    passages = []
    for i in range(PARTS):
        pose = {"position": [0.5, 0.12 * i - 0.24, 0.35], "rotation_vector": [math.pi, 0.0, 0.0]}
        twist = {"linear": [0.0, 0.8, 0.0], "angular": [0.0, 0.0, 0.0]}
        offsets = PULSE_S * np.arange(EDGES) + rng.uniform(0.0, TICK_S, EDGES)
        line = {"output": "standard_digital", "index": i}
        outputs = [{**line, "level": k % 2 == 0, "offset_s": offset} for k, offset in enumerate(offsets.tolist())]
        passages.append({"name": f"{i}", "state": {"kind": "pose", "pose": pose, "twist": twist}, "outputs": outputs})
    return {"passages": passages, "end": {"kind": "home"}}


def errors_of_run(lab: Laboratory, rng: np.random.Generator) -> np.ndarray:
    """Returns by how much the edges of a run that lost no tick were off its plan (PARTS, EDGES) [s]."""
    plan = dict(lab.client.plan(row_of_parts(rng), trajectory=False).document)
    while (done := lab.executed(plan))["outcome"] != "completed" or done["metrics"]["missed_ticks"] > 0:
        print(f"again: {done['outcome']}, {done['metrics']['missed_ticks']} ticks lost on this machine", flush=True)
    rows = csv.DictReader(lab.client.text(f"/executions/{done['id']}/recording", "text/csv").splitlines())
    first = next(rows)
    at_zero_s = float(first["timestamp_s"]) - float(first["clock_s"])
    changes = simulator_client.request(HOST, "state")["device_changes"]
    planned = [[edge["edge_time_s"] for edge in passed["outputs"]] for passed in plan["passages"]]
    happened = [[at - at_zero_s for at, _ in changes[f"flash_{i}"][-EDGES:]] for i in range(PARTS)]
    return np.array(happened) - np.array(planned)


def errors_of_runs(lab: Laboratory, rng: np.random.Generator, edges: int) -> np.ndarray:
    """Returns by how much at least so many edges were off their plans (PARTS, n) [s]."""
    return np.hstack([errors_of_run(lab, rng) for _ in range(math.ceil(edges / (PARTS * EDGES)))])


def table(errors: np.ndarray, timings: Sequence[tuple[float, float]], found: dict[str, Any]) -> str:
    """Returns a line for each output, and one for all."""
    lines = []
    for i, (own, (delay_s, jitter_s)) in enumerate(zip(errors, timings, strict=True)):
        learnt = found.get(f"flash_{i}")
        told = "–" if learnt is None else ", ".join(_ms(learnt[name]) for name in LEARNT)
        lines.append((f"flash_{i}", f"{_ms(delay_s)}, {_ms(jitter_s)}", told, *_numbers(own)))
    return "\n".join([*markdown_table(HEAD, [*lines, ("all", "", "", *_numbers(errors))]), ""])


def _numbers(errors: np.ndarray) -> tuple[str, str, str]:
    return f"{errors.size}", _ms(float(errors.mean())), _ms(float(np.abs(errors).max()))


def _ms(time_s: float) -> str:
    return f"{1e3 * time_s:.2f}"


def main() -> None:
    """Prints a table for each state of the cell."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.learning.output_edges", description=__doc__)
    parser.add_argument("what", choices=["known", "hidden"])
    parser.add_argument("--edges", type=int, default=1000)
    parser.add_argument("--count", type=int, default=128, help="edges of each output in the calibration")
    parser.add_argument("--seed", type=int, default=61)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    tables, truth, timings = drawn_outputs(rng, given.what == "hidden")
    with running_cell(truth, tables, HOST, PORT) as lab:
        found = {}
        if given.what == "hidden":
            print(table(errors_of_runs(lab, rng, BEFORE), timings, {}), flush=True)
            line = ("calibrate", "outputs", "--cell", "ur5e-sim", "--count", "8")
            for _ in range(math.ceil(given.count / 8) - 1):  # one motion at a time: each may find the machine busy
                lab.command(*line)
            found = lab.command(*line, "--adopt")["outputs"]
        print(table(errors_of_runs(lab, rng, given.edges), timings, found))


if __name__ == "__main__":
    main()
