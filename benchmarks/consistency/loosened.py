"""Metamorphic pairs: a problem, and the same with one limit loosened.

Whatever solves a problem solves it with a limit loosened. So where the tighter problem is answered, the looser one must
be, and no later; a tick is allowed, because release times are rounded up to ticks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from benchmarks.problem_sets import Task
from planner.errors import Infeasible, SolverFailed
from planner.planning import plan
from planner.problem import ThrowProblem

TIME_LIMIT_S = 60.0  # [s] ample: no answer may end at the request's own deadline
TICK_SLACK = 1e-6  # [ticks] rounding


def _window_off(problem: ThrowProblem) -> ThrowProblem:
    return replace(problem, release_window_s=0.0, landing_tolerance_m=0.0)


def _more_jerk(problem: ThrowProblem, factor: float) -> ThrowProblem:
    return replace(problem, limits=replace(problem.limits, jerk_max=factor * problem.limits.jerk_max))


def _more_acceleration(problem: ThrowProblem) -> ThrowProblem:
    return replace(problem, limits=replace(problem.limits, qdd_max=2.0 * problem.limits.qdd_max))


def _box_removed(problem: ThrowProblem) -> ThrowProblem:
    here = problem.cell
    return replace(problem, cell=replace(here, surroundings=replace(here.surroundings, keep_out=())))


LOOSENED: dict[str, Callable[[ThrowProblem], ThrowProblem]] = {
    "window off": _window_off,
    "jerk x 2": lambda problem: _more_jerk(problem, 2.0),
    "jerk x 4": lambda problem: _more_jerk(problem, 4.0),
    "acceleration x 2": _more_acceleration,
    "box removed": _box_removed,
}


@dataclass(frozen=True)
class Pair:
    """A problem and a looser one, both as answered.

    Attributes:
        task: name of the problem.
        loosened: key of `LOOSENED`.
        tight_s: release time of the tighter problem [s].
        loose_s: release time of the looser one [s]; None where it is refused.
        tick_s: one tick [s].
    """

    task: str
    loosened: str
    tight_s: float
    loose_s: float | None
    tick_s: float

    @property
    def is_later(self) -> bool:
        """Whether the looser problem is answered later by more than a tick."""
        return self.loose_s is not None and self.loose_s > self.tight_s + (1.0 + TICK_SLACK) * self.tick_s


def pairs_of(task: Task) -> list[Pair]:
    """Returns a task's pairs with everything that can be loosened; none where the task itself is refused."""
    problem = replace(task.problem, time_limit_s=TIME_LIMIT_S)
    tight_s = release_time(problem)
    if tight_s is None:
        return []
    return [
        Pair(task.name, name, tight_s, release_time(loosen(problem)), problem.dt)
        for name, loosen in LOOSENED.items()
        if _is_limited(name, problem)
    ]


def _is_limited(name: str, problem: ThrowProblem) -> bool:
    """Returns whether a problem has what `LOOSENED[name]` loosens."""
    return {"window off": problem.is_robust, "box removed": bool(problem.cell.surroundings.keep_out)}.get(name, True)


def release_time(problem: ThrowProblem) -> float | None:
    """Returns the release time of the answer [s], None where it is refused."""
    try:
        return plan(problem).trajectory.release_time_s
    except (Infeasible, SolverFailed):
        return None
