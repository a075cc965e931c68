"""The optimal control back end: two phases, stages of free length, exact integration of constant jerk.

casadi is imported with the first use. The formulation is in docs/optimal-control.md.
"""

from __future__ import annotations

from collections.abc import Callable

from planner.backends.casadi_nlp.guess import Guess
from planner.backends.casadi_nlp.margins import CLOSE, Margins, far_off
from planner.errors import BackendUnavailable
from planner.problem import ThrowProblem
from planner.seeds.candidates import Candidate
from planner.solution import Solution

__all__ = ["CLOSE", "Guess", "Margins", "far_off", "solve", "warm"]


def solve(
    problem: ThrowProblem,
    candidate: Candidate,
    warm_start: Guess | None,
    deadline_s: float,
    margins: Margins = CLOSE,
    fine: bool = False,
    stubborn: bool = False,
) -> Solution:
    """Returns the motion of least release time next to a candidate.

    Args:
        problem: what is asked.
        candidate: where to begin; `joint` and `pose` are held to it.
        warm_start: a motion to it, best Ruckig's; None: a plain one is made up.
        deadline_s: on `time.perf_counter`, when to stop trying.
        margins: kept free of what is only looked at on knots; wider ones for when a certificate has found fault.
        fine: whether to take more stages, which are looked at more closely, and hold all rows at once.
        stubborn: whether the slow second solver is asked where the first gives up.

    Raises:
        SolverFailed: no motion was found in time.
        BackendUnavailable: casadi is not installed.
    """
    _require()
    from planner.backends.casadi_nlp import task

    return task.solve(problem, candidate, warm_start, deadline_s, margins, fine, stubborn)


def warm(progress: Callable[[str, float], None] | None = None) -> bool:
    """Compiles what has not been compiled, and builds the solvers of this process.

    Args:
        progress: is told what is being done, and the share done so far.

    Returns:
        Whether compiled functions are in use; without a compiler the interpreted ones serve, several times slower.

    Raises:
        BackendUnavailable: casadi is not installed.
    """
    _require()
    from planner.backends.casadi_nlp import warming

    return warming.warm(progress or (lambda _what, _share: None))


def _require() -> None:
    try:
        import casadi  # noqa: F401
    except ImportError as error:
        raise BackendUnavailable("casadi", "casadi") from error
