"""`fling cell new`: a first cell file, from five answers or from what the controller tells."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.cell_urdf import refuse_present, write_new
from api.cli.support.cell_warnings import warnings_of
from api.cli.support.options import json_option
from api.cli.support.terminal import BAD, GOOD, say
from planner.grippers import MODELS, OUTPUTS

if TYPE_CHECKING:
    from planner.cell import Cell

OPTIONS = ("--controller", "--robot", "--tcp", "--mass", "--gripper")  # by the questions that they answer
NAME = re.compile(r"[A-Za-z0-9_-]+")
SIMULATED = "sim"
SIMULATED_HOST = "127.0.0.1"
OUTPUT_WORDS = tuple(f"{output} {index}" for output, count in OUTPUTS.items() for index in range(count))
VACUUM = "vacuum "
# What a gripper is opened by, as an answer: an output, an output that is the vacuum's, or a model with a bus.
GRIPPER = click.Choice(
    (*OUTPUT_WORDS, *(f"{VACUUM}{output}" for output in OUTPUT_WORDS), *MODELS), case_sensitive=False
)
OPENS = f"an output such as {OUTPUT_WORDS[0]} or {VACUUM}{OUTPUT_WORDS[0]}, or a model: {', '.join(MODELS)}"
COMPUTE_BOX = 'host = "192.168.1.1"              # a guess: the compute box as delivered\n'
VERSION = re.compile(r"\d+\.\d+(\.\d+)?")  # of PolyScope; a controller may tell its build, too
TCP_M = 0.17  # [m] from the flange to the object's centre: of the shipped cells
TOOL_KG = 1.0
TCP_MAX_M = 1.0  # [m] a larger answer is in millimetres
SURE_M = 1e-3  # [m] a controller's tool centre point nearer to the flange was never set
# [rad] Tried in this order: the usual home, and higher ones for long tools on short arms.
HOMES = tuple((0.0, -1.57, elbow, -elbow, -1.57, 0.0) for elbow in (1.57, 1.0, 0.5))
THROW_SHARE = 1.5  # [-] of upper arm and forearm: a first target that every arm throws to
SLOW = """
[limits]                          # slow, for the first motions: raise them step by step
joint_velocity_rad_s = 1.0
tcp_speed_m_s = 1.0
"""
TEXT = """\
# Written by `fling cell new`. docs/cells.md names every key.
robot = "{robot}"
home_rad = {home}

[tool]
tcp_position_m = {position}       # centre of the object, in the flange frame
tcp_rotation_vector_rad = {rotation}
mass_kg = {mass}                  # without the object
# capsules = [{{ from_m = [0.0, 0.0, 0.0], to_m = [0.0, 0.0, 0.15], radius_m = 0.05 }}]  # its shape, a little too large
{limits}
[surroundings]
floor_z_m = 0.0                   # a guess: the arm stands on the floor
clearance_m = 0.02
keep_out = []                     # boxes {{ lower_m = [x, y, z], upper_m = [x, y, z] }} and other shapes: docs/cells.md

[object]                          # a guess: a sphere
mass_kg = 0.05
radius_m = 0.02

[gripper]                         # other kinds, a second output that closes or blows off: docs/cells.md
{gripper}delay_s = 0.040                   # a guess: fling calibrate gripper
jitter_s = 0.0015                 # a guess

[timing]
lag_s = 0.02                      # a guess: fling calibrate lag

