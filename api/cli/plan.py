"""The command that works without a service: plan."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from api.cli.support.errors import Finite
from api.cli.support.options import json_option
from api.cli.support.search_line import SearchLine
from api.cli.support.summary import plan_text

if TYPE_CHECKING:
    from api.problems import ProblemDetails
    from jobs.planning import PlanningJob, PlanRecord
    from planner.errors import PlannerError
    from planner.progress import Observer


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, allow_dash=True, path_type=Path))
@click.option("--cells", type=click.Path(exists=True, file_okay=False, path_type=Path), help="FLING_CELLS.")
@click.option("--cell", help="Cell of a request that names none; default: FLING_DEFAULT_CELL.")
@click.option("--odds", type=Finite(0.0, 1.0), help="min_hit_probability of the request [-].")
@json_option
def plan(file: Path, cells: Path | None, cell: str | None, odds: float | None, as_json: bool) -> None:
    """Plan the request in FILE (JSON as for POST /plan; - reads standard input) and write the plan to standard output.

    Standard error has a summary, but with --json; or the problem, as JSON (on a terminal in sentences, but with --json)
    with exit status 2 for an infeasible request, 3 where its time limit ended the search, 1 for an invalid one.
    """
    from api.cli.support.request_file import read_document
    from api.problems import ProblemDetails
    from planner.errors import PlannerError

    try:
        asked = _job(read_document(file), odds, cells, cell)
        with SearchLine(as_json) as line:
            planned = _solved(asked, line)
    except (ProblemDetails, PlannerError) as error:
        _refuse(error, file, as_json)
    plan_document = planned.row.document.decode()
    click.echo(plan_document)
    if not as_json:
        click.echo(plan_text(json.loads(plan_document)), err=True)


def _refuse(error: ProblemDetails | PlannerError, file: Path, as_json: bool) -> NoReturn:
    """Ends the command with what is wrong with its request."""
    from api.cli.support.errors import RefusedRequest
    from api.cli.support.exit_status import exit_status
    from api.problems import ProblemDetails, planner_problem, problem_document

    problem = error if isinstance(error, ProblemDetails) else planner_problem(error)
    document = problem_document(problem, str(file))
    if as_json:
        raise RefusedRequest(document) from None
    if sys.stderr.isatty():
        from api.cli.support.client import describe

        raise RefusedRequest(document, describe(document, as_request=True)) from None
    click.echo(json.dumps(document, indent=2), err=True)
    sys.exit(exit_status(problem.name))


def _solved(job: PlanningJob, observer: Observer) -> PlanRecord:
    """Plans; loads all that this takes."""
    from jobs.planning import solve

    return solve(job, observer)


def _job(document: Any, odds: float | None, cells: Path | None, cell: str | None) -> PlanningJob:
    """Returns the job of a request, once its fields are checked."""
    from planner.request import read_request

    asked = read_request(document)  # a slip is answered before anything else is loaded
    from api.cell_repository import CellRepository, UnknownCell
    from api.problems import invalid_field
    from api.settings import parse_settings
    from jobs.planning import PlanningJob
    from store import new_id

    if odds is not None:
        asked["min_hit_probability"] = odds
    settings = parse_settings()
    name = asked.get("cell", settings.default_cell if cell is None else cell)
    try:
        source, _ = CellRepository(cells or settings.cells).required(name)
    except UnknownCell as error:
        raise invalid_field("cell", str(error)) from None
    return PlanningJob(new_id(), time.time(), source, {**asked, "cell": name})
