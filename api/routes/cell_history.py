"""The versions of a cell file."""

from __future__ import annotations

from contextlib import suppress

from fastapi import APIRouter
from fastapi.responses import JSONResponse

from api.cell_history import history_document
from api.dependencies import AnyCaller, ServiceDep
from api.http import json_answer
from api.routes.cells import CellName
from api.schemas import CellHistory
from planner.errors import CellError

router = APIRouter(tags=["cells"])


@router.get(
    "/cells/{name}/history",
    summary="List the versions of a cell",
    responses=json_answer(200, CellHistory, "Newest first, with what changed.", "not-found", "invalid-request"),
)
def read_history(name: CellName, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Lists the versions of a cell file that service or executor have seen, each with the keys that it changed."""
    with suppress(CellError):  # a file that is refused has a history all the same
        service.cell(name)
        service.cell_version(name)
    return JSONResponse(history_document(name, service.store.cell_versions(name)))
