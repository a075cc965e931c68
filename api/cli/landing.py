"""`fling landing`: report where the object of an execution landed, or list the reports."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from api.cli.support.errors import Coordinate, Finite
from api.cli.support.options import calls_service, json_option

if TYPE_CHECKING:
    from api.cli.support.client import ServiceClient

STD_M = 0.005  # [m] chosen: a careful measurement with a tape


@click.command(context_settings={"ignore_unknown_options": True})  # negative coordinates are not options
@click.argument("execution")
@click.argument("position", nargs=-1, type=Coordinate(), metavar="[X Y Z]")
@click.option(
    "--std", "std_m", type=Finite(), default=STD_M, show_default=True, help="Standard deviation along axes [m]."
)
@click.option("--hit", type=Finite(), metavar="RADIUS", help="It landed within RADIUS of the target [m].")
@click.option("--edge", type=Finite(), metavar="RADIUS", help="It landed on the edge of that.")
@click.option("--miss", type=Finite(), metavar="RADIUS", help="It landed farther from the target than that.")
@click.option("--source", default="person", show_default=True, help="What observed it.")
@json_option
@calls_service
def landing(
    execution: str,
    position: tuple[float, ...],
    std_m: float,
    hit: float | None,
    edge: float | None,
    miss: float | None,
    source: str,
    as_json: bool,
    client: ServiceClient,
) -> None:
    """Report where the object of EXECUTION landed: X Y Z [m, world frame], or --hit, --edge, --miss of the target.

    EXECUTION is an id, or `latest` on a simulated cell. Without a report the ones so far are listed.
    """

    results = {name: radius for name, radius in (("hit", hit), ("edge", edge), ("miss", miss)) if radius is not None}
    report = _report(position, std_m, results)
    path = f"/executions/{execution}/landing"
    answer = client.get(path) if report is None else client.post(path, {**report, "source": source})
    rows = answer["landings"] if report is None else [answer]
    click.echo(json.dumps(answer) if as_json else "\n".join(map(_text, rows)) or "no landing was reported")


def _report(position: tuple[float, ...], std_m: float, results: dict[str, float]) -> dict[str, Any] | None:
    """Returns the observation to post, None where there is none.

    Raises:
        click.UsageError: it is not one position, nor one result.
    """
    if len(position) not in (0, 3) or len(results) + bool(position) > 1:
        raise click.UsageError("give X Y Z, or one of --hit, --edge, --miss; nothing lists the reports")
    if position:
        return {"position": list(position), "std_m": std_m}
    return next(({"result": name, "radius_m": radius} for name, radius in results.items()), None)


def _text(row: dict[str, Any]) -> str:
    """Returns one observation in a line."""
    who = row["source"] + (f", {row['reported_by']}" if row["reported_by"] else "")
    if row["position"] is None:
        return f"{row['at']}  {row['result']} of {row['radius_m']:.3f} m  ({who})"
    place = ", ".join(f"{x:.4f}" for x in row["position"])
    return f"{row['at']}  ({place}) m ± {row['std_m']:.4f} m  ({who})"
