"""`fling sim`: a simulated controller, and faults in a running one."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from api.cli.support.errors import FlingGroup
from api.cli.support.options import cell_option, json_option, service_options, service_url

CONTROL_PORT = 29900  # of the simulator alone; source: docs/simulator.md
OTHER_HOST = "give its cell file another loopback address: link.host, such as 127.0.0.2"
TIMEOUT_S = 5.0  # [s] the simulator answers at once
FAULTS = """Faults, with their parameters and defaults. Roles are control, receive, io, inputs (control and io), any
(all three), dashboard, robot_api, script, primary, secondary, camera, gripper.

protective_stop (runtime=paused; stopped, playing)

emergency_stop, safeguard_stop, power_loss

clear: removes the cause of every stop

stop_program, pause_program, resume_program: the pendant's buttons

local_mode (on=true): scripts and most commands of dashboard or Robot API are refused

speed_slider (fraction=0.5)

close_connection (role=control, reset=false): FIN or RST; the port keeps listening

stall_connection (role=control, on=true): neither read nor written, but open

disturb_connection (role=control, also every, with connections to come; delay_s, jitter_s, drop=0): everything delayed;
a share of the data packages lost, both ways

offline (on=true, reset=true): every connection ends, every port except the control port refuses

mute (port=dashboard; robot_api, rtde, script, gripper; on=true): accepts, never answers

freeze (duration_s=1): controller, its time and world stand still; sockets stay open

kill: the process dies by SIGKILL

gripper_stuck (on=true): the gripper does not open

object_lost: the object slips out of the closed gripper

outputs_stuck (on=true): the digital outputs ignore what they are told

digital_input (index=0, on=true): no fault: switches a digital input, as a loader would
"""


def truth_options(command: Any) -> Any:
    """Adds the options --truth and --reveal of a simulated controller to a command."""
    kind = click.Path(exists=True, dir_okay=False, path_type=Path)
    command = click.option("--reveal", is_flag=True, help="Tell what --truth hides: the true release and landing.")(
        command
    )
    return click.option("--truth", type=kind, help="How arm, gripper, object and camera really behave (TOML).")(command)


def truth_arguments(truth: Path | None, reveal: bool) -> list[str]:
    """Returns the arguments that give a simulated controller its truth file."""
    return [*(["--truth", str(truth)] if truth else []), *(["--reveal"] if reveal else [])]


def _controller_options(command: Any) -> Any:
    """Adds the simulator's own options, which are passed through to it."""
    kind = click.Path(exists=True, file_okay=False, path_type=Path)
    for option in (
        click.option("--polyscope", metavar="x|VERSION", help="Version to present; x: PolyScope X."),
        click.option("--strict-clock", is_flag=True, help="The clock never slips, for machines that do not stall."),
        click.option("--no-noise", is_flag=True, help="Measured joint positions and speeds are the true ones."),
        click.option("--no-remote-control", is_flag=True, help="Remote control is off in the settings."),
        click.option("--serial-number", help="Of the robot; default: the cell's link.serial, or a made-up one."),
        click.option("--programs", type=kind, help="Folder of stored programs (NAME.script) to load."),
    ):
        command = option(command)
    return command


@click.group(cls=FlingGroup, invoke_without_command=True)
@cell_option()
@click.option("--host", help="Loopback address to listen on; default: the cell's link.host.")
@click.option("--profile", help="Behave as this profile says: its id, or a file from `fling profile show --json`.")
@truth_options
@_controller_options
@service_options
@click.pass_context
def sim(context: click.Context, cell: str | None, host: str | None, **given: Any) -> None:
    """Run a simulated controller; `fault` causes a fault in a running one, `state` shows its state.

    With --profile it is a timing twin of the real cell: what was learnt of it is how the simulated one behaves, and
    hidden from planner and executor. The cell file must say kind = "sim": give the twin a copy of the real cell's.
    """
    from api.cli.support.addresses import SIMULATOR_PORTS, require_free
    from api.cli.support.processes import cell_path
    from api.settings import parse_settings

    settings = parse_settings()

    def path() -> Path:
        return cell_path(settings.cells, cell or settings.default_cell)

    if context.invoked_subcommand is None:
        arguments = ["--cell", str(path()), *(["--host", host] if host else []), *_behaviour(**given)]
        advice = f"or choose another loopback address: --host 127.0.0.2, and {OTHER_HOST}"
        require_free(host or _host(path()), SIMULATOR_PORTS, "the simulated controller", advice)
        os.execv(sys.executable, [sys.executable, "-P", "-m", "simulator", *arguments])
    context.obj = lambda: host or _host(path())


def _behaviour(
    profile: str | None,
    truth: Path | None,
    reveal: bool,
    programs: Path | None,
    serial_number: str | None,
    polyscope: str | None,
    no_remote_control: bool,
    no_noise: bool,
    strict_clock: bool,
    url: str | None,
    token: str | None,
) -> list[str]:
    """Returns the arguments that tell a simulated controller how to behave."""
    from api.cli.support.client import ServiceClient
    from api.cli.support.twin import read_profile, twin_file

    if profile is not None and truth is not None:
        raise click.UsageError("--profile is a truth of its own: it does not go together with --truth")
    if profile is not None:
        truth = Path(twin_file(read_profile(profile, lambda: ServiceClient(service_url(url), token))))
    arguments = [*truth_arguments(truth, reveal), *(["--programs", str(programs)] if programs else [])]
    arguments += ["--serial-number", serial_number] if serial_number else []
    arguments += ["--polyscope", polyscope] if polyscope else []
    flags = {"--no-remote-control": no_remote_control, "--no-noise": no_noise, "--strict-clock": strict_clock}
    return arguments + [name for name, on in flags.items() if on]


def _host(path: Path) -> str:
    """Returns the address of a cell's controller."""
    from planner.cell import load_cell
    from planner.errors import CellError

    try:
        return load_cell(path).link.host
    except CellError as error:
        raise click.ClickException(f"{path.name}: {error}") from error


@sim.command(epilog=FAULTS)
@click.argument("name")
@click.argument("parameters", nargs=-1, metavar="[KEY=VALUE]...")
@json_option
@click.pass_obj
def fault(host: Callable[[], str], name: str, parameters: tuple[str, ...], as_json: bool) -> None:
    """Cause a fault in a running simulated controller; the answer is JSON always."""
    given = dict(_parameter(parameter) for parameter in parameters)
    click.echo(json.dumps(_call(host(), {"op": "fault", "name": name, **given})))


@sim.command()
@json_option
@click.pass_obj
def state(host: Callable[[], str], as_json: bool) -> None:
    """Show the true state of the controller and its arm, in JSON always."""
    click.echo(json.dumps(_call(host(), {"op": "state"}), indent=2))


def _parameter(text: str) -> tuple[str, object]:
    key, _, value = text.partition("=")
    try:
        return key, json.loads(value)
    except json.JSONDecodeError:
        return key, value


def _call(host: str, request: dict[str, object]) -> dict[str, object]:
    import socket

    try:
        with socket.create_connection((host, CONTROL_PORT), TIMEOUT_S) as connection, connection.makefile("rw") as text:
            text.write(json.dumps(request) + "\n")
            text.flush()
            answer = json.loads(text.readline() or '{"ok": false, "error": "the simulator closed the connection"}')
    except OSError as error:
        raise click.ClickException(f"no simulator at {host}: {error}") from error
    if not answer.get("ok"):
        raise click.ClickException(str(answer.get("error")))
    return answer
