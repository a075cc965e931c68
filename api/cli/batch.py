"""`fling batch`: many planning requests, here and now or through a running service."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.support.exit_status import INTERRUPTED, NotCompleted
from api.cli.support.options import json_option, service_options
from api.cli.support.summary import outcome_text

if TYPE_CHECKING:
    from api.schemas import BatchRequest
    from jobs.batches import Parameters
    from store import BatchResultRow, BatchRow, Store

POLL_S = 0.5  # [s] between two looks at the progress of a service's batch
PAGE = 200  # results read at once from a service
OUT_HELP = "Write the results to a file: .parquet, .csv or .jsonl."
RAY_HELP = "Plan in the Ray cluster at this address; FLING_RAY_ADDRESS."


@click.command()
@click.argument("file", required=False, type=click.Path(exists=True, dir_okay=False, allow_dash=True, path_type=Path))
@click.option("--resume", metavar="ID", help="Resume a batch that was stopped, or whose driver died; or latest.")
@click.option("--cancel", metavar="ID", help="End a batch, or latest; its results so far stay.")
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help=OUT_HELP)
@click.option("--workers", type=click.IntRange(min=1), help="Planner processes; FLING_BATCH_WORKERS, or one a core.")
@click.option("--ray", metavar="ADDRESS", help=RAY_HELP)
@json_option
@click.option("--cells", type=click.Path(exists=True, file_okay=False, path_type=Path), help="FLING_CELLS.")
@click.option("--cell", help="Cell of requests that name none; default: FLING_DEFAULT_CELL.")
@service_options
def batch(
    file: Path | None,
    resume: str | None,
    cancel: str | None,
    out: Path | None,
    workers: int | None,
    ray: str | None,
    as_json: bool,
    cells: Path | None,
    cell: str | None,
    url: str | None,
    token: str | None,
) -> None:
    """Plan the requests in FILE (JSON as for POST /batches; - reads standard input), and store their plans.

    {"requests": [...]} is a list of requests; {"template": {...}, "grid": {"release.position[0]": [from, to, step]}}
    all combinations of some values. Without --url it needs no service. Ctrl-C stops: what is planned is stored, and
    --resume continues. A batch is done even if every request is infeasible.
    """
    from api.settings import read_settings
    from jobs.batches import writes_to

    if sum(given is not None for given in (file, resume, cancel)) != 1:
        raise click.UsageError("give FILE, --resume ID or --cancel ID")
    if out is not None and not writes_to(out):
        raise click.UsageError(f"--out {out}: must end in .parquet, .csv or .jsonl")
    if url is not None and (workers or ray or cells or cell):
        raise click.UsageError("--workers, --ray, --cells and --cell are the service's own; they do not go with --url")
    if url is not None:
        _through_service(url, token, file, resume, cancel, out, as_json)
        return
    settings = read_settings(cells=cells, default_cell=cell, batch_workers=workers, ray_address=ray)
    from store import Store

    store = Store.open(settings.database_url)
    try:
        if cancel is not None:
            _report(_document(store.cancel_batch(_chosen(store, cancel))), as_json)
            return
        id = _queue(store, settings, _read(file)) if resume is None else _chosen(store, resume)
        row = store.batch(id)
        if row is None or row.state != "finished":
            row = _drive(store, settings, id, as_json)
        if out is not None:
            _write(out, _results_of_store(store, id))
        _report(_document(row), as_json)
        _require_completed(_document(row))
    finally:
        store.close()


def _chosen(store: Store, id: str) -> str:
    """Returns the id that is meant, `latest` being the newest batch."""
    newest, _ = store.batches(1) if id == "latest" else ([], None)
    return newest[0].id if newest else id


def _read(file: Path | None) -> BatchRequest:
    from pydantic import ValidationError

    from api.cli.support.errors import RefusedRequest
    from api.cli.support.request_file import BATCH_BYTES, read_document
    from api.http import invalid_request, problem_document, translate
    from api.schemas import BatchRequest
    from planner.errors import InvalidProblem

    assert file is not None  # a batch is not resumed
    try:
        return BatchRequest.model_validate(read_document(file, BATCH_BYTES))
    except ValidationError as error:
        refusal = invalid_request(error.errors(), BatchRequest)
        raise RefusedRequest(problem_document(refusal, str(file))) from error
    except InvalidProblem as error:
        raise RefusedRequest(problem_document(translate(error), str(file))) from error


def _queue(store: Store, settings: Any, body: BatchRequest) -> str:
    """Checks and stores a batch; returns its id."""
    from api.batch_requests import batch_specification
    from api.cell_repository import CellRepository
    from api.cli.support.errors import RefusedRequest
    from api.http import ProblemDetails, problem_document, translate
    from jobs.batches import BATCH_MAX
    from planner.errors import PlannerError

    try:
        asked = batch_specification(body, store, CellRepository(settings.cells), settings.default_cell, BATCH_MAX)
    except (ProblemDetails, PlannerError) as error:
        raise RefusedRequest(problem_document(translate(error), "batch")) from error
    return store.add_batch(asked.pack(), len(asked.requests), "local", "command").id


def _drive(store: Store, settings: Any, id: str, as_json: bool) -> BatchRow:
    """Plans a batch with a progress bar; Ctrl-C stops it, a second one at once."""
    from jobs import driver
    from jobs.batches import DrivenBatch, wait_and_claim
    from jobs.pool import PoolBroken

    claimed = wait_and_claim(store, id, f"fling batch {os.getpid()}")
    if not as_json:
        click.echo(f"batch {id}; to resume it: fling batch --resume {id}", err=True)
    with _ProgressBar(claimed.total, claimed.done, as_json) as advance:
        workers = settings.batch_workers or None  # 0 is of a service
        task = DrivenBatch(store, claimed, lambda row: advance(row.done))
        stop = threading.Event()
        before = signal.signal(signal.SIGINT, lambda *_: _stop(stop, id))
        try:
            driver.run(task, workers, settings.ray_address, stop.is_set)
        except PoolBroken as error:
            raise click.ClickException(f"{error}; resume with: fling batch --resume {id}") from error
        finally:
            signal.signal(signal.SIGINT, before)
    row = store.batch(id) or claimed
    if row.state != "finished":
        click.echo(f"stopped with {row.done} of {row.total}; resume with: fling batch --resume {id}", err=True)
        sys.exit(INTERRUPTED)
    return row


def _stop(stop: threading.Event, id: str) -> None:
    click.echo(f"\nstopping; what is planned is stored in batch {id}", err=True)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    stop.set()


class _ProgressBar:
    """A progress bar on standard error, where a person reads it; its block gets the function that moves it."""

    def __init__(self, total: int, done: int, is_silent: bool) -> None:
        label = f"{total} plans"
        hidden = is_silent or not sys.stderr.isatty()
        self._bar: Any = click.progressbar(length=total, label=label, file=sys.stderr, hidden=hidden, show_pos=True)
        self._done = done

    def __enter__(self) -> Callable[[int], None]:
        self._bar.__enter__()
        self._bar.update(self._done)
        return self._advance

    def __exit__(self, *error: Any) -> None:
        self._bar.__exit__(*error)

    def _advance(self, done: int) -> None:
        self._bar.update(done - self._done)
        self._done = done


def _through_service(
    url: str,
    token: str | None,
    file: Path | None,
    resume: str | None,
    cancel: str | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Has a service plan a batch, and watches it; the service takes up its batches by itself."""
    from api.cli.support.client import ServiceClient

    with ServiceClient(url, token) as client:
        if cancel is not None:
            _report(client.post(f"/batches/{cancel}/cancel"), as_json)
            return
        if resume is None:
            body = _read(file).model_dump(exclude_none=True)
            document = client.post("/batches", body)
        else:
            document = client.get(f"/batches/{resume}")
        try:
            document = _watch(client, document, as_json)
        except KeyboardInterrupt:
            id = document["id"]
            click.echo(f"\nthe service continues; end it with: fling batch --cancel {id} --url {url}", err=True)
            raise
        if out is not None:
            _write(out, _results_of_service(client, document["id"]))
        _report(document, as_json)
        _require_completed(document)


