"""Problems of the benchmark: named sets, varied cells, and the tossing table of a semester project."""

from benchmarks.problem_sets.boxed import boxed_tasks
from benchmarks.problem_sets.far_starts import far_start_tasks
from benchmarks.problem_sets.named_sets import ANYWHERE, ARMS, IMPOSSIBLE_SETS, build, cell
from benchmarks.problem_sets.obstructed import obstructed_tasks, open_tasks
from benchmarks.problem_sets.random_cells import random_cell_tasks
from benchmarks.problem_sets.sdu_table import sdu_facts
from benchmarks.problem_sets.shaped import shaped_cell_tasks, shaped_tasks
from benchmarks.problem_sets.task import Task
from benchmarks.problem_sets.varied_cells import varied_tasks

__all__ = [
    "ANYWHERE",
    "ARMS",
    "IMPOSSIBLE_SETS",
    "Task",
    "boxed_tasks",
    "build",
    "cell",
    "far_start_tasks",
    "obstructed_tasks",
    "open_tasks",
    "random_cell_tasks",
    "sdu_facts",
    "shaped_cell_tasks",
    "shaped_tasks",
    "varied_tasks",
]
