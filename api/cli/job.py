"""`fling job`: picks and throws one after another, through a running service."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.support.exit_status import NotCompleted
from api.cli.support.options import calls_service, json_option
from api.cli.support.summary import outcome_text

if TYPE_CHECKING:
    from api.cli.support.client import ServiceClient

SHOWN = ("waiting", "moving")  # results of objects of which nothing is to be said yet


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, allow_dash=True, path_type=Path))
@json_option
@calls_service
def job(file: Path, as_json: bool, client: ServiceClient) -> None:
    """Pick and throw what FILE says (JSON as for POST /jobs, or the same as .toml; - reads JSON), and follow it.

    Prints a line an object, and the shift's record. Ctrl-C pauses the job after the motion that runs. **This moves the
    robot.** Exit status 4: it stopped, or was cancelled.
    """
    document = client.order_job(_read(file))
    id = document["id"]
    told: set[int] = set()
    try:
        for each in client.job_progress(id):
            document = each
            if not as_json:
                _tell(client, id, told)
    except KeyboardInterrupt:
        client.post(f"/jobs/{id}/pause")
        click.echo(f"\nit pauses at the next pick; POST /jobs/{id}/resume goes on, /cancel ends it", err=True)
        raise
    click.echo(json.dumps(document) if as_json else _summary(document))
    if document["outcome"] != "completed":
        raise NotCompleted(f"job {id}: {outcome_text(document)}")


def _read(file: Path) -> Any:
    """Returns the request in a file of JSON or TOML."""
    from api.cli.support.errors import RefusedRequest
    from api.cli.support.request_file import read_document, read_toml
    from api.http import problem_document, translate
    from planner.errors import InvalidProblem

    try:
        return read_toml(file) if file.suffix == ".toml" else read_document(file)
    except InvalidProblem as error:
        raise RefusedRequest(problem_document(translate(error), str(file))) from error


def _tell(client: Any, id: str, told: set[int]) -> None:
    """Prints a line for each object that is done, once."""
    for each in client.job_results(id):
        if each["pick"] not in told and each["result"] not in SHOWN:
            told.add(each["pick"])
            click.echo(_line(each))


def _line(each: dict[str, Any]) -> str:
    """Returns what became of an object."""
    name = f" ({each['object']})" if each["object"] else ""
    at = f", {1e3 * each['error_m']:.0f} mm from target {each['target']}" if each["error_m"] is not None else ""
    reason = f"; {each['reason']}" if each["reason"] else ""
    return f"pick {each['pick']}{name}: {each['result']}{at}; {each['object_at']}{reason}"


def _summary(document: dict[str, Any]) -> str:
    """Returns the record of a job in words."""
    record = document["record"]
    lines = [f"job {document['id']}: {document['outcome']}; {document['done']} of {document['total']} picks done"]
    if record["hit_interval"] is not None:
        low, high = record["hit_interval"]
        lines.append(f"hits: {record['hits']} of {record['landings_seen']} seen ({low:.0%} to {high:.0%})")
    if record["misses"]:
        lines.append("misses: " + ", ".join(f"{count} {cause}" for cause, count in sorted(record["misses"].items())))
    if record["cycles_per_hour"] is not None:
        lines.append(f"{record['cycles_per_hour']:.0f} cycles an hour, {record['cycle_time_s']:.2f} s each")
    return "\n".join(lines)