[link]
kind = "{kind}"
host = "{host}"
{serial}"""
SIM = """
[sim]
{}polyscope = "{}"               # of the simulated controller; "x" for PolyScope X
"""


@dataclass(frozen=True)
class Answers:
    """What a cell file is written from.

    Attributes:
        host: address of the controller, or `SIMULATED`.
        robot: model of the arm.
        tcp: tool centre point (6,) in the flange frame: position [m], rotation vector [rad].
        mass_kg: of the tool.
        gripper: what opens it, one of `GRIPPER`.
        serial: number of the robot, if its controller told it.
        polyscope: that a simulated controller presents; None: the default of the arm.
    """

    host: str
    robot: str
    tcp: tuple[float, ...]
    mass_kg: float
    gripper: str
    serial: str | None = None
    polyscope: str | None = None

    @property
    def is_simulated(self) -> bool:
        """Whether the controller is simulated on this machine."""
        return self.host == SIMULATED


@click.command("new")
@click.argument("name", default="lab")
@click.option("--controller", metavar="ADDRESS", help=f"Address of the controller; {SIMULATED}: a simulated one.")
@click.option("--robot", help="Model of the arm.")
@click.option(
    "--tcp", type=click.FloatRange(0.0, TCP_MAX_M), metavar="M", help="From the flange to the object's centre [m]."
)
@click.option("--mass", type=click.FloatRange(0.0), metavar="KG", help="Mass of the tool without the object [kg].")
@click.option("--gripper", type=GRIPPER, metavar="OUTPUT|MODEL", help=f"What opens the gripper: {OPENS}.")
@click.option("--polyscope", metavar="x|VERSION", help="Of the simulated controller; x: PolyScope X.")
@json_option
def new(
    name: str,
    controller: str | None,
    robot: str | None,
    tcp: float | None,
    mass: float | None,
    gripper: str | None,
    polyscope: str | None,
    as_json: bool,
) -> None:
    """Write the cell file NAME.toml, from five answers or from what the controller tells.

    It goes to the folder of cell files (FLING_CELLS, or ./cells). An option answers its question beforehand. For a
    real arm there is a second file, NAME-sim.toml: the same cell, simulated. Nothing is written over.
    With --json nobody is asked: what is missing is refused.
    """
    folder = Path(os.environ.get("FLING_CELLS") or "cells")
    if not NAME.fullmatch(name):
        raise click.UsageError(f"{name!r} is no name of a cell: letters, digits, - and _")
    refuse_present([folder / f"{name}.toml"])
    host = controller or _ask(1, f"address of the arm's controller, or {SIMULATED}", SIMULATED)
    told = {} if host == SIMULATED else _told_by(host)
    answers = Answers(
        host=host,
        robot=robot or _ask_robot(told.get("models", [])),
        tcp=_tcp(tcp, told.get("tcp_offset")),
        mass_kg=_mass(mass, told.get("payload_kg")),
        gripper=gripper or _ask(5, f"what opens the gripper: {OPENS}", OUTPUT_WORDS[0], GRIPPER),
        serial=told.get("serial"),
        polyscope=polyscope or _version(told.get("polyscope")),
    )
    cells = {folder / f"{name}.toml": answers}
    if not answers.is_simulated:
        cells[folder / f"{name}-sim.toml"] = replace(answers, host=SIMULATED, serial=None)
    checked = {path: cell_written(path.stem, each) for path, each in cells.items()}
    folder.mkdir(parents=True, exist_ok=True)
    write_new({path: text for path, (text, _) in checked.items()})
    _tell(name, checked, as_json)


def cell_written(name: str, answers: Answers) -> tuple[str, Cell]:
    """Returns the text of a cell file, and the cell that it is read as: at home where nothing stands in its way.

    Raises:
        click.ClickException: the answers make no cell; the reason names the key.
    """
    from planner.cell import parse_cell
    from planner.cell_folder import home_faults
    from planner.errors import CellError

    try:
        written = [(text, parse_cell(text, name)) for text in (_text(answers, home) for home in HOMES)]
    except CellError as error:
        raise click.ClickException(f"these answers make no cell: {error}") from error
    return next((each for each in written if not home_faults(each[1])), written[0])


def _text(answers: Answers, home: Sequence[float]) -> str:
    text = TEXT.format(
        robot=answers.robot,
        home=list(home),
        position=[round(float(x), 6) for x in answers.tcp[:3]],
        rotation=[round(float(x), 6) for x in answers.tcp[3:]],
        mass=round(float(answers.mass_kg), 4),
        limits="" if answers.is_simulated else SLOW,
        gripper=_gripper_text(answers),
        kind="sim" if answers.is_simulated else "ur",
        host=SIMULATED_HOST if answers.is_simulated else answers.host,
        serial="" if answers.serial is None else f'serial = "{answers.serial}"  # any other robot is refused\n',
    )
    return text + SIM.format(*("", answers.polyscope) if answers.polyscope else ("# ", "x")) * answers.is_simulated


def _gripper_text(answers: Answers) -> str:
    """Returns the lines that say what opens the gripper."""
    model = MODELS.get(answers.gripper)
    if model is None:
        is_vacuum = answers.gripper.startswith(VACUUM)
        output, index = answers.gripper.removeprefix(VACUUM).split()
        kind = 'kind = "vacuum"\n' if is_vacuum else ""
        level = "false" if is_vacuum else "true"
        return f'{kind}output = "{output}"\nindex = {index}\nopen_level = {level}\n'
    needs_host = "modbus_tcp" in model.transports and not answers.is_simulated
    return f'kind = "{model.kind}"\nmodel = "{answers.gripper}"\n{COMPUTE_BOX if needs_host else ""}'


def _version(told: str | None) -> str | None:
    """Returns the version that a controller tells, without its build; None where it tells none."""
    found = VERSION.match(told or "")
    return found and found.group()


def _ask(number: int, question: str, default: Any, kind: Any = str) -> Any:
    """Returns the answer to a question, asked again until it is one."""
    if click.get_current_context().params["as_json"]:
        raise click.UsageError(f"with --json nobody is asked: give {OPTIONS[number - 1]}")
    return click.prompt(f"{number} of 5: {question}", default, type=kind, show_choices=False)


def _told_by(host: str) -> dict[str, Any]:
    """Returns what the controller at an address tells of itself; nothing, and says so, where none answers."""
    command = [sys.executable, "-P", "-m", "executor", "--find", host]
    asked = subprocess.run(command, capture_output=True, text=True)
    if asked.returncode != 0:
        say(f"no controller answers at {host}: the questions go on without it", BAD, err=True)
        return {}
    told = dict(json.loads(asked.stdout))
    arm = " or ".join(told["models"]) or "an arm that Fling does not know"
    serial = told["serial"] or "unknown"
    say(f"found: {arm}, serial number {serial}, PolyScope {told['polyscope'] or 'unknown'}", GOOD, err=True)
    return told


def _ask_robot(models: Sequence[str]) -> str:
    """Returns the arm's model: the only one that it can be, or the answer to a question."""
    from planner.robots import INCOMPLETE_NAMES, ROBOT_NAMES

    if len(models) == 1:
        return models[0]
    names = models or (*ROBOT_NAMES, *INCOMPLETE_NAMES)
    default = models[0] if models else "ur5e"
    return str(_ask(2, f"arm ({', '.join(names)})", default, click.Choice(names, case_sensitive=False)))


