"""`fling landing`: report where the object of an execution landed, or list the reports."""

from __future__ import annotations

import json
import math
import sys
from typing import TYPE_CHECKING, Any

import click

from api.cli.support.errors import Coordinate, Finite
from api.cli.support.options import calls_service, json_option

if TYPE_CHECKING:
    from api.cli.support.client import ServiceClient

STD_M = 0.005  # [m] chosen: a careful measurement with a tape
FAR_M = 1.0  # [m] chosen: a place farther from the planned landing is more likely a slip than a landing; the page's too


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
@click.option("--withdraw", metavar="LANDING", help="Withdraw a report by its id, or `latest`; it counts no more.")
@click.option("--yes", is_flag=True, help="Report also what looks like a slip, without being asked.")
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
    withdraw: str | None,
    yes: bool,
    as_json: bool,
    client: ServiceClient,
) -> None:
    """Report where the object of EXECUTION landed: X Y Z [m, world frame], or --hit, --edge, --miss of the target.

    EXECUTION is an id, or `latest` on a simulated cell. Without a report the ones so far are listed. You are asked
    first where the place is far from the planned landing, or `latest` is one of a series.
    """

    results = {name: radius for name, radius in (("hit", hit), ("edge", edge), ("miss", miss)) if radius is not None}
    report = _report(position, std_m, results)
    if withdraw is not None and report is not None:
        raise click.UsageError("--withdraw takes a report back: give no other with it")
    path = f"/executions/{execution}/landing"
    if withdraw is None and report is None:
        answer = client.get(path)
        rows = "\n".join(map(_text, answer["landings"]))
        click.echo(json.dumps(answer) if as_json else rows or "no landing was reported")
        return
    throw = _Throw(client, execution)
    if report is None:
        answer = client.post(f"{throw.path}/{withdraw}/withdraw", None)
    else:
        if not yes:
            _ask(throw.doubts(position, execution == "latest"), as_json)
        answer = client.post(path if execution == "latest" else throw.path, {**report, "source": source})
    click.echo(json.dumps(answer) if as_json else f"{throw.words}\n{_text(answer)}")


class _Throw:
    """The throw that a report goes to."""

    def __init__(self, client: ServiceClient, execution: str) -> None:
        document = client.get(f"/executions/{execution}")
        self.id: str = document["id"]
        self.path = f"/executions/{self.id}/landing"
        self.series: str | None = document["experiment_id"]
        self.at: str = document["created_at"]
        flight = client.get(f"/plans/{document['plan_id']}?trajectory=false")["flight"]
        self.planned: list[float] | None = None if flight is None else flight["landing_point"]

    @property
    def words(self) -> str:
        """Names it: when it was, and where it was to land."""
        if self.planned is None:
            return f"throw {self.id} of {self.at}"
        place = ", ".join(f"{x:.2f}" for x in self.planned)
        return f"throw {self.id} of {self.at}, which was to land at ({place})"

    def doubts(self, position: tuple[float, ...], is_latest: bool) -> list[str]:
        """Returns why a report of a place (3,) [m], or of a result (), may be a slip."""
        found = []
        apart = math.dist(position, self.planned) if position and self.planned is not None else 0.0
        if apart > FAR_M:
            found.append(f"({', '.join(f'{x:g}' for x in position)}) is {apart:.1f} m from there")
        if is_latest and self.series is not None:
            found.append("it is the last of a series: `latest` means none of the others")
        return [f"this is {self.words}; {doubt}" for doubt in found]


def _ask(doubts: list[str], as_json: bool) -> None:
    """Asks whether a doubtful report is meant.

    Raises:
        click.ClickException: Nobody can be asked.
        click.Abort: It is not.
    """
    for doubt in doubts:
        if as_json or not sys.stdin.isatty():
            raise click.ClickException(f"{doubt}; --yes reports it all the same")
        click.confirm(f"{doubt}. Report it all the same?", abort=True, err=True)


def _report(position: tuple[float, ...], std_m: float, results: dict[str, float]) -> dict[str, Any] | None:
    """Returns the observation to post, None where there is none.

    Raises:
        click.UsageError: It is not one position, nor one result.
    """
    if len(position) not in (0, 3):
        raise click.UsageError(f"a place has three coordinates, X Y Z; {len(position)} were given")
    given = [*(["X Y Z"] if position else []), *(f"--{name}" for name in results)]
    if len(given) > 1:
        raise click.UsageError(f"{' and '.join(given)} were given: a report is one of X Y Z, --hit, --edge, --miss")
    if position:
        return {"position": list(position), "std_m": std_m}
    return next(({"result": name, "radius_m": radius} for name, radius in results.items()), None)


def _text(row: dict[str, Any]) -> str:
    """Returns one observation in a line."""
    who = row["source"] + (f", {row['reported_by']}" if row["reported_by"] else "")
    who += "; withdrawn" if row.get("withdrawn_at") else ""
    if row["position"] is None:
        return f"{row['at']}  {row['result']} of {row['radius_m']:.3f} m  ({who})"
    place = ", ".join(f"{x:.4f}" for x in row["position"])
    return f"{row['at']}  ({place}) m ± {row['std_m']:.4f} m  ({who})"
