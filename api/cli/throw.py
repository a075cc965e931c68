"""Commands that call a running service: throw, acknowledge."""

from __future__ import annotations

import os
from typing import Any

import click

from api.cli.summary import landing_text, plan_text

DEFAULT_URL = "http://127.0.0.1:8000"
BIN_HELP = "Throw into a round bin: its inner radius, and the height of its rim above X Y Z, the bottom's centre [m]."


def service_options(command: Any) -> Any:
    """Adds the options --url and --token to a command."""
    command = click.option("--token", envvar="FLING_TOKEN", help="Bearer token; FLING_TOKEN.")(command)
    return click.option("--url", default=None, help="URL of the service; default: FLING_URL, or this machine.")(command)


def service_url(url: str | None) -> str:
    """Returns the URL of the service: the option, FLING_URL, or this machine at FLING_PORT."""
    if url or os.environ.get("FLING_URL"):
        return url or os.environ["FLING_URL"]
    return f"http://127.0.0.1:{os.environ['FLING_PORT']}" if os.environ.get("FLING_PORT") else DEFAULT_URL


@click.command(context_settings={"ignore_unknown_options": True})  # negative coordinates are not options
@click.argument("x", type=float)
@click.argument("y", type=float)
@click.argument("z", type=float)
@click.option("--cell", help="Cell; default: the service's.")
@click.option("--mode", type=click.Choice(["speedj", "servoj"]), default="speedj", show_default=True)
@click.option("--dry-run", is_flag=True, help="Everything except motion.")
@click.option("--window", type=float, help="A release early or late by up to this [s] still lands …")
@click.option("--tolerance", type=float, help="… within this distance of the target [m].")
@click.option("--soonest", is_flag=True, help="Release as soon as possible, on time: --window 0.")
@click.option("--bin", nargs=2, type=float, metavar="RADIUS RIM", help=BIN_HELP)
@service_options
def throw(
    x: float,
    y: float,
    z: float,
    cell: str | None,
    mode: str,
    dry_run: bool,
    window: float | None,
    tolerance: float | None,
    soonest: bool,
    bin: tuple[float, float] | None,
    url: str | None,
    token: str | None,
) -> None:
    """Plan a throw that lands on X Y Z [m, world frame], execute it, and print where it landed.

    By default the object lands near the target also if the gripper opens a little early or late.
    """
    from api.cli.client import ServiceClient

    if soonest and window:
        raise click.UsageError("--soonest is a window of 0: it does not go together with --window")
    request: dict[str, Any] = {"release": _target((x, y, z), bin)}
    request |= {"cell": cell} if cell else {}
    request |= {"release_window_s": 0.0 if soonest else window} if soonest or window is not None else {}
    request |= {"landing_tolerance_m": tolerance} if tolerance is not None else {}
    with ServiceClient(service_url(url), token) as client:
        execution = execute_plan(client, make_plan(client, request), mode, dry_run)
    if execution["outcome"] != "completed":
        raise click.ClickException(f"{execution['outcome']}: {execution['reason'] or 'no reason was given'}")
    if execution["reason"]:
        click.echo(execution["reason"])
    click.echo(landing_text(execution))


def _target(position: tuple[float, float, float], bin: tuple[float, float] | None) -> dict[str, Any]:
    """Returns the release of a request that hits a point, or the bottom of a bin (inner radius, rim height) [m]."""
    release: dict[str, Any] = {"kind": "target", "position": list(position)}
    return release | ({} if bin is None else {"opening": {"radius_m": bin[0], "rim_height_m": bin[1]}})


@click.command()
@click.option("--cell", help="Cell; default: FLING_DEFAULT_CELL, or ur5e-sim.")
@service_options
def acknowledge(cell: str | None, url: str | None, token: str | None) -> None:
    """Clear the fault that the executor latched, once a person has checked the robot."""
    from api.cli.client import ServiceClient

    name = cell or os.environ.get("FLING_DEFAULT_CELL", "ur5e-sim")
    with ServiceClient(service_url(url), token) as client:
        answer = client.post(f"/cells/{name}/acknowledge")
    click.echo(f"{name}: {answer['fault'] or 'there was no fault'}; acknowledged by {answer['acknowledged_by']}")


def make_plan(client: Any, request: dict[str, Any]) -> dict[str, Any]:
    """Plans and prints what was planned. Returns the plan, without its trajectory."""
    click.echo("planning …")
    plan = client.post("/plan?trajectory=false", request)
    click.echo(plan_text(plan))
    return plan


def execute_plan(client: Any, plan: dict[str, Any], mode: str, dry_run: bool) -> dict[str, Any]:
    """Executes a plan and prints the progress. Returns the finished execution."""
    execution = client.post("/execute", {"plan_id": plan["id"], "mode": mode, "dry_run": dry_run})
    for kind, data in client.events(execution["id"]):
        if kind == "state":
            click.echo(f"  {data['state']}")
    return client.get(f"/executions/{execution['id']}")
