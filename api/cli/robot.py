"""`fling robot`: power, brakes and protective stops, by whichever interface the controller has."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import click

from api.cli.support.errors import FlingGroup
from api.cli.support.options import calls_service, cell_of_service, cell_option, json_option

if TYPE_CHECKING:
    from api.cli.support.client import ServiceClient

ACTIONS = {  # command -> action of the service, and what it does
    "power-on": ("power_on", "Power the arm on; its brakes stay engaged."),
    "brake-release": ("brake_release", "Release the brakes: the arm sinks a little, and is ready."),
    "unlock": ("unlock_protective_stop", "Unlock a protective stop, once somebody has looked for its cause."),
    "power-off": ("power_off", "Power the arm off."),
}


def _command(name: str, action: str, text: str) -> click.Command:
    @click.command(name, help=text)
    @cell_option(service=True)
    @json_option
    @calls_service
    def command(cell: str | None, as_json: bool, client: ServiceClient) -> None:
        chosen = cell_of_service(client, cell)
        answer = client.operate(chosen, action)
        if answer["state"] != "done":
            raise click.ClickException(f"{chosen}: {answer['text'] or 'the controller has not answered yet'}")
        click.echo(json.dumps(answer) if as_json else f"{chosen}: {name} done, {answer['text']}")

    return command


robot = FlingGroup(
    "robot",
    commands=[_command(name, *given) for name, given in ACTIONS.items()],
    help="Power an arm on or off, release its brakes, unlock a protective stop.",
)
