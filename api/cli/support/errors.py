"""How `fling` ends: one sentence for a person or, with --json, one document; and the exit status of the contract."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from types import TracebackType
from typing import Any

import click

from api.cli.support.exit_status import INTERRUPTED, INVALID, WRONG_COMMAND_LINE, exit_status
from api.cli.support.options import JSON_FLAG


class FlingGroup(click.Group):
    """The command line: knows similar commands, and turns every error into a sentence and an exit status."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Finds the command, or names similar ones."""
        name = args[0]
        if self.get_command(ctx, name) is None and not name.startswith("-") and not ctx.resilient_parsing:
            similar = get_close_matches(name, self.list_commands(ctx), n=3)
            hint = f"did you mean {' or '.join(similar)}?" if similar else f"'{ctx.command_path} --help' lists them"
            raise click.UsageError(f"there is no command {name!r}; {hint}", ctx)
        return super().resolve_command(ctx, args)

    def main(self, args: Sequence[str] | None = None, *rest: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Runs a command and exits with its status."""
        given = list(sys.argv[1:] if args is None else args)
        if not standalone_mode:
            return super().main(given, *rest, standalone_mode=False, **extra)
        with ErrorReport(as_json=JSON_FLAG in given):
            status = super().main(given, *rest, standalone_mode=False, **extra)
            sys.exit(status if isinstance(status, int) else 0)


class ErrorReport:
    """Writes the error that leaves a block, and exits; a bug goes on with its traceback.

    Args:
        as_json: whether a machine reads it.
    """

    def __init__(self, as_json: bool) -> None:
        self._as_json = as_json

    def __enter__(self) -> None: ...

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if error is not None and not isinstance(error, SystemExit):
            _end(error, self._as_json)


class RefusedRequest(click.ClickException):
    """A request of the command line is refused, for a problem that is the service's own too.

    Args:
        problem: the problem's document.
        words: what a person reads of it; by default its title and detail.
    """

    def __init__(self, problem: dict[str, Any], words: str = "") -> None:
        super().__init__(words or f"{problem['title']}: {problem['detail']}")
        self.problem = problem


class Coordinate(click.ParamType):
    """A coordinate [m], in a command whose unknown options are arguments, so that -0.3 is a number."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Returns the number; what looks like an option is refused as one, with similar options."""
        try:
            number = float(value)
        except ValueError:
            if not str(value).startswith("-") or ctx is None:
                self.fail(f"{value!r} is not a number", param, ctx)
        else:
            if not math.isfinite(number):
                self.fail(f"{value!r} is not a finite number", param, ctx)
            return number
        known = [option for parameter in ctx.command.params for option in parameter.opts if option.startswith("-")]
        raise click.NoSuchOption(str(value), possibilities=known, ctx=ctx)


class Finite(click.FloatRange):
    """A finite number, within bounds if they are given."""

    name = "number"

    def _describe_range(self) -> str:
        return "" if self.min is None and self.max is None else super()._describe_range()

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Returns the number; NaN, which is within all bounds, and infinities are refused."""
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number", param, ctx)
        return number


def _end(error: BaseException, as_json: bool) -> None:
    """Writes an error to standard error and exits; returns where it is a bug, which needs its traceback."""
    if isinstance(error, BrokenPipeError):  # `fling … | head`: nobody reads on
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(INVALID)
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        error.show()
        sys.exit(WRONG_COMMAND_LINE)
    sentence = _sentence(error)
    if sentence is None:
        return
    status = _status(error)
    if as_json:
        problem = getattr(error, "problem", None) or {"title": type(error).__name__, "detail": sentence}
        click.echo(json.dumps({**problem, "exit_status": status}, default=str), err=True)
    else:
        click.echo(f"{click.style('fling:', fg='red', bold=True)} {sentence}", err=True)
    sys.exit(status)


def _sentence(error: BaseException) -> str | None:
    """Returns what a person reads of an error, None of a bug."""
    if isinstance(error, click.UsageError) and error.ctx is not None:
        return f"{error.format_message()} (see '{error.ctx.command_path} --help')"
    if isinstance(error, click.ClickException):
        return error.format_message()
    if isinstance(error, KeyboardInterrupt | click.Abort):
        return "interrupted"
    if isinstance(error, OSError) and error.filename is not None:
        return f"{os.fspath(error.filename)!s}: {error.strerror}"
    return _of_fling(error)


def _of_fling(error: BaseException) -> str | None:
    """Returns the sentence of an error that settings, planner or store raise on purpose."""
    purposeful = ("PlannerError", "SettingsError", "StoreError", "StoreUnavailable")
    return str(error) if {kind.__name__ for kind in type(error).__mro__} & set(purposeful) else None


def _status(error: BaseException) -> int:
    problem = getattr(error, "problem", None)
    if isinstance(problem, dict):
        return exit_status(str(problem.get("type", "")).rpartition("/")[2])
    if isinstance(error, KeyboardInterrupt | click.Abort):
        return INTERRUPTED
    if isinstance(error, click.UsageError):
        return INVALID if _names_a_missing_file(error) else WRONG_COMMAND_LINE
    return error.exit_code if isinstance(error, click.ClickException) else INVALID


def _names_a_missing_file(error: click.UsageError) -> bool:
    """Returns whether the command line is in order, and a file that it names is not there."""
    if isinstance(error, click.MissingParameter):
        return False
    return isinstance(error, click.BadParameter) and isinstance(getattr(error.param, "type", None), click.Path)
