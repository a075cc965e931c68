"""Exit statuses of the command line."""

from __future__ import annotations

import click

INVALID = 1
INFEASIBLE = 2
SOLVER_FAILED = 3
NOT_COMPLETED = 4
WRONG_COMMAND_LINE = 64  # source: sysexits.h, EX_USAGE
INTERRUPTED = 130  # source: shells, 128 + SIGINT


class NotCompleted(click.ClickException):
    """An execution ended otherwise than completed."""

    exit_code = NOT_COMPLETED


class Interrupted(click.ClickException):
    """A person has ended the command, which says what it had come to."""

    exit_code = INTERRUPTED


def exit_status(problem: str) -> int:
    """Returns the exit status for a problem type, such as `infeasible`."""
    return {"infeasible": INFEASIBLE, "solver-failed": SOLVER_FAILED}.get(problem, INVALID)
