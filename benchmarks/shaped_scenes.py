"""Share answered and audited of scenes with turned boxes, cylinders, spheres, capsules and meshes, all feasible.

    python -m benchmarks.shaped_scenes --count 300 --seed 0 --part 0 --parts 10

Targets behind walls and in bins, throws past shapes close by, and random cells, in turn. Each is asked as it is and for
other starts, whose answers are audited, too: by coal on a grid of 1 ms.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from audit.judge import find_faults
from benchmarks.problem_sets import Task, cell, obstructed_tasks, shaped_cell_tasks, shaped_tasks
from planner.errors import Infeasible, InvalidProblem, SolverFailed
from planner.planning import plan
from planner.problem import ThrowProblem

TIME_LIMIT_S = 120.0  # ample: no answer may end at the clock
STEP_S = 0.001  # of the audit's distances
SPREAD_RAD = 0.4  # of further starts about home
GROUPS = 3


def main() -> None:
    """Prints a line for each scene that is not answered or not right, and the shares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300, help="scenes of all parts")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--starts", type=int, default=6, help="further starts of each scene")
    parser.add_argument("--part", type=int, default=0)
    parser.add_argument("--parts", type=int, default=1, help="whose scenes have seeds of their own")
    given = parser.parse_args()
    found: Counter[str] = Counter()
    begun = time.perf_counter()
    for task in scenes(given.count // given.parts, 1000 * given.seed + given.part):
        for number, problem in enumerate(_asked(task, given.starts, given.seed)):
            outcome = _outcome(problem)
            kind = "scene" if number == 0 else "start"
            found[f"{task.group}: {kind}s"] += 1
            found[f"{task.group}: {kind}s {outcome.split(':')[0]}"] += 1
            if outcome != "right" and (number == 0 or outcome.startswith("wrong")):
                print(f"  {task.name}, {kind} {number}: {outcome}", flush=True)
    lines = ", ".join(f"{key} {count}" for key, count in sorted(found.items()))
    print(f"part {given.part}: {lines}; {time.perf_counter() - begun:.0f} s", flush=True)


def scenes(count: int, seed: int) -> list[Task]:
    """Returns as many scenes of each group."""
    share = -(-count // GROUPS)
    here = cell("ur5e-sim")
    walls = obstructed_tasks(here, share, seed, shaped=True)
    return [*walls, *shaped_tasks(here, share, seed), *shaped_cell_tasks(share, seed)][:count]


def _asked(task: Task, starts: int, seed: int) -> Iterator[ThrowProblem]:
    """Yields the problem of a scene, and those of other starts, as far as these may be starts at all."""
    problem = replace(task.problem, time_limit_s=TIME_LIMIT_S)
    yield problem
    rng = np.random.default_rng([seed, starts])
    for _ in range(starts):
        q = problem.start + rng.uniform(-SPREAD_RAD, SPREAD_RAD, 6)
        try:
            yield replace(problem, start=np.clip(q, problem.limits.q_lower, problem.limits.q_upper))
        except InvalidProblem:
            continue


def _outcome(problem: ThrowProblem) -> str:
    """Returns `right`, `wrong` with the faults, or `refused` with the reasons."""
    try:
        made = plan(problem)
    except (Infeasible, SolverFailed, InvalidProblem) as error:
        return f"refused: {error}"
    faults = find_faults(problem, made.trajectory, STEP_S)
    return f"wrong: {'; '.join(map(str, faults))}" if faults else "right"


if __name__ == "__main__":
    main()
