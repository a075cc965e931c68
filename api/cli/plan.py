"""The command that plans without a service."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.support.errors import Finite
from api.cli.support.summary import plan_text

if TYPE_CHECKING:
    from batch.jobs import Planned


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, allow_dash=True, path_type=Path))
@click.option("--cells", type=click.Path(exists=True, file_okay=False, path_type=Path), help="FLING_CELLS.")
@click.option("--cell", help="Cell of a request that names none; default: FLING_DEFAULT_CELL.")
@click.option("--odds", type=Finite(0.0, 1.0), help="min_hit_probability of the request [-].")
def plan(file: Path, cells: Path | None, cell: str | None, odds: float | None) -> None:
    """Plan the request in FILE (JSON as for POST /plan; - reads standard input) and write the plan to standard output.

    Standard error has a summary; or the problem, as JSON (on a terminal in sentences, unless --json is given), with
    exit status 2 for an infeasible request, 3 where its time limit ended the search, 1 for an invalid one.
    """
    from api.cli.support.client import describe
    from api.cli.support.errors import RefusedRequest
    from api.cli.support.exit_status import exit_status
    from api.cli.support.request_file import read_request
    from api.http import ProblemDetails, problem_document, translate
    from api.schemas import PlanRequest
    from planner.errors import PlannerError

    try:
        body = read_request(file, PlanRequest)
        planned = _plan(body if odds is None else body.model_copy(update={"min_hit_probability": odds}), cells, cell)
    except (ProblemDetails, PlannerError) as error:
        problem = translate(error)
        document = problem_document(problem, str(file))
        if sys.stderr.isatty():
            raise RefusedRequest(document, describe(document, as_request=True)) from None
        click.echo(json.dumps(document, indent=2), err=True)
        sys.exit(exit_status(problem.name))
    plan_document = planned.document.decode()
    click.echo(plan_document)
    click.echo(plan_text(json.loads(plan_document)), err=True)


def _plan(body: Any, cells: Path | None, cell: str | None) -> Planned:
    import time

    from api.cell_repository import CellRepository
    from api.http import invalid_field
    from api.schemas import iso_time
    from api.settings import parse_settings
    from batch.jobs import PlanningJob, solve
    from store import new_id

    settings = parse_settings()
    repository = CellRepository(cells or settings.cells)
    name = body.cell or cell or settings.default_cell
    if body.start is not None and body.start.current:
        raise invalid_field("start.current", "needs a service with an executor")
    source = repository.source(name)
    if source is None or repository.cell(name) is None:
        raise invalid_field("cell", repository.without(name))
    request = {**body.model_dump(exclude_none=True), "cell": name}
    job = PlanningJob(new_id(), iso_time(time.time()) or "", source, request)
    return solve(job)
