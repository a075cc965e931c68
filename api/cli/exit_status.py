"""Exit statuses of the command line."""

from __future__ import annotations

INVALID, INFEASIBLE, SOLVER_FAILED = 1, 2, 3


def exit_status(problem: str) -> int:
    """Returns the exit status for a problem type, such as `infeasible`."""
    return {"infeasible": INFEASIBLE, "solver-failed": SOLVER_FAILED}.get(problem, INVALID)
