"""What a client asks for of a batch, checked request by request; and what it is told of its progress."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from api.cell_repository import CellRepository
from api.http import invalid_field, invalid_request
from api.schemas import BatchRequest, PlanRequest, iso_time
from jobs.batches import BatchRequests, BatchSpecification, CellUse
from store import BatchRow, Store

ERRORS_MAX = 20  # errors that are listed; a template's fault is one of every request


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
        ProblemDetails: A request is wrong, `requests[7].release…`; an axis; the size; a cell that is not there.
        InvalidProblem: An axis of the grid, or its size.
        CellError: The file of a cell is refused.
    """
    requests = _requests(body, size_max)
    uses = {}
    for name in requests.cells(default_cell):
        source = cells.source(name)
        if source is None or cells.cell(name) is None:
            raise invalid_field("cell", cells.without(name))
        version = store.note_cell_version(name, source.sha256, source.text, source.calibration, "service")
        adopted = store.profile_in_use(name, source.sha256)
        uses[name] = CellUse(version, None if adopted is None else adopted.id)
    return BatchSpecification(requests, default_cell, uses)


def batch_document(row: BatchRow) -> dict[str, Any]:
    """Returns the JSON of a batch: `BatchAnswer`."""
    rate = row.rate_per_s
    return {
        "id": row.id,
        "created_at": iso_time(row.created_at),
        "created_by": row.created_by,
        "state": row.state,
        "outcome": row.outcome,
        "reason": row.reason,
        "total": row.total,
        "done": row.done,
        "counts": dict(row.counts),
        "rate_per_s": rate,
        "time_left_s": (row.total - row.done) / rate if rate else None,
        "cancel_requested": row.cancel_requested_at is not None,
        "started_at": iso_time(row.started_at),
        "finished_at": iso_time(row.finished_at),
    }


def _requests(body: BatchRequest, size_max: int) -> BatchRequests:
    listed = None
    grid = None
    if body.requests is None:
        grid = {path: axis if isinstance(axis, list) else axis.model_dump() for path, axis in (body.grid or {}).items()}
    else:
        listed = [request.model_dump(exclude_none=True) for request in body.requests]
    requests = BatchRequests(listed, body.template, grid)
    if len(requests) > size_max:
        field = "requests" if listed else "grid"
        raise invalid_field(field, f"{len(requests)} requests; a batch of this service has at most {size_max}")
    errors: list[Any] = []
    for number, request in enumerate(requests):
        errors += [_at(number, error) for error in _errors(request, is_checked=listed is not None)]
        if len(errors) >= ERRORS_MAX:
            break
    if errors:
        raise invalid_request(errors[:ERRORS_MAX], BatchRequest)
    return requests


def _errors(request: Any, is_checked: bool) -> list[Any]:
    """Returns what is wrong with a request, as pydantic says it; one of a list was checked as a body."""
    try:
        if not is_checked:
            PlanRequest.model_validate(request)
    except ValidationError as error:
        return list(error.errors())
    if request.get("start", {}).get("current"):
        msg = "a batch is planned later: give positions"
        return [{"loc": ("start", "current"), "type": "value_error", "msg": msg}]
    return []


def _at(number: int, error: Any) -> dict[str, Any]:
    return {**error, "loc": ("requests", number, *error["loc"])}
