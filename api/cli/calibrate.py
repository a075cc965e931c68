"""Calibration commands: fling calibrate lag."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from api.cli.client import ServiceClient, ServiceError
from api.cli.throw import service_options, service_url

AMPLITUDE_RAD = 0.25  # [rad] of a small motion: long enough for 1 rad/s, short enough to stay clear of most things
AMPLITUDE_MIN_RAD = 0.02  # [rad] a shorter motion ends before a lag of 20 ms shows
# Signs of the joints in turn: each joint moves in every motion, and no two joints always move alike.
SIGNS = ((1, 1, -1, 1, -1, 1), (-1, 1, -1, -1, 1, 1), (1, -1, 1, 1, 1, -1), (-1, -1, 1, -1, -1, -1))
MOTIONS = 4


@click.group()
def calibrate() -> None:
    """Measure what a cell's own motions and throws teach."""


@calibrate.command()
@click.option("--cell", required=True, help="Cell.")
@click.option("--from-csv", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="FILE",
              help="Recorded run: time_s, command_0 … command_5, measured_0 … measured_5 [rad/s].")  # fmt: skip
@click.option("--throws", type=click.IntRange(1, 100), default=MOTIONS, show_default=True, help="Number of motions.")
@click.option("--json", "as_json", is_flag=True, help="Answer as JSON.")
@service_options
def lag(cell: str, from_csv: Path | None, throws: int, as_json: bool, url: str | None, token: str | None) -> None:
    """Measure the arm's lag and gains: from a recorded run, or with small certified motions without an object.

    **The motions move the arm**, about its home; the gripper stays as it is.
    """
    found = _from_csv(from_csv) if from_csv is not None else _by_motions(cell, throws, as_json, url, token)
    click.echo(json.dumps({"cell": cell, **found}) if as_json else _lag_text(found))


def _from_csv(file: Path) -> dict[str, Any]:
    from learning import RecordingError, estimate_timing, recording_from_csv

    try:
        return estimate_timing(recording_from_csv(file.read_text())).as_document()
    except (RecordingError, OSError, UnicodeDecodeError) as error:
        raise click.ClickException(f"{file}: {error}") from error


def _by_motions(cell: str, count: int, quiet: bool, url: str | None, token: str | None) -> dict[str, Any]:
    """Returns the timing pooled over `count` motions about home, executed by the running service."""
    from learning import pooled_document

    runs = []
    with ServiceClient(service_url(url), token) as client:
        document = client.get(f"/cells/{cell}")
        for i in range(count):
            timing = _move(client, cell, document["home_rad"], SIGNS[i % len(SIGNS)])
            runs.insert(0, timing)
            if not quiet:
                click.echo(f"motion {i + 1} of {count}: {_milliseconds(timing)}")
    pooled = pooled_document(runs, document["timing"]["lag_s"])
    assert pooled is not None
    return {**pooled, "assumed_lag_s": document["timing"]["lag_s"]}


def _move(client: ServiceClient, cell: str, home: list[float], signs: tuple[int, ...]) -> dict[str, Any]:
    """Plans and executes one motion from home to rest; returns its timing."""
    plan = _plan_motion(client, cell, home, signs)
    execution = client.post("/execute", {"plan_id": plan["id"]})
    for _ in client.events(execution["id"]):
        pass
    done = client.get(f"/executions/{execution['id']}")
    if done["outcome"] != "completed":
        raise click.ClickException(f"{done['outcome']}: {done['reason'] or 'no reason was given'}")
    timing = done["metrics"]["timing"]
    if timing is None:
        raise click.ClickException("the recording of the motion shows no timing: nothing moved in it")
    return timing


def _plan_motion(client: ServiceClient, cell: str, home: list[float], signs: tuple[int, ...]) -> dict[str, Any]:
    """Returns the longest plan of a motion in this direction, halved until it is certified."""
    amplitude = AMPLITUDE_RAD
    while True:
        goal = [q + sign * amplitude for q, sign in zip(home, signs, strict=True)]
        release = {"kind": "joint", "positions": goal, "velocities": [0.0] * 6}
        try:
            return client.post("/plan?trajectory=false", {"cell": cell, "release": release})
        except ServiceError as error:
            amplitude /= 2.0
            refused = error.problem.get("type") in ("/problems/infeasible", "/problems/invalid-request")
            if not refused or amplitude < AMPLITUDE_MIN_RAD:
                raise


def _lag_text(found: dict[str, Any]) -> str:
    gains = ", ".join("–" if gain is None else f"{gain:.3f}" for gain in found["gain"])
    lines = [f"lag {_milliseconds(found)}; gain of each joint {gains}"]
    if found.get("ramp_rad_s2"):
        lines.append(f"speedj's acceleration of {found['ramp_rad_s2']:.1f} rad/s² held the arm back")
    if "assumed_lag_s" in found:
        lines.append(found["advice"] or f"as in the cell file: timing.lag_s = {found['assumed_lag_s']:g}")
    else:
        lines.append(f"for the cell file: timing.lag_s = {found['lag_s']:.4f}")
    return "\n".join(lines)


def _milliseconds(timing: dict[str, Any]) -> str:
    return f"{1e3 * timing['lag_s']:.2f} ± {1e3 * timing['lag_std_s']:.2f} ms"
