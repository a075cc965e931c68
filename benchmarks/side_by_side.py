"""Two checkouts beside each other on the same problems, in turn, in one run.

    python -m benchmarks.side_by_side OLD [--count 40] [--seed 0] [--sets pose-anywhere,...]

OLD is another checkout, such as a worktree of the last release. Each has a process of its own, which plans with the
code of its checkout; a problem is asked of one, then of the other, the first in turns. Ratios of the same run hold on a
busy machine, where times do not.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np

SETS = (
    "pose-anywhere",
    "point-anywhere",
    "target-anywhere",
    "robust-anywhere",
    "walls",
    "walls-robust",
    "boxed",
    "random-cells",
)
HERE = Path(__file__).parents[1]
LATER = 0.01  # [-] of the release time: differences that are counted
# Runs in the other checkout, which need not have this module: it knows its problem sets and `plan` alone.
PLANNER = """
import json, sys, time
from benchmarks.problem_sets import build, cell
from benchmarks.problem_sets.boxed import boxed_tasks
from benchmarks.problem_sets.obstructed import obstructed_tasks
from benchmarks.problem_sets.random_cells import random_cell_tasks
from benchmarks.walls_and_bins import _asked
from planner.errors import PlannerError
from planner.planning import SearchHints, plan

def tasks(name, count, seed):
    if name.startswith("walls"):
        return [_asked(task, name.endswith("robust")) for task in obstructed_tasks(cell("ur5e-sim"), count, seed)]
    if name == "random-cells":
        return random_cell_tasks(count, max(8, count // 3), seed)
    return boxed_tasks(count, seed) if name == "boxed" else build(name, count, seed)

made = {}
for line in sys.stdin:
    name, count, seed, i = json.loads(line)
    if name not in made:
        made[name] = tasks(name, count, seed)
    begun = time.process_time()
    try:
        found = plan(made[name][i].problem, SearchHints(offers_nearest=False))
        released, iterations = found.trajectory.release_time_s, found.iterations
    except PlannerError:
        released, iterations = None, 0
    print(json.dumps([released, time.process_time() - begun, iterations]), flush=True)
"""


class Checkout:
    """A process that plans with the code of a checkout."""

    def __init__(self, folder: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", f"import sys; sys.path.insert(0, {str(folder)!r})\n{PLANNER}"],
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def plan(self, name: str, count: int, seed: int, i: int) -> tuple[float, float]:
        """Returns the release time [s], infinite for a refusal, and the processor time [s] of a problem of a set."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps([name, count, seed, i]), file=self._process.stdin, flush=True)
        released, taken, _ = json.loads(self._process.stdout.readline())
        return float("inf") if released is None else released, taken

    def close(self) -> None:
        """Ends the process."""
        self._process.communicate()


@dataclass(frozen=True)
class Comparison:
    """Release times and processor times (n, 2) [s] of a set: old, new."""

    name: str
    released: np.ndarray
    taken: np.ndarray

    @property
    def ratios(self) -> np.ndarray:
        """Release times, new over old, of the problems that both answer."""
        both = np.isfinite(self.released).all(axis=1)
        return self.released[both, 1] / self.released[both, 0]

    def row(self) -> str:
        """Returns the set's row of the table."""
        answered = np.isfinite(self.released).sum(axis=0)
        ratios = self.ratios
        ms = 1e3 * np.quantile(self.taken, (0.5, 0.99), axis=0)
        mean = 1e3 * self.taken.mean(axis=0)
        later = int((ratios > 1.0 + LATER).sum())
        sooner = int((ratios < 1.0 - LATER).sum())
        return (
            f"| {self.name} ({len(self.released)}) | {answered[0]} / {answered[1]} "
            f"| {100 * (ratios.mean() - 1):+.1f} % | {ratios.max():.2f} | {later} / {sooner} "
            f"| {ms[0, 0]:.0f} / {ms[0, 1]:.0f} | {mean[0]:.0f} / {mean[1]:.0f} "
            f"| {ms[1, 0]:.0f} / {ms[1, 1]:.0f} |"
        )


def compared(old: Checkout, new: Checkout, name: str, count: int, seed: int) -> Comparison:
    """Asks both for every problem of a set, in turn."""
    released = np.empty((count, 2))
    taken = np.empty((count, 2))
    for each in (old, new):
        each.plan(name, count, seed, 0)  # loads what is loaded once
    for i in range(count):
        order = ((0, old), (1, new)) if i % 2 == 0 else ((1, new), (0, old))
        for column, each in order:
            released[i, column], taken[i, column] = each.plan(name, count, seed, i)
    return Comparison(name, released, taken)


@click.command()
@click.argument("old", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--count", default=40, show_default=True, help="Problems of each set.")
@click.option("--seed", default=0, show_default=True, help="Of the problem sets.")
@click.option("--sets", default=",".join(SETS), show_default=True, help="Names, separated by commas.")
def main(old: Path, count: int, seed: int, sets: str) -> None:
    """Compares the planner of another checkout, OLD, with this one's."""
    checkouts = (Checkout(old.resolve()), Checkout(HERE))
    click.echo(
        "| set | answered | release, mean | worst | > 1 % later / sooner | ms p50 | mean | p99 |\n" + "|---" * 8 + "|"
    )
    found = []
    for name in sets.split(","):
        found.append(compared(*checkouts, name, count, seed))
        click.echo(found[-1].row())
    ratios = np.concatenate([each.ratios for each in found])
    click.echo(f"\n{len(ratios)} answered by both: {100 * (ratios.mean() - 1):+.2f} % in the mean")
    for each in checkouts:
        each.close()


if __name__ == "__main__":
    main()
