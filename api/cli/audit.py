"""The command audit: random problems planned, and every certified plan judged by foreign code."""

from __future__ import annotations

import json
import signal
import sys
import threading
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import click

from api.cli.support.exit_status import INTERRUPTED
from api.cli.support.options import json_option

if TYPE_CHECKING:
    from audit import AuditSummary, Trial

WRONG = 2  # exit status where a certified plan is wrong, as of `fling verify`
NEEDED = {"pinocchio": "pin", "coal": "coal", "mujoco": "mujoco", "scipy": "scipy"}  # modules by their packages
PROOFS_HELP = "Share of the plans that are proven, too, as by `fling verify`."
INDEX_HELP = "Try this problem alone; with --out, write its cell and its request there."


@click.command()
@click.option("--count", type=click.IntRange(min=1), help="Problems: those of the indices below it.")
@click.option("--seed", type=click.IntRange(min=0), required=True, help="Seed of the problems.")
@click.option("--index", type=click.IntRange(min=0), help=INDEX_HELP)
@click.option("--resume", is_flag=True, help="Continue the record in --out; of the same commit and seed.")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), help="Folder of the record; audit-SEED.")
@click.option("--proofs", type=click.FloatRange(0.0, 1.0), default=0.0, metavar="SHARE", help=PROOFS_HELP)
@click.option("--workers", type=click.IntRange(min=1), help="Planner processes; default: one a core.")
@click.option("--ray", metavar="ADDRESS", help="Plan in the Ray cluster at this address.")
@json_option
def audit(
    count: int | None,
    seed: int,
    index: int | None,
    resume: bool,
    out: Path | None,
    proofs: float,
    workers: int | None,
    ray: str | None,
    as_json: bool,
) -> None:
    """Plan random problems in random cells, and judge every certified plan by foreign code.

    A problem is a function of seed and index alone. The record is audit.jsonl, a line a problem, and summary.json; a
    kill loses what was in work. Needs the extra `audit`.

    Exit status: 0 no plan is wrong; 1 wrong input; 2 a certified plan is wrong, or the planner broke down; 130 it was
    interrupted, and --resume goes on.
    """
    _require_packages()
    if (count is None) == (index is None):
        raise click.UsageError("give either --count or --index")
    if index is not None and (resume or workers or ray):
        raise click.UsageError("--resume, --workers and --ray go with --count")
    if index is not None:
        _one(seed, index, out, proofs, as_json)
        return
    from audit import AuditOptions, RecordRefused, run_audit
    from jobs.pool import PoolBroken

    assert count is not None
    folder = Path(f"audit-{seed}") if out is None else out
    stop = threading.Event()
    before = signal.signal(signal.SIGINT, lambda *_: stop.set())
    try:
        options = AuditOptions(count, seed, folder, resume, proofs, workers, ray)
        summary = run_audit(options, _tell, stop.is_set)
    except (RecordRefused, PoolBroken) as error:
        raise click.ClickException(str(error)) from error
    finally:
        signal.signal(signal.SIGINT, before)
    click.echo(json.dumps(summary.as_document()) if as_json else str(summary))
    status = _status(summary, count)
    if status == INTERRUPTED:
        click.echo(f"interrupted after {summary.problems} of {count}: the same command with --resume goes on", err=True)
    sys.exit(status)


def _require_packages() -> None:
    lacking = [package for module, package in NEEDED.items() if find_spec(module) is None]
    if lacking:
        raise click.ClickException(f"not installed: {', '.join(lacking)}: pip install 'fling-robotics[audit]'")


def _tell(trial: Trial) -> None:
    """Says at once which plan is wrong."""
    if trial.is_wrong or trial.outcome == "error":
        click.echo(f"{trial.index} {trial.kind}: {'; '.join(trial.faults) or trial.why or trial.open}", err=True)


def _status(summary: AuditSummary, count: int) -> int:
    if not summary.is_right:
        return WRONG
    return 0 if summary.problems == count else INTERRUPTED


def _one(seed: int, index: int, out: Path | None, proofs: float, as_json: bool) -> None:
    """Tries one problem in this process, and says everything of it."""
    from audit import AuditTask, drawn_problem, tried

    if out is not None:
        drawn = drawn_problem(seed, index)
        out.mkdir(parents=True, exist_ok=True)
        path = drawn.files.write(out)
        request = path.with_suffix(".json")
        request.write_text(json.dumps(drawn.request, indent=2) + "\n", encoding="utf-8")
        click.echo(f"written: {path}, {request}", err=True)
    trial = tried(AuditTask(seed, index, proofs))
    row = trial.as_row()
    click.echo(json.dumps(row) if as_json else "\n".join(f"{name}: {value}" for name, value in row.items()))
    sys.exit(WRONG if trial.is_wrong else 0)
