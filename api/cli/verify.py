"""The command verify: a plan proven anew."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.support.options import json_option
from api.cli.support.plan_file import cell_of_plan, plan_in
from planner.documents import read_text

if TYPE_CHECKING:
    from verifier import Verification

PROFILE_BYTES = 50_000_000  # [byte] of a profile; one of a hundred throws has some 100,000
STATUSES = {"proven": 0, "not proven": 1, "violated": 2}  # source: contract, section 9


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="PLAN")
@click.option("--cells", type=click.Path(exists=True, file_okay=False, path_type=Path), help="FLING_CELLS.")
@click.option(
    "--profile",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="The profile that PLAN was made with: JSON as from `fling profile show ID --json`.",
)
@json_option
def verify(file: Path, cells: Path | None, profile: Path | None, as_json: bool) -> None:
    """Prove the plan in PLAN (JSON as from `fling plan` or GET /plans/{id}) anew, for all times and all rounding.

    The verifier shares neither code nor tolerances with the certificate. It writes what is not proven, with the time.
    Exit status: 0 proven; 1 not proven, or wrong input; 2 violated.
    """
    from planner.errors import PlannerError
    from verifier import NotAPlan
    from verifier import verify as verdict_of

    plan = plan_in(file)
    learnt = None if profile is None else _profile_in(profile)
    try:
        verdict = verdict_of(plan, cell_of_plan(plan, cells), learnt)
    except (NotAPlan, PlannerError) as error:
        raise click.ClickException(f"{file}: {error}") from error
    click.echo(_document(verdict) if as_json else _text(verdict))
    sys.exit(STATUSES[verdict.status.value])


def _profile_in(file: Path) -> dict[str, Any]:
    """Returns the profile in a file."""
    try:
        found = json.loads(read_text(file, PROFILE_BYTES))
    except (ValueError, RecursionError) as error:
        raise click.ClickException(f"{file} is not a profile: it is not JSON ({error})") from error
    if not isinstance(found, dict):
        raise click.ClickException(f"{file} is not a profile: it has another form")
    return found


def _text(verdict: Verification) -> str:
    checks = len({finding.name for finding in verdict.findings})
    left = len({finding.name for finding in verdict.open})
    counts = f"{left} of {checks} checks" if left else f"{checks} checks"
    aside = dict.fromkeys(each.detail for each in verdict.findings if each.detail.endswith("m beside the target"))
    return "\n".join([*verdict.reasons, *aside, f"{verdict.status}: {counts}"])


def _document(verdict: Verification) -> str:
    checks = [
        {"name": each.name, "status": each.status.value, "at_s": each.at_s, "detail": each.detail}
        for each in verdict.findings
    ]
    return json.dumps({"status": verdict.status.value, "checks": checks})