def _watch(client: Any, document: dict[str, Any], as_json: bool) -> dict[str, Any]:
    """Returns a batch once it is finished."""
    with _ProgressBar(document["total"], document["done"], as_json) as advance:
        while document["state"] != "finished":
            time.sleep(POLL_S)
            document = client.get(f"/batches/{document['id']}")
            advance(document["done"])
    return document


def _results_of_store(store: Store, id: str) -> Iterator[tuple[BatchResultRow, Parameters]]:
    """Yields the results of a batch with what its grid gave each request."""
    from jobs.batches import BatchSpecification

    requests = BatchSpecification.stored(store, id).requests
    yield from ((row, requests.parameters(row.number)) for row in store.all_batch_results(id))


def _results_of_service(client: Any, id: str) -> Iterator[tuple[BatchResultRow, Parameters]]:
    """Yields the results of a service's batch with what its grid gave each request."""
    from store import BatchResultRow

    cursor = -1
    while cursor is not None:
        page = client.get(f"/batches/{id}/results?limit={PAGE}&cursor={cursor}")
        for result in page["results"]:
            parameters = result.pop("parameters")
            yield BatchResultRow(batch_id=id, **result), parameters
        cursor = page["next_cursor"]


def _write(out: Path, results: Iterator[tuple[BatchResultRow, Parameters]]) -> None:
    from jobs.batches import ParquetMissing, write_table

    try:
        write_table(out, results)
    except ParquetMissing as error:
        raise click.ClickException(f"{out} {error}") from error


def _document(row: BatchRow) -> dict[str, Any]:
    from api.batch_requests import batch_document

    return batch_document(row)


def _report(document: dict[str, Any], as_json: bool) -> None:
    """Writes a batch: what became of it, and its results by outcome."""
    if as_json:
        click.echo(json.dumps(document))
    else:
        counts = ", ".join(f"{count} {outcome}" for outcome, count in sorted(document["counts"].items()))
        state = document["outcome"] or document["state"]
        click.echo(f"batch {document['id']}: {state}; {document['done']} of {document['total']}: {counts or 'none'}")


def _require_completed(document: dict[str, Any]) -> None:
    if document["outcome"] != "completed":
        raise NotCompleted(f"batch {document['id']}: {outcome_text(document)}")
