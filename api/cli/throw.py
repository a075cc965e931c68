"""Commands that call a running service: throw, acknowledge."""

from __future__ import annotations

import os
from typing import Any

import click

DEFAULT_URL = "http://127.0.0.1:8000"


def _service_options(command: Any) -> Any:
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
@click.option("--window", type=float, help="A release early or late by up to this still lands … [s]")
@click.option("--tolerance", type=float, help="… within this distance of the target [m].")
@_service_options
def throw(
    x: float,
    y: float,
    z: float,
    cell: str | None,
    mode: str,
    dry_run: bool,
    window: float | None,
    tolerance: float | None,
    url: str | None,
    token: str | None,
) -> None:
    """Plan a throw that lands on X Y Z [m, world frame], execute it, and print where it landed."""
    from api.cli.client import ServiceClient

    request: dict[str, Any] = {"release": {"kind": "target", "position": [x, y, z]}}
    request |= {"cell": cell} if cell else {}
    request |= {"release_window_s": window} if window is not None else {}
    request |= {"landing_tolerance_m": tolerance} if tolerance is not None else {}
    with ServiceClient(service_url(url), token) as client:
        plan, execution = plan_and_execute(client, request, mode, dry_run)
    if execution["outcome"] != "completed":
        raise click.ClickException(f"{execution['outcome']}: {execution['reason'] or 'no reason was given'}")
    click.echo(landing_text(plan, execution))


@click.command()
@click.option("--cell", help="Cell; default: FLING_DEFAULT_CELL, or ur5e-sim.")
@_service_options
def acknowledge(cell: str | None, url: str | None, token: str | None) -> None:
    """Clear the fault that the executor latched, once a person has checked the robot."""
    from api.cli.client import ServiceClient

    name = cell or os.environ.get("FLING_DEFAULT_CELL", "ur5e-sim")
    with ServiceClient(service_url(url), token) as client:
        answer = client.post(f"/cells/{name}/acknowledge")
    click.echo(f"{name}: {answer['fault'] or 'there was no fault'}; acknowledged by {answer['acknowledged_by']}")


def plan_and_execute(client: Any, request: dict[str, Any], mode: str, dry_run: bool) -> tuple[dict[str, Any], ...]:
    """Plans, executes and prints the progress. Returns the plan (without trajectory) and the finished execution."""
    click.echo("planning …")
    plan = client.post("/plan?trajectory=false", request)
    click.echo(plan_text(plan))
    execution = client.post("/execute", {"plan_id": plan["id"], "mode": mode, "dry_run": dry_run})
    for kind, data in client.events(execution["id"]):
        if kind == "state":
            click.echo(f"  {data['state']}")
    return plan, client.get(f"/executions/{execution['id']}")


def plan_text(plan: dict[str, Any]) -> str:
    """Returns a summary of a plan in one or two lines."""
    solver = plan["solver"]
    text = (
        f"planned by {plan['backend']} in {1000 * solver['solve_time_s']:.0f} ms: release after "
        f"{plan['release_time_s']:.3f} s of {plan['duration_s']:.3f} s; "
        f"{len(plan['certificate']['checks'])} checks passed"
    )
    if plan["flight"]:
        flight = plan["flight"]
        text += f"\n  leaves at {flight['speed_m_s']:.2f} m/s, flies {flight['time_of_flight_s']:.2f} s"
    return text


def landing_text(plan: dict[str, Any], execution: dict[str, Any]) -> str:
    """Returns the landing point and the missed ticks of an execution."""
    metrics = execution["metrics"] or {}
    text = f"{metrics.get('ticks')} ticks, {metrics.get('missed_ticks')} missed"
    if metrics.get("release_velocity_error_share") is not None:
        text += f"; joint velocity at the release within {100 * metrics['release_velocity_error_share']:.2f} %"
    point, error = metrics.get("landing_point"), metrics.get("landing_error_m")
    if point is None or error is None:
        return text + "\nthe landing point is not known"
    place = ", ".join(f"{value:.4f}" for value in point)
    return f"{text}\nlanded at ({place}) m, {1000 * error:.1f} mm from where the plan said"
