"""What a terminal shows more than a file: colour, and the time since the command began."""

from __future__ import annotations

import os
import sys
import time
from typing import Any

import click

GOOD = {"fg": "green"}
BAD = {"fg": "red"}
FAINT = {"dim": True}
_BEGUN_S = time.monotonic()  # of this process


def is_terminal() -> bool:
    """Returns whether a person reads standard output as it is written."""
    return sys.stdout.isatty()


def wants_colour() -> bool | None:
    """Returns False where NO_COLOR forbids colour (source: no-color.org), None where the stream decides."""
    return False if os.environ.get("NO_COLOR") else None


def say(text: str, style: dict[str, Any] | None = None, err: bool = False) -> None:
    """Writes a line, in colour on a terminal."""
    click.echo(click.style(text, **(style or {})), err=err, color=wants_colour())


def say_step(text: str) -> None:
    """Writes a step of a running command: on a terminal after the time since the command began."""
    if is_terminal():
        click.echo(f"{click.style(elapsed(), **FAINT)}  {text}", color=wants_colour())
    else:
        click.echo(text)


def elapsed() -> str:
    """Returns the time since the command began, to a tenth of a second."""
    return f"{time.monotonic() - _BEGUN_S:6.1f} s"
