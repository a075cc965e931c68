"""The command report: a plan, an execution or an experiment as one HTML file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.support.options import calls_service, json_option
from api.cli.support.plan_file import plan_in

if TYPE_CHECKING:
    from api.cli.support.client import ServiceClient
    from api.report import ReportContent

CSV = "text/csv"


@click.command()
@click.argument("file", required=False, type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="PLAN")
@click.option("--plan", "plan_id", metavar="ID", help="A plan of a running service, or latest.")
@click.option("--execution", "execution_id", metavar="ID", help="An execution of a running service, or latest.")
@click.option("--experiment", "experiment_id", metavar="ID", help="An experiment of a running service, or latest.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="HTML file; default: PLAN or ID with .html.")
@click.option("--cells", type=click.Path(exists=True, file_okay=False, path_type=Path), help="FLING_CELLS, for PLAN.")
@json_option
@calls_service
def report(
    file: Path | None,
    plan_id: str | None,
    execution_id: str | None,
    experiment_id: str | None,
    output: Path | None,
    cells: Path | None,
    as_json: bool,
    client: ServiceClient,
) -> None:
    """Write a plan, an execution or an experiment as one self-contained HTML file.

    PLAN is a file with a plan (JSON as from `fling plan` or GET /plans/{id}). The options ask a running service.
    """
    from api.report import report_html

    subjects = {"plan": plan_id, "execution": execution_id, "experiment": experiment_id}
    asked = [(kind, id) for kind, id in subjects.items() if id is not None]
    if len(asked) + (file is not None) != 1:
        raise click.UsageError("name one of PLAN, --plan, --execution, --experiment")
    if file is not None:
        content = _of_file(file, cells)
        target = output or file.with_suffix(".html")
    else:
        kind, id = asked[0]
        content = READERS[kind](client, id)
        target = output or Path(f"{kind}-{id}.html")
    target.write_text(report_html(content), encoding="utf-8")
    click.echo(json.dumps({"plan_id": content.plan["id"], "file": str(target)}) if as_json else target)


def _of_file(file: Path, cells: Path | None) -> ReportContent:
    """Returns the content of a report on a plan in a file."""
    from api.cell_repository import CellRepository
    from api.report import ReportContent
    from api.scene import cell_model, plan_curves
    from api.settings import parse_settings
    from fling import plan_svg
    from planner.errors import PlannerError

    plan = plan_in(file)
    try:
        cell = CellRepository(cells or parse_settings().cells).cell(plan["cell"])
        if cell is None or cell.sha256 != plan["cell_sha256"]:
            return ReportContent(plan)
        return ReportContent(plan, plan_svg(plan, cell), cell_model(cell), plan_curves(plan, cell))
    except (KeyError, TypeError, ValueError, PlannerError) as error:
        raise click.ClickException(f"{file} is not a plan: {error!r}") from error


def _of_plan(client: ServiceClient, id: str, **more: Any) -> ReportContent:
    """Returns the content of a report on a plan of a service."""
    from api.report import ReportContent

    plan = client.get(f"/plans/{id}")
    model = client.get(f"/cells/{plan['cell']}/model")
    if model["sha256"] != plan["cell_sha256"]:
        return ReportContent(plan, **more)
    curves = client.get(f"/plans/{plan['id']}/curves")
    picture = client.text(f"/plans/{plan['id']}/picture.svg")
    return ReportContent(plan, picture, model, curves, **more)


def _of_execution(client: ServiceClient, id: str) -> ReportContent:
    execution = client.get(f"/executions/{id}")
    reported = client.get(f"/executions/{execution['id']}/landing")["landings"]
    landings = [landing for landing in reported if landing.get("withdrawn_at") is None]
    recording = client.text(f"/executions/{execution['id']}/recording", CSV) if execution["outcome"] else ""
    return _of_plan(client, execution["plan_id"], execution=execution, landings=landings, recording=recording)


def _of_experiment(client: ServiceClient, id: str) -> ReportContent:
    experiment = client.get(f"/experiments/{id}")
    if not experiment["throws"]:
        raise click.ClickException(f"experiment {experiment['id']} has no throws yet")
    return _of_plan(client, experiment["throws"][-1]["plan_id"], experiment=experiment)


READERS = {"plan": _of_plan, "execution": _of_execution, "experiment": _of_experiment}
