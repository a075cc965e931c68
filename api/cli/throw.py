"""Commands that call a running service: throw, abort, acknowledge."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.support.errors import Coordinate, Finite
from api.cli.support.exit_status import NotCompleted
from api.cli.support.options import calls_service, cell_of_service, cell_option, json_option
from api.cli.support.progress import execute_plan, make_plan
from api.cli.support.series import LOAD_HELP, LoadStep, load_step, read_targets, run_series, series_text
from api.cli.support.summary import ending_text, landing_text
from api.cli.support.terminal import say_step

if TYPE_CHECKING:
    from api.cli.support.client import ServiceClient

ODDS_HELP = "Minimum hit probability within --tolerance [-]; the release may be later for it."
BIN_HELP = "Throw into a round bin: its inner radius, and the height of its rim above X Y Z, the bottom's centre [m]."

WITHOUT_FAULT = ("refused", "aborted", "held")  # outcomes after which the executor goes on; docs/executor.md


@click.command(context_settings={"ignore_unknown_options": True})  # negative coordinates are not options
@click.argument("position", nargs=-1, type=Coordinate(), metavar="X Y Z")
@click.option("--targets", type=click.Path(exists=True, dir_okay=False, path_type=Path), help="File: X Y Z a line [m].")
@click.option("--repeat", type=click.IntRange(1, 10000), help="Throw this often at each target, as one experiment.")
@click.option("--load", help=LOAD_HELP)
@click.option("--name", default="", help="Name of the experiment.")
@json_option
@cell_option(service=True)
@click.option("--mode", type=click.Choice(["speedj", "servoj", "script"]), default="speedj", show_default=True)
@click.option("--dry-run", is_flag=True, help="Everything except motion.")
@click.option("--window", type=Finite(), help="A release early or late by up to this [s] still lands …")
@click.option("--tolerance", type=Finite(), help="… within this distance of the target [m].")
@click.option("--soonest", is_flag=True, help="Release as soon as possible, on time: --window 0.")
@click.option("--odds", type=Finite(0.0, 1.0), help=ODDS_HELP)
@click.option("--bin", nargs=2, type=Finite(), metavar="RADIUS RIM", help=BIN_HELP)
@calls_service
def throw(
    position: tuple[float, ...],
    targets: Path | None,
    repeat: int | None,
    load: str | None,
    name: str,
    as_json: bool,
    cell: str | None,
    mode: str,
    dry_run: bool,
    window: float | None,
    tolerance: float | None,
    soonest: bool,
    odds: float | None,
    bin: tuple[float, float] | None,
    client: ServiceClient,
) -> None:
    """Plan a throw that lands on X Y Z [m, world frame], execute it, and print where it landed.

    By default the object lands near the target also if the gripper opens a little early or late. --odds 0.9 asks for
    the soonest release of those tried that hits with nine in ten at least. --repeat and --targets
    make a series of it, with one record: GET /experiments/{id}.
    """

    if (len(position) != 3) == (targets is None) or (targets is not None and position):
        raise click.UsageError("give X Y Z, or --targets FILE")
    if dry_run and (targets is not None or repeat is not None):
        raise click.UsageError("--dry-run moves nothing: there is no series of it")
    if soonest and window:
        raise click.UsageError("--soonest is a window of 0: it does not go together with --window")
    request: dict[str, Any] = {"cell": cell} if cell else {}
    request |= {"release_window_s": 0.0 if soonest else window} if soonest or window is not None else {}
    request |= {"landing_tolerance_m": tolerance} if tolerance is not None else {}
    request |= {"min_hit_probability": odds} if odds is not None else {}
    places = [position] if targets is None else read_targets(targets)
    requests = [{**request, "release": _target(place, bin)} for place in places]
    step = load_step(load)
    if targets is None and repeat is None:
        _one_throw(client, requests[0], mode, dry_run, as_json)
    else:
        settings = {"name": name, "repeat": repeat or 1, "load": load, "requests": requests, "mode": mode}
        _series(client, step, settings, as_json)


def _one_throw(client: Any, request: dict[str, Any], mode: str, dry_run: bool, as_json: bool) -> None:
    if not as_json and request.get("min_hit_probability"):
        say_step(_odds_note(request))
    plan = make_plan(client, request, progress=not as_json)
    execution = execute_plan(client, plan, mode, dry_run, progress=not as_json)
    if as_json:
        click.echo(json.dumps(execution))
    if execution["outcome"] != "completed":
        raise NotCompleted(_ending_text(execution))
    if not as_json:
        observed = client.get(f"/executions/{execution['id']}/landing")["landings"]
        click.echo("\n".join(filter(None, [execution["reason"], landing_text(execution, observed)])))


def _ending_text(execution: dict[str, Any]) -> str:
    """Returns how a throw ended that was not completed, and what to do next."""
    said = ending_text(execution)
    latched = execution["outcome"] not in WITHOUT_FAULT
    return f"{said}; a fault is latched: check the robot, then 'fling acknowledge'" if latched else said


def _odds_note(request: dict[str, Any]) -> str:
    """Returns what is asked for with --odds: it takes longest, and is refused most, where a hit is a narrow thing."""
    tolerance = request.get("landing_tolerance_m")
    narrow = "the object's radius of the target, at least 1 cm; --tolerance makes it wider"
    within = f"{tolerance:g} m of the target" if tolerance is not None else narrow
    within = "the bin" if "opening" in request["release"] else within
    return f"up to eight plans for odds of {request['min_hit_probability']:.0%}; a hit is within {within}"


def _series(client: Any, load: LoadStep, settings: dict[str, Any], as_json: bool) -> None:
    experiment = run_series(client, load, settings)
    click.echo(json.dumps(experiment) if as_json else series_text(experiment))
    outcomes = experiment["statistics"]["outcomes"]
    if set(outcomes) - {"completed"}:
        raise NotCompleted(f"the series ended early: {outcomes}")


def _target(position: Sequence[float], bin: tuple[float, float] | None) -> dict[str, Any]:
    """Returns the release of a request that hits a point, or the bottom of a bin (inner radius, rim height) [m]."""
    release: dict[str, Any] = {"kind": "target", "position": list(position)}
    return release | ({} if bin is None else {"opening": {"radius_m": bin[0], "rim_height_m": bin[1]}})


@click.command(context_settings={"ignore_unknown_options": True})  # negative coordinates are not options
@click.argument("position", nargs=3, type=Coordinate(), metavar="X Y Z")
@cell_option(service=True)
@click.option("--bin", nargs=2, type=Finite(), metavar="RADIUS RIM", help=BIN_HELP)
@json_option
@calls_service
def retarget(
    position: tuple[float, ...],
    cell: str | None,
    bin: tuple[float, float] | None,
    as_json: bool,
    client: ServiceClient,
) -> None:
    """Give the throw that runs another target: X Y Z [m, world frame].

    It is planned from the earliest tick that can still be reached. Where that is too late, or there is no such throw,
    the running one goes on untouched.
    """

    name = cell_of_service(client, cell)
    plan = client.post(f"/cells/{name}/retarget?trajectory=false", {"release": _target(position, bin)})
    if as_json:
        click.echo(json.dumps(plan))
        return
    start = plan["request"]["start"]
    place = ", ".join(f"{x:.3f}" for x in plan["flight"]["landing_point"])
    release_s = start["at_s"] + plan["release_time_s"]
    click.echo(f"joined at {start['at_s']:.3f} s of the motion; lets go at {release_s:.3f} s, to land at ({place}) m")


@click.command()
@cell_option(service=True)
@json_option
@calls_service
def acknowledge(cell: str | None, as_json: bool, client: ServiceClient) -> None:
    """Clear the fault that the executor latched, once a person has checked the robot."""

    name = cell_of_service(client, cell)
    answer = client.acknowledge(name)
    fault = answer["fault"]
    if as_json:
        click.echo(json.dumps(answer))
        return
    if fault is None:
        click.echo(f"{name}: there was no fault")
        return
    said = ": ".join(filter(None, [fault.get("outcome"), fault.get("reason")]))
    click.echo(f"{name}: {said}; acknowledged by {answer['acknowledged_by']}")


@click.command()
@click.argument("execution", default="latest")
@json_option
@calls_service
def abort(execution: str, as_json: bool, client: ServiceClient) -> None:
    """Ask for the brake of EXECUTION: its id, or `latest`. Not a safety function: use the emergency stop.

    An executor on this machine is asked directly, so that neither service nor database need to answer; `latest` is
    then the newest execution that runs.
    """

    answer = client.abort(execution)
    said = f"had ended before: {answer['outcome']}" if answer["outcome"] else "the executor was asked to brake"
    click.echo(json.dumps(answer) if as_json else f"{answer['id']}: {said}")