def _tcp(asked_m: float | None, told: Sequence[float] | None) -> tuple[float, ...]:
    """Returns the tool centre point: as an option gave it, as the controller is set, or as a person answers."""
    if asked_m is None and told is not None and max(map(abs, told[:3])) > SURE_M:
        click.echo(f"tool centre point as the controller has it: {[round(x, 4) for x in told]}", err=True)
        return tuple(told)
    question = "from the flange to the object's centre [m]"
    length_m = _ask(3, question, TCP_M, click.FloatRange(0.0, TCP_MAX_M)) if asked_m is None else asked_m
    return (0.0, 0.0, float(length_m), 0.0, 0.0, 0.0)


def _mass(asked_kg: float | None, told_kg: float | None) -> float:
    """Returns the tool's mass [kg], as `_tcp` does the tool centre point."""
    if asked_kg is None and told_kg:
        click.echo(f"mass of the tool as the controller has it: {told_kg:g} kg", err=True)
        return told_kg
    question = "mass of the tool without the object [kg]"
    return float(_ask(4, question, TOOL_KG, click.FloatRange(0.0)) if asked_kg is None else asked_kg)


def first_target(cell: Cell) -> list[float]:
    """Returns a point of the floor (3,) to which a first throw may go [m]."""
    x, y, _ = cell.X_WB[:3, 3]
    return [round(float(x) + THROW_SHARE * float(abs(cell.robot.a).sum()), 1), round(float(y) + 0.3, 1), 0.0]


def first_throw(cell: Cell) -> str:
    """Returns the command of a first throw."""
    return f"fling throw {' '.join(map(str, first_target(cell)))}"


def _tell(name: str, made: Mapping[Path, tuple[str, Cell]], as_json: bool) -> None:
    """Says which files were written, what is still a guess, and what comes next."""
    from planner.cell_folder import home_faults

    simulated = next(cell for _, cell in made.values() if cell.link.kind == "sim")
    warnings = dict.fromkeys(note for _, cell in made.values() for note in warnings_of(cell))
    notes = [*warnings, *map(str, home_faults(simulated))]
    if as_json:
        answer = {"cell": name, "robot": simulated.robot.name, "files": [str(path) for path in made], "notes": notes}
        click.echo(json.dumps(answer))
        return
    for path, (_, cell) in made.items():
        simulation = f"simulated with PolyScope {cell.sim.polyscope}"
        kind = simulation if cell.link.kind == "sim" else f"a REAL arm at {cell.link.host}"
        say(f"{path}: a {cell.robot.name}, {kind}", GOOD)
    for note in notes:
        say(note, BAD)
    click.echo("guessed, and marked so in the file: object, floor, gripper's delay, lag")
    click.echo(f"next: fling up --cell {simulated.name}, and in another terminal: {first_throw(simulated)}")
    if simulated.name != name:
        click.echo(f"then the arm: fling doctor --cell {name}, and docs/tutorial/real-arm.md, step by step")
