"""The command line `fling`. Each command loads its module, and what that needs, when it is called."""

from __future__ import annotations

from importlib import import_module

import click

# name: (module, attribute, what it does); the texts stand here so that `fling --help` loads nothing else.
COMMANDS = {
    "up": ("running", "up", "Everything on this machine: simulator, executor, service, web page."),
    "demo": ("demo", "demo", "One throw from plan to landing on a simulated arm."),
    "serve": ("running", "serve", "The service alone."),
    "executor": ("running", "executor", "The executor of one cell."),
    "sim": ("simulator", "sim", "A simulated controller, or a fault in one."),
    "plan": ("planning", "plan", "Plan a request from a file, without a service."),
    "throw": ("throwing", "throw", "Plan and execute a throw to a point."),
    "report": ("planning", "report", "One plan as a self-contained HTML file."),
    "acknowledge": ("throwing", "acknowledge", "Clear a latched fault, after a look at the robot."),
    "doctor": ("running", "doctor", "Judge this machine's timing and the link to the controller."),
    "cell": ("keeping", "cell", "Judge cell files."),
    "warm": ("planning", "warm", "Build and cache the generated solvers."),
    "bench": ("planning", "bench", "The benchmark."),
    "token": ("keeping", "token", "Make tokens for the service."),
    "db": ("keeping", "db", "Migrations of the database."),
    "version": ("keeping", "version", "Show the version."),
}


class LateGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Returns the names in the order of `COMMANDS`."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Imports and returns one command."""
        if cmd_name not in COMMANDS:
            return None
        module, attribute, _ = COMMANDS[cmd_name]
        return getattr(import_module(f"api.cli.{module}"), attribute)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Writes the list of commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, _, text) in COMMANDS.items()])


@click.group(cls=LateGroup, context_settings={"help_option_names": ["-h", "--help"]})
def main() -> None:
    """Plan a throw for a Universal Robots arm, get it certified, stream it to the arm.

    Settings come from FLING_* environment variables; flags override them. Software stop is not a safety function.
    """
