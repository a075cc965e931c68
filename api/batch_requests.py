"""What a client asks for of a batch, checked request by request; and what it is told of its progress."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from api.cell_repository import CellRepository, UnknownCell
from api.http import invalid_field
from api.schemas import BatchRequest, iso_time
from jobs.batches import BatchRequests, BatchSpecification, CellUse
from planner.errors import ERRORS_MAX, CellError, FieldError, InvalidProblem
from planner.request import read_request, target_moves, tracked_targets
from store import BatchRow, Store


def batch_specification(
    body: BatchRequest, store: Store, cells: CellRepository, default_cell: str, size_max: int
) -> BatchSpecification:
    """Returns the specification of a batch; notes the versions of its cells.

    Args:
        body: as posted.
        store: for the cells' versions and profiles.
        cells: the cells that there are.
        default_cell: of requests that name none.
        size_max: greatest number of requests.

    Raises:
        ProblemDetails: The size, or a cell that is not there or whose file is refused, `requests[7].cell`.
        InvalidProblem: A request is wrong, `requests[7].release…`; an axis of the grid, or its size.
    """
    requests = _requests(body, size_max)
    uses = {}
    for name in requests.cells(default_cell):
        try:
            source, _ = cells.required(name)
        except (UnknownCell, CellError) as error:
            named = next((k for k, each in enumerate(requests) if each.get("cell") == name), None)
            field = "cell" if named is None else f"requests[{named}].cell"  # of a request that names none: the default
            refused = "the cell file is refused: " if isinstance(error, CellError) else ""
            raise invalid_field(field, f"{refused}{error}") from error
        version = store.note_cell_version(
            name, source.sha256, source.text, source.calibration, "service", source.meshes
        )
        adopted = store.profile_in_use(name, source.sha256)
        uses[name] = CellUse(version, None if adopted is None else adopted.id)
    return BatchSpecification(requests, default_cell, uses)


def batch_document(row: BatchRow) -> dict[str, Any]:
    """Returns the JSON of a batch: `BatchAnswer`."""
    rate = row.rate_per_s
    shown = ("id", "created_by", "state", "outcome", "reason", "total", "done")
    times = ("created_at", "started_at", "finished_at")
    return {
        **{name: getattr(row, name) for name in shown},
        **{name: iso_time(getattr(row, name)) for name in times},
        "counts": dict(row.counts),
        "rate_per_s": rate,
        "time_left_s": (row.total - row.done) / rate if rate else None,
        "cancel_requested": row.cancel_requested_at is not None,
    }


def _requests(body: BatchRequest, size_max: int) -> BatchRequests:
    grid = None
    if body.requests is None:
        grid = {path: axis if isinstance(axis, list) else axis.model_dump() for path, axis in (body.grid or {}).items()}
    requests = BatchRequests(body.requests, body.template, grid)
    if len(requests) > size_max:
        field = "grid" if body.requests is None else "requests"
        raise invalid_field(field, f"{len(requests)} requests; a batch of this service has at most {size_max}")
    if body.requests is not None:
        return BatchRequests(list(_checked(requests)))
    for _ in _checked(requests):  # not kept: they are made again when they are planned
        pass
    return requests


def _checked(requests: BatchRequests) -> Iterator[dict[str, Any]]:
    """Yields the requests as they are read.

    Raises:
        InvalidProblem: The first faults of all of them; a template's is one of every request.
    """
    errors: list[FieldError] = []
    for number in range(len(requests)):
        try:
            yield _read(requests[number], f"requests[{number}]")
        except InvalidProblem as error:
            errors += error.errors
        if len(errors) >= ERRORS_MAX:
            break
    if errors:
        raise InvalidProblem(errors)


def _read(document: Any, path: str) -> dict[str, Any]:
    """Returns one request of a batch.

    Raises:
        InvalidProblem: every refused field with its reason.
    """
    request = read_request(document, path)
    start = request.get("start", {})
    for key in ("current", "execution"):
        if key in start and "positions" not in start:
            raise InvalidProblem([FieldError(f"{path}.start.{key}", "a batch is planned later: give positions")])
    if tracked := tracked_targets(request):
        reason = "a batch is planned later, when a tracked target is elsewhere"
        raise InvalidProblem([FieldError(f"{path}.{each}.position", reason) for each in tracked])
    if target_moves(request) and "starts_not_before_s" not in request:
        reason = "is missing: a batch is planned later, and its target moves by the controller's clock"
        raise InvalidProblem([FieldError(f"{path}.starts_not_before_s", reason)])
    return request
