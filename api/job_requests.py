"""What a client asks for of a job, checked against its cell; and what it is told of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from api.schemas import iso_time
from jobs.cycles import JobOrder, motion_request, object_results, shift_record
from planner.cell import Cell
from planner.errors import ERRORS_MAX, FieldError, InvalidProblem
from planner.request import problem_from_request
from store import JobCycleRow, JobRow, LandingRow

HEAD = ("id", "created_by", "cell", "state", "outcome", "reason", "total")
TIMES = ("created_at", "started_at", "finished_at")
CURRENT = ("kind", "pick", "next_pick", "target", "attempt", "execution_id")


def check_order(order: JobOrder, cell: Cell) -> None:
    """Checks every pick and target of a job as the planner will.

    Raises:
        InvalidProblem: the first refused fields, each with its reason.
    """
    errors: list[FieldError] = []
    for i, pick in enumerate(order.picks):
        request = motion_request(cell.name, cell.home.tolist(), order.lines, next_pick=pick["pose"])
        errors += _refused(request, cell, f"picks[{i}].pose")
        if len(errors) >= ERRORS_MAX:
            break
    for i, target in enumerate(order.targets):
        request = motion_request(cell.name, cell.home.tolist(), order.lines, target=target)
        errors += _refused(request, cell, f"targets[{i}]", "passages[0].state")
    if errors:
        raise InvalidProblem(errors[:ERRORS_MAX])


def job_head(row: JobRow) -> dict[str, Any]:
    """Returns the JSON of a job without its record: `JobHead`."""
    return {
        **{name: getattr(row, name) for name in HEAD},
        **{name: iso_time(getattr(row, name)) for name in TIMES},
        "pause_requested": row.pause_requested_at is not None,
        "cancel_requested": row.cancel_requested_at is not None,
    }


def job_document(row: JobRow, cycles: Sequence[JobCycleRow], landings: Sequence[LandingRow]) -> dict[str, Any]:
    """Returns the JSON of a job with its record: `JobAnswer`."""
    objects = object_results(JobOrder.read(row.ordered, row.cell), cycles, landings)
    running = next((cycle for cycle in cycles if cycle.result is None), None)
    return {
        **job_head(row),
        "done": sum(each["result"] not in ("waiting", "moving") for each in objects),
        "current": None if running is None else {name: getattr(running, name) for name in CURRENT},
        "record": shift_record(objects, cycles),
    }


def result_documents(
    row: JobRow, cycles: Sequence[JobCycleRow], landings: Sequence[LandingRow]
) -> list[dict[str, Any]]:
    """Returns what became of every object: `ObjectResult`."""
    objects = object_results(JobOrder.read(row.ordered, row.cell), cycles, landings)
    return [
        {**each, "asked_at": iso_time(each["asked_at"]), "ended_at": iso_time(each["ended_at"])} for each in objects
    ]


def _refused(request: Mapping[str, Any], cell: Cell, field: str, path: str = "") -> list[FieldError]:
    """Returns the refusals of a motion under the field of the job that they are about."""
    try:
        problem_from_request(request, cell)
    except InvalidProblem as error:
        own = [each.field.removeprefix(path) if path and each.field.startswith(path) else "" for each in error.errors]
        return [FieldError(field + name, each.reason) for name, each in zip(own, error.errors, strict=True)]
    return []
