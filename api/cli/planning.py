"""Commands that plan without a service: plan, report, warm, bench."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import click

INFEASIBLE = 2  # exit status: the request was understood and cannot be done


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, allow_dash=True, path_type=Path))
@click.option("--cells", type=click.Path(exists=True, file_okay=False, path_type=Path), help="FLING_CELLS.")
@click.option("--cell", help="Which cell where the request names none; FLING_DEFAULT_CELL.")
def plan(file: Path, cells: Path | None, cell: str | None) -> None:
    """Plan the request in FILE (JSON as for POST /plan; - reads standard input) and write the plan to standard output.

    Exit status 2 with the problem (JSON) on standard error where the request is wrong or cannot be done.
    """
    from api.errors import Problem, translate
    from api.problems import document
    from planner.errors import PlannerError

    try:
        click.echo(_plan(_read(file), cells, cell))
    except Problem as problem:
        _give_up(document(problem, str(file)))
    except PlannerError as error:
        _give_up(document(translate(error), str(file)))


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="PLAN")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="HTML file; PLAN with .html otherwise.")
@click.option("--cells", type=click.Path(exists=True, file_okay=False, path_type=Path), help="FLING_CELLS.")
def report(file: Path, output: Path | None, cells: Path | None) -> None:
    """Write the plan in PLAN (JSON as from `fling plan` or GET /plans/{id}) as one self-contained HTML file."""
    from api.report import report_html
    from api.settings import Settings
    from api.shelf import CellShelf
    from planner.errors import PlannerError

    target = output or file.with_suffix(".html")
    try:
        plan = json.loads(file.read_text())
        shelf = CellShelf(cells or Settings().cells)
        target.write_text(report_html(plan, shelf.cell(plan["cell"])))
    except (KeyError, TypeError, ValueError, PlannerError) as error:
        raise click.ClickException(f"{file} is not a plan: {error!r}") from error
    click.echo(target)


@click.command()
def warm() -> None:
    """Build the generated solvers for this machine and cache them, so that no request waits for a compiler."""
    from planner.backends.casadi_nlp import warm as build

    with click.progressbar(length=100, label="solvers") as bar:

        def progress(what: str, share: float) -> None:
            bar.label = f"solvers: {what}"
            bar.update(max(0, round(100 * share) - bar.pos))

        compiled = build(progress)
    if not compiled:
        click.echo("There is no C compiler: the interpreted functions are used; they are slower.", err=True)


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("arguments", nargs=-1)
def bench(arguments: tuple[str, ...]) -> None:
    """Run the benchmark of this checkout; ARGUMENTS are those of `python -m tests.benchmarks`."""
    if not Path("tests", "benchmarks").is_dir():
        raise click.ClickException("the benchmark is part of the checkout: run this in its folder")
    os.execv(sys.executable, [sys.executable, "-m", "tests.benchmarks", *arguments])


def _read(file: Path) -> Any:
    from pydantic import ValidationError

    from api.errors import Problem, invalid
    from api.problems import field_errors
    from api.schemas.requests import PlanRequest

    text = sys.stdin.read() if str(file) == "-" else file.read_text()
    try:
        return PlanRequest.model_validate_json(text)
    except ValidationError as error:
        errors = field_errors(error.errors(include_input=False))
        detail = "; ".join(f"{e['field']}: {e['reason']}" for e in errors)
        raise Problem("invalid-request", detail, errors=errors) from error
    except UnicodeDecodeError as error:
        raise invalid("file", "is not UTF-8") from error


def _plan(body: Any, cells: Path | None, cell: str | None) -> str:
    import time

    from api.clock import iso
    from api.errors import invalid
    from api.settings import Settings
    from api.shelf import CellShelf
    from api.solving import Job, Refused, solve
    from store import new_id

    settings = Settings()
    shelf, name = CellShelf(cells or settings.cells), body.cell or cell or settings.default_cell
    if body.start is not None and body.start.current:
        raise invalid("start.current", "needs a service with an executor")
    if shelf.cell(name) is None:
        raise invalid("cell", f"no cell {name!r}; there are {', '.join(shelf.names())}")
    request = {**body.model_dump(exclude_none=True), "cell": name}
    answer = solve(Job(new_id(), iso(time.time()) or "", name, shelf.text(name) or b"", request))
    if isinstance(answer, Refused):
        answer.raise_again()
        raise AssertionError("a refusal always raises")
    return answer.document.decode()


def _give_up(problem: dict[str, Any]) -> None:
    click.echo(json.dumps(problem, indent=2), err=True)
    sys.exit(INFEASIBLE)
