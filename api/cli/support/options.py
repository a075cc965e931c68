"""Options that several commands have, each defined once; and which service and cell they mean."""

from __future__ import annotations

import os
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from planner.arrays import Array

JSON_FLAG = "--json"
PORT = click.IntRange(0, 65535)
DEFAULT_URL = "http://127.0.0.1:8000"
DEFAULT_CELL_HELP = "Cell; default: FLING_DEFAULT_CELL."  # of commands on this machine
SERVICE_CELL_HELP = "Cell; default: the service's."  # of commands that call a service


def json_option(command: Any) -> Any:
    """Adds the option --json to a command."""
    return click.option(JSON_FLAG, "as_json", is_flag=True, help="Answer in JSON, errors too.")(command)


def service_options(command: Any) -> Any:
    """Adds the options --url and --token to a command."""
    command = click.option("--token", envvar="FLING_TOKEN", help="Bearer token; FLING_TOKEN.")(command)
    return click.option("--url", default=None, help="URL of the service; default: FLING_URL, or this machine.")(command)


def calls_service(command: Any) -> Any:
    """Adds the options --url and --token to a command, and gives it the client of the service that they mean."""

    @wraps(command)
    def with_client(url: str | None, token: str | None, **given: Any) -> Any:
        from api.cli.support.client import ServiceClient

        with ServiceClient(service_url(url), token) as client:
            return command(client=client, **given)

    return service_options(with_client)


def service_url(url: str | None) -> str:
    """Returns the URL of the service: the option, FLING_URL, or this machine at FLING_PORT."""
    if url or os.environ.get("FLING_URL"):
        return url or os.environ["FLING_URL"]
    return f"http://127.0.0.1:{os.environ['FLING_PORT']}" if os.environ.get("FLING_PORT") else DEFAULT_URL


def cell_option(*names: str, service: bool = False) -> Any:
    """Returns the option --cell, of this machine's default cell or of the service's.

    Args:
        names: of the parameter, where it is not `cell`.
        service: whether the service knows the default.
    """
    return click.option("--cell", *names, help=SERVICE_CELL_HELP if service else DEFAULT_CELL_HELP)


def cell_of_service(client: Any, cell: str | None) -> str:
    """Returns the name of the cell that is meant: the option, or the default cell of the service.

    Raises:
        click.ClickException: the service has no default cell.
    """
    if cell is not None:
        return cell
    default = next((row["name"] for row in client.get("/cells")["cells"] if row["default"]), None)
    if default is None:
        raise click.ClickException("the service has no default cell: name one with --cell")
    return str(default)


def pose_option(values: tuple[float, ...], option: str) -> Array:
    """Returns the pose (4, 4) that an option gives as a position [m] and a rotation vector [rad].

    Raises:
        click.BadParameter: a value is no number, or the rotation is beyond a full turn.
    """
    import numpy as np

    from planner.rotations import beyond_full_turn, pose, rotation_vector_to_matrix

    if reason := beyond_full_turn(values[3:]) if np.isfinite(values).all() else "must be numbers":
        raise click.BadParameter(reason, param_hint=option)
    return pose(np.array(values[:3]), rotation_vector_to_matrix(np.array(values[3:])))
