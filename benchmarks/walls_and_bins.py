"""Share answered and times of targets behind walls and in bins, against the same targets in the open.

    python -m benchmarks.walls_and_bins --count 60 --seed 0

Every answer is judged again by `audit.judge`, which shares no code with the certificate.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import replace

import numpy as np

from audit.judge import flight_faults
from benchmarks.problem_sets import Task, cell, obstructed_tasks, open_tasks
from planner.errors import Infeasible, SolverFailed
from planner.planning import Plan, plan
from planner.problem import TargetRelease, ThrowProblem
from planner.request import problem_from_request, request_document

TIME_LIMIT_S = 120.0  # ample: no answer may end at the clock


def main() -> None:
    """Prints one line a problem, and the shares and times of each set."""
    options = _options()
    tasks = obstructed_tasks(cell(options.cell), options.count, options.seed)
    for robust in {"soonest": (False,), "robust": (True,), "both": (False, True)}[options.window]:
        _run("robust" if robust else "soonest", [_asked(task, robust) for task in tasks], options.verbose)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cell", default="ur5e-sim")
    parser.add_argument("--window", choices=("soonest", "robust", "both"), default="both")
    parser.add_argument("--verbose", action="store_true", help="print every problem that is not answered soundly")
    return parser.parse_args()


def _asked(task: Task, robust: bool) -> Task:
    """Returns the task with the window that a request without one gets, or without a window."""
    request = request_document(task.problem, task.problem.release)
    del request["landing_tolerance_m"], request["limits"]
    request["release_window_s"] = 0.0
    if robust:
        del request["release_window_s"]
    problem = replace(problem_from_request(request, task.problem.cell), time_limit_s=TIME_LIMIT_S)
    return replace(task, problem=problem)


def _run(name: str, tasks: list[Task], verbose: bool) -> None:
    answered = Counter()
    unsound = Counter()
    ms = []
    open_ms = []
    release_s = []
    backends: Counter[str] = Counter()
    for task, open_task in zip(tasks, open_tasks(tasks), strict=True):
        _, duration = _timed(open_task.problem)
        open_ms.append(duration)
        made, duration = _timed(task.problem)
        if isinstance(made, Plan):
            faults = flight_faults(task.problem, made.trajectory)
            unsound[task.group] += bool(faults)
            answered[task.group] += not faults
            ms.append(duration)
            release_s.append(made.trajectory.release_time_s)
            backends[made.backend] += 1
            outcome = "; ".join(map(str, faults))
        else:
            outcome = f"refused in {duration:.0f} ms: {made}"
        if verbose and outcome:
            print(f"  {task.name} {_described(task.problem)}: {outcome}", flush=True)
    asked = Counter(task.group for task in tasks)
    groups = ", ".join(f"{group} {answered[group]}/{asked[group]}" for group in asked)
    print(f"{name}: {answered.total()} of {len(tasks)} answered and clear ({groups}); {unsound.total()} not clear")
    print(
        f"  ms {_quantiles(ms)}; open targets {_quantiles(open_ms)}; ratio p50 {np.median(ms) / np.median(open_ms):.2f}"
    )
    print(f"  release s {_quantiles(release_s, 3)}; {dict(backends)}", flush=True)


def _timed(problem: ThrowProblem) -> tuple[Plan | Infeasible | SolverFailed, float]:
    """Returns the answer and its time [ms]."""
    begun = time.perf_counter()
    try:
        made = plan(problem)
    except (Infeasible, SolverFailed) as error:
        made = error
    return made, 1e3 * (time.perf_counter() - begun)


def _described(problem: ThrowProblem) -> str:
    release = problem.release
    assert isinstance(release, TargetRelease)
    boxes = [f"{np.round(b.lower, 2)}..{np.round(b.upper, 2)}" for b in problem.cell.surroundings.keep_out]
    return f"{np.round(release.p_W, 2)} {release.opening or ''} {boxes}"


def _quantiles(values: list[float], digits: int = 0) -> str:
    return "p50 {:.{d}f} p90 {:.{d}f}".format(*np.quantile(values or [np.nan], [0.5, 0.9]), d=digits)


if __name__ == "__main__":
    main()
