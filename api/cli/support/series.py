"""A series of throws with one record: each target of a file several times, an object loaded in between."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from api.cli.support.progress import execute_plan, search_plan
from api.cli.support.summary import ending_text, outcome_text
from planner.documents import read_text
from planner.errors import quoted

LOAD_TIMEOUT_S = 3600.0  # [s] for an object to be loaded
POLL_S = 0.2  # [s] between two looks at an input; the executor reports four times a second
INPUTS_MAX = 18  # 8 standard, 8 configurable, 2 of the tool; source: RTDE guide
TARGETS_BYTES = 1_000_000  # [byte] of a file of targets: some ten thousand
PROMPT = "load the next object, then press Enter"
LOAD_HELP = (
    "Wait before each throw but the first: enter, input:N (digital input N goes on), or a URL that is posted to until "
    "it answers."
)

Target = tuple[float, float, float]
LoadStep = Callable[[Any, str], object]  # waits, given the client of the service and the name of the cell


def read_targets(file: Path) -> list[Target]:
    """Returns the targets of a file: X Y Z a line [m], separated by blanks or commas; # begins a comment.

    Raises:
        click.ClickException: a line is something else, or there is none.
    """
    found: list[Target] = []
    for number, line in enumerate(read_text(file, TARGETS_BYTES).splitlines(), 1):
        words = line.partition("#")[0].replace(",", " ").split()
        try:
            if words:
                x, y, z = map(float, words)
                found.append((x, y, z))
        except ValueError as error:
            raise click.ClickException(f"{file}, line {number}: {quoted(line.strip())} is not X Y Z") from error
    if not found:
        raise click.ClickException(f"{file} has no targets")
    return found


def load_step(text: str | None) -> LoadStep:
    """Returns the load step of the option --load.

    Raises:
        click.UsageError: there is no such step.
    """
    kind, _, index = (text or "").partition(":")
    if text is None:
        return lambda client, cell: None
    if text == "enter":
        return lambda client, cell: click.prompt(PROMPT, default="", show_default=False, err=True)
    if kind == "input" and index.isdecimal() and int(index) < INPUTS_MAX:
        return lambda client, cell: _wait_for_input(client, cell, int(index))
    if kind in ("http", "https"):
        return lambda client, cell: _call(text)
    raise click.UsageError(f"--load {text!r} is not one of: enter, input:0 … input:{INPUTS_MAX - 1}, a URL")


def run_series(client: Any, load: LoadStep, settings: dict[str, Any]) -> dict[str, Any]:
    """Throws at every target several times, in turns; ends at the first throw that is not completed.

    Args:
        client: Client of the service.
        load: Waits for the next object.
        settings: name, requests (a target each), repeat, mode; kept with the experiment.

    Returns:
        The experiment, as `GET /experiments/{id}` answers it.
    """
    plans = [search_plan(client, request) for request in settings["requests"]]
    experiment = client.post("/experiments", {"name": settings["name"], "settings": settings})
    click.echo(f"experiment {experiment['id']}", err=True)
    count = settings["repeat"] * len(plans)
    for i in range(count):
        plan = plans[i % len(plans)]
        if i:
            load(client, plan["cell"])
        execution = execute_plan(client, plan, settings["mode"], progress=False, experiment_id=experiment["id"])
        is_completed = execution["outcome"] == "completed"
        said = outcome_text(execution) if is_completed else ending_text(execution)
        click.echo(f"{i + 1} of {count}: {said}  (execution {execution['id']})", err=True)
        if not is_completed:
            break
    return client.get(f"/experiments/{experiment['id']}")


def series_text(experiment: dict[str, Any]) -> str:
    """Returns the statistics of an experiment as a table, a line a target."""
    lines = ["target [m]                throws  landed  median [mm]  largest [mm]  mean x, y [mm]"]
    rows = [*experiment["targets"], {**experiment["statistics"], "target": None}]
    for row in rows:
        place = "all" if row["target"] is None else "  ".join(f"{x:7.3f}" for x in row["target"])
        mean = "–" if row["mean_error_m"] is None else ", ".join(f"{1000 * x:.1f}" for x in row["mean_error_m"])
        median, largest = (_millimetres(row[name]) for name in ("median_distance_m", "largest_distance_m"))
        lines.append(f"{place:<25} {row['throws']:>6}  {row['landed']:>6}  {median:>11}  {largest:>12}  {mean}")
    return "\n".join(lines)


def _millimetres(value_m: float | None) -> str:
    return "–" if value_m is None else f"{1000 * value_m:.1f}"


def _wait_for_input(client: Any, cell: str, index: int) -> None:
    """Waits until a digital input goes on: it is seen off first, so that a held button does not throw on and on."""
    click.echo(f"waiting for digital input {index} …", err=True)
    deadline = time.monotonic() + LOAD_TIMEOUT_S
    was_off = False
    while time.monotonic() < deadline:
        robot = client.get(f"/cells/{cell}/state")["robot"] or {}
        on = bool(robot.get("digital_input_bits", 0) >> index & 1)
        if on and was_off:
            return
        was_off = was_off or (bool(robot) and not on)
        time.sleep(POLL_S)
    raise click.ClickException(f"digital input {index} did not go on within {LOAD_TIMEOUT_S:.0f} s")


def _call(url: str) -> None:
    """Posts to a loader's URL and waits for its answer."""
    import httpx2

    try:
        response = httpx2.post(url, timeout=LOAD_TIMEOUT_S, trust_env=False)
    except httpx2.TransportError as error:
        raise click.ClickException(f"the loader at {url} does not answer: {error}") from error
    if response.status_code >= 300:
        raise click.ClickException(f"the loader at {url} answers {response.status_code}")
