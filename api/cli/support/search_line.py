"""One line about a search for a plan while it goes on, and a sentence where Ctrl-C ends it."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import TYPE_CHECKING, Self

import click

from api.cli.support.exit_status import Interrupted

if TYPE_CHECKING:
    from planner.progress import Progress

LINE_S = 5.0  # [s] between two lines where standard error is no terminal
ERASED = "\r\x1b[K"  # carriage return, erase to the end of the line; source: ECMA-48


class SearchLine:
    """Observes a search: on a terminal its line is rewritten in place, elsewhere one is written every few seconds.

    A context manager, which erases the line and turns Ctrl-C into what the search had come to.

    Args:
        is_quiet: whether nothing is written meanwhile.
    """

    def __init__(self, is_quiet: bool = False) -> None:
        self._is_quiet = is_quiet
        self._is_terminal = sys.stderr.isatty()
        self._newest: Progress | None = None
        self._due_s = LINE_S

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._is_terminal and self._newest is not None and not self._is_quiet:
            click.echo(ERASED, nl=False, err=True)
        if isinstance(error, KeyboardInterrupt):
            raise Interrupted(_interrupted_text(self._newest)) from None

    def __call__(self, progress: Progress) -> None:
        """Takes the progress of the search."""
        self._newest = progress
        if self._is_quiet:
            return
        if self._is_terminal:
            click.echo(f"{ERASED}  {progress_text(progress)}", nl=False, err=True)
        elif progress.elapsed_s >= self._due_s:
            self._due_s = progress.elapsed_s + LINE_S
            click.echo(f"  {progress_text(progress)}", err=True)


def progress_text(progress: Progress) -> str:
    """Returns what a search has come to, in less than 80 characters."""
    if progress.stage == "queued":
        return f"waiting for a planner, {progress.elapsed_s:.1f} s"
    found = f"{_counted(progress.candidates)} tried"
    if progress.stage == "nearest":
        return f"refused; looking for one that works: {found}, {progress.elapsed_s:.1f} s"
    return f"searching: {found}, {_best_text(progress)}, {progress.elapsed_s:.1f} s"


def _interrupted_text(progress: Progress | None) -> str:
    """Returns what the search had come to when it was ended."""
    if progress is None:
        return "interrupted before the search began; nothing was planned"
    spent = f"{progress.elapsed_s:.1f} s and {_counted(progress.candidates)}"
    if progress.stage == "nearest":
        return f"interrupted after {spent}: the request had been refused; the search for one that works was cut short"
    return f"interrupted after {spent}: so far {_best_text(progress)}; nothing was planned"


def _best_text(progress: Progress) -> str:
    best_s = progress.best_release_time_s
    return "nothing certified yet" if best_s is None else f"best release at {best_s:.3f} s"


def _counted(candidates: int) -> str:
    return f"{candidates} candidate" if candidates == 1 else f"{candidates} candidates"
