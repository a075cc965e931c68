"""The versioned problem sets: drawn once, kept in `sets/`, told by their hash; and hidden cells, drawn from any seed.

A file holds what problems of one cell share once; `load_set` returns every problem whole, as a peer gets it.

    python -m benchmarks.throwbench.sets      # draws those sets whose file is missing, and prints the hashes
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from benchmarks.problem_sets import Task, build, cell, obstructed_tasks, random_cell_tasks
from benchmarks.throwbench.problem_document import Problem, problem_document
from planner.problem import TargetRelease

FOLDER = Path(__file__).parent / "sets"
SHARED = ("throwbench", "cell", "sample_rate_hz", "arm", "base", "tool", "object", "limits", "surroundings")
SEED = 1717  # of the sets that are kept
HIDDEN = "hidden-cells-2"  # the set that is drawn from a seed; its version is that of the drawing
HIDDEN_CELLS = 12  # random cells; problems take turns among them
HIDDEN_COUNT = 24  # problems, unless another number is asked for

# Hashes of the problems. A set never changes: what is to be better gets the next number.
HASHES = {
    "sdu-near-2": "b2dc37afec025b3eab3ca9cc07a67bf5cfff316e76d019e394697fd3f2bfdd78",
    "sdu-far-2": "bef5a3058e135e8e7347ec03048c9e6a3a9723cf5707ca5d5d40878c5102f19c",
    "random-2": "8d0c1a01a91fa737885a60a55a596b12dfac3183bae453e88d20fead10539e26",
    "window-2": "5319cfd03dd3d338fda168109aec9513ab0bd5d8b411953d9582aea8cd7ba3e8",
    "walls-2": "4cc44e2aff364b1d6cfa3ddc7ec65745fc49361e5cf9bdbf3b7a3dc3150cf5a2",
    "bins-2": "df42b49d6d8711d4dbe77e02b497bfe9f697e4102bf18b10851a1783b865c1fb",
}


class SetChanged(Exception):
    """The problems of a set are not those of its hash."""


def load_set(name: str) -> list[Problem]:
    """Returns the problems of a set.

    Raises:
        SetChanged: Its file was changed.
    """
    kept = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    problems = [kept["cells"][problem["shared"]] | problem for problem in kept["problems"]]
    for problem in problems:
        del problem["shared"]
    if (found := hash_of(problems)) != HASHES[name]:
        raise SetChanged(f"{name}: the problems' sha256 is {found}, not {HASHES[name]}")
    return problems


def hidden_name(seed: int) -> str:
    """Returns the name of the hidden cells of a seed."""
    return f"{HIDDEN}-seed-{seed}"


def hidden_problems(count: int, seed: int) -> list[Problem]:
    """Returns `count` throws in random cells; the same number and seed give the same problems."""
    drawn = count
    tasks = []
    while len(tasks) < count:
        drawn *= 2
        tasks = [
            t for t in random_cell_tasks(drawn, HIDDEN_CELLS, seed) if isinstance(t.problem.release, TargetRelease)
        ]
    return _documents(hidden_name(seed), tasks[:count])


def hash_of(problems: list[Problem]) -> str:
    """Returns the SHA-256 of problems: of their JSON with sorted keys and without spaces."""
    text = json.dumps(problems, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def spread(problems: list[Problem], count: int | None) -> list[Problem]:
    """Returns `count` problems spread evenly over a set, or all."""
    total = len(problems)
    return problems if count is None or count >= total else [problems[i * total // count] for i in range(count)]


def export(folder: Path, count: int, seed: int) -> list[Path]:
    """Writes every set whole, and `count` problems of the hidden cells. Returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    sets = {name: load_set(name) for name in HASHES} | {hidden_name(seed): hidden_problems(count, seed)}
    files = []
    for name, problems in sets.items():
        files.append(folder / f"{name}.json")
        document = {"name": name, "sha256": hash_of(problems), "problems": problems}
        files[-1].write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return files


def _drawn(name: str) -> list[Task]:
    """Returns the tasks of a set that is kept."""
    match name:
        case "sdu-near-2" | "sdu-far-2":
            return build(name.removesuffix("-2"), 0, SEED)
        case "random-2":
            return build("target-anywhere", 40, SEED)
        case "window-2":
            return build("robust-anywhere", 24, SEED)
    groups = {"walls-2": ("wall",), "bins-2": ("bin", "wall-bin")}[name]
    tasks = obstructed_tasks(cell("ur5e-sim"), 48, SEED)
    return [task for task in tasks if task.group in groups][:24]


def _documents(name: str, tasks: list[Task]) -> list[Problem]:
    return [problem_document(f"{name}/{i:04d}", task.problem) for i, task in enumerate(tasks)]


def _write(name: str, problems: list[Problem]) -> None:
    cells: dict[str, dict[str, Any]] = {}
    rows = []
    for problem in problems:
        shared = cells.setdefault(problem["cell"], {key: problem[key] for key in SHARED})
        own = {key: value for key, value in problem.items() if shared.get(key) != value}
        rows.append({"shared": problem["cell"], **own})
    lines = ",\n".join(json.dumps(row) for row in rows)
    text = f'{{"name": "{name}",\n"cells": {json.dumps(cells)},\n"problems": [\n{lines}\n]}}\n'
    (FOLDER / f"{name}.json").write_text(text, encoding="utf-8")


def main() -> None:
    """Draws the sets whose file is missing."""
    for name in HASHES:
        if not (FOLDER / f"{name}.json").exists():
            problems = _documents(name, _drawn(name))
            _write(name, problems)
            print(f'    "{name}": "{hash_of(problems)}",')


if __name__ == "__main__":
    main()
