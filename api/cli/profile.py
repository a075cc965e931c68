"""Commands about what was learnt of a cell: fling profile list, show, adopt, revert."""

from __future__ import annotations

import json
from typing import Any

import click

from api.cli.client import ServiceClient
from api.cli.throw import service_options, service_url


@click.group()
def profile() -> None:
    """List, show, adopt or revert what was learnt of a cell."""


def json_option(command: Any) -> Any:
    """Adds the option --json to a command."""
    return click.option("--json", "as_json", is_flag=True, help="Answer as JSON.")(command)


@profile.command(name="list")
@click.option("--cell", required=True, help="Cell.")
@json_option
@service_options
def list_profiles(cell: str, as_json: bool, url: str | None, token: str | None) -> None:
    """List the profiles of a cell, newest first; * marks the one that it uses."""
    with ServiceClient(service_url(url), token) as client:
        answer = client.get(f"/cells/{cell}/profiles")
    if as_json:
        click.echo(json.dumps(answer))
        return
    for row in answer["profiles"]:
        mark = "*" if row["adopted"] else " "
        throws = len(row["evidence"]["throws"])
        click.echo(f"{mark} {row['id']}  {row['created_at']}  {throws} throws; {numbers_text(row)}")
    if answer["adopted"] is None:
        click.echo("in use: the cell file's numbers")


@profile.command()
@click.argument("id")
@json_option
@service_options
def show(id: str, as_json: bool, url: str | None, token: str | None) -> None:
    """Show one profile with its evidence."""
    with ServiceClient(service_url(url), token) as client:
        answer = client.get(f"/profiles/{id}")
    click.echo(json.dumps(answer) if as_json else profile_text(answer))


@profile.command()
@click.argument("id")
@service_options
def adopt(id: str, url: str | None, token: str | None) -> None:
    """Use a profile from now on; plans made before it must be made again."""
    with ServiceClient(service_url(url), token) as client:
        answer = client.post(f"/profiles/{id}/adopt")
    click.echo(f"{answer['cell']} uses profile {answer['profile']}, adopted by {answer['adopted_by']}")


@profile.command()
@click.option("--cell", required=True, help="Cell.")
@service_options
def revert(cell: str, url: str | None, token: str | None) -> None:
    """Use the cell file's own numbers again."""
    with ServiceClient(service_url(url), token) as client:
        client.post(f"/cells/{cell}/profiles/revert")
    click.echo(f"{cell} uses the cell file's numbers")


def numbers_text(row: dict[str, Any]) -> str:
    """Returns lag, delay and jitter of a profile in a line."""
    lag = "" if row["lag_std_s"] is None else f" ± {1e3 * row['lag_std_s']:.1f}"
    return (
        f"lag {1e3 * row['lag_s']:.1f}{lag} ms, delay {1e3 * row['delay_s']:.1f} ± {1e3 * row['delay_std_s']:.1f} ms, "
        f"jitter {1e3 * row['jitter_s']:.1f} ± {1e3 * row['jitter_std_s']:.1f} ms"
    )


def profile_text(row: dict[str, Any]) -> str:
    """Returns a profile in a few lines, beside what the cell file says."""
    file, offset = row["cell_file"], row["landing_offset_m"]
    spread = row["landing_offset_std_m"]
    seen = {name: len(ids) for name, ids in row["evidence"].items()}
    lines = [
        f"profile {row['id']} of {row['cell']}, {row['created_at']} by {row['created_by']}"
        + ("; in use" if row["adopted"] else ""),
        f"  from {seen['throws']} throws with {seen['landings']} landings, {seen['timing']} runs that show the timing",
        f"  {numbers_text(row)}",
        f"  the cell file: lag {1e3 * file['lag_s']:.1f} ms, delay {1e3 * file['delay_s']:.1f} ms, "
        f"jitter {1e3 * file['jitter_s']:.1f} ms",
        f"  speed of the object over the tool's {row['speed_factor']:.3f} ± {row['speed_factor_std']:.3f}; drag "
        f"coefficient {row['drag_coefficient']:.2f} ± {row['drag_coefficient_std']:.2f}",
        f"  base {1e3 * offset[0]:.1f} ± {1e3 * spread[0]:.1f}, {1e3 * offset[1]:.1f} ± {1e3 * spread[1]:.1f} mm off, "
        f"turned by {1e3 * row['base_turn_rad']:.1f} ± {1e3 * row['base_turn_std_rad']:.1f} mrad",
    ]
    return "\n".join(lines)
