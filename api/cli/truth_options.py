"""Options of the commands that start a simulated controller: how its arm, gripper, object and camera really behave."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click


def truth_options(command: Any) -> Any:
    """Adds the options --truth and --reveal of a simulated controller to a command."""
    kind = click.Path(exists=True, dir_okay=False, path_type=Path)
    command = click.option("--reveal", is_flag=True, help="Tell what --truth hides: the true release and landing.")(
        command
    )
    return click.option("--truth", type=kind, help="How arm, gripper, object and camera really behave (TOML).")(command)


def truth_arguments(truth: Path | None, reveal: bool) -> list[str]:
    """Returns the arguments that give a simulated controller its truth file."""
    return [*(["--truth", str(truth)] if truth else []), *(["--reveal"] if reveal else [])]
