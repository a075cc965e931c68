"""The command line with all of its commands loaded, for the generator of its reference."""

from __future__ import annotations

import click

from api.cli import COMMANDS, main

all_commands = click.Group("fling", help=main.help)
for name in COMMANDS:
    command = main.get_command(click.Context(main), name)
    assert command is not None
    all_commands.add_command(command, name)
