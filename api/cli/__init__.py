"""The command line `fling`. Each command imports its module, and the module's dependencies, when it is called."""

from __future__ import annotations

from importlib import import_module

import click

from api.cli.support.errors import FlingGroup

__all__ = ["COMMANDS", "main"]

# name: (module, attribute, summary); the summaries are here so that `fling --help` imports nothing else.
COMMANDS = {
    "up": ("serve", "up", "Everything on this machine: simulator, executor, service, web page."),
    "demo": ("demo", "demo", "One throw from plan to landing on a simulated arm."),
    "serve": ("serve", "serve", "The service alone."),
    "executor": ("serve", "executor", "The executor of one cell."),
    "sim": ("simulator", "sim", "A simulated controller, or a fault in one."),
    "plan": ("plan", "plan", "Plan a request from a file, without a service."),
    "batch": ("batch", "batch", "Plan many requests, or a grid of them, from a file."),
    "map": ("map", "map_command", "Where a cell can throw, how soon and how surely."),
    "throw": ("throw", "throw", "Plan and execute a throw to a point."),
    "job": ("job", "job", "Pick and throw what a file says, one after another."),
    "profile": ("calibrate", "profile", "List, show, adopt or revert what was learnt of a cell."),
    "calibrate": ("calibrate", "calibrate", "Measure what a cell's own motions and throws teach."),
    "landing": ("landing", "landing", "Report where an object landed, or list the reports."),
    "report": ("report", "report", "A plan, an execution or an experiment as a self-contained HTML file."),
    "verify": ("verify", "verify", "Prove a plan anew, by arithmetic that rounds outwards."),
    "audit": ("audit", "audit", "Random problems planned, and every plan judged by foreign code."),
    "export": ("export", "export", "A plan as a URScript program for the pendant."),
    "retarget": ("throw", "retarget", "Give a running throw another target."),
    "abort": ("throw", "abort", "Ask for the brake of a running execution."),
    "acknowledge": ("throw", "acknowledge", "Clear a latched fault, after checking the robot."),
    "robot": ("robot", "robot", "Power an arm, release its brakes, unlock a protective stop."),
    "doctor": ("serve", "doctor", "Check this machine's timing and the link to the controller."),
    "cell": ("admin", "cell", "Write and check cell files, import an arm's kinematics."),
    "token": ("admin", "token", "Create, list and revoke tokens for the service."),
    "db": ("admin", "db", "Migrate the database."),
    "version": ("admin", "version", "Show the version."),
}


class LazyGroup(FlingGroup):
    """A group that imports its commands when they are called."""

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


def _show_version(ctx: click.Context, param: click.Parameter, given: bool) -> None:
    if given and not ctx.resilient_parsing:
        from api import fling_version

        click.echo(f"fling {fling_version()}")
        ctx.exit()


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_show_version, help="The version.")
def main() -> None:
    """Plan a throw for a Universal Robots arm, get it certified, stream it to the arm.

    Settings come from FLING_* environment variables; flags override them. Software stop is not a safety function.

    Exit status: 0 done; 1 wrong input, missing file or not reachable; 2 infeasible; 3 solver failed; 4 executed, but
    not completed; 64 wrong command line. `fling doctor`: 0 fit; 1 fit with warnings; 2 unfit. `fling verify`: 0 proven;
    1 not proven; 2 violated. `fling audit`: 0 no plan is wrong; 2 one is. With --json errors are JSON on standard
    error.
    """
