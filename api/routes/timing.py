"""Timing of a cell's arm, as its own runs show it."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import JSONResponse

from api.dependencies import AnyCaller, ServiceDep
from api.http import json_answer
from api.routes.cells import CellName
from api.schemas import TimingAnswer, iso_time
from learning import cell_in_use, pooled_document, timing_runs

router = APIRouter(tags=["cells"])


@router.get(
    "/cells/{name}/timing",
    summary="Read the arm's timing",
    responses=json_answer(200, TimingAnswer, "Newest run first.", "not-found", "invalid-request"),
)
def read_timing(name: CellName, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Reads lag, gain, first-order part and overshoot of every joint, run by run and pooled, with standard errors.

    Runs under other versions of the cell file count, unless that version describes another arm.
    """
    cell = service.cell(name)
    found = timing_runs(service.store, cell)
    runs = [{"execution_id": row.id, "finished_at": iso_time(row.finished_at), **timing} for row, timing in found]
    assumed_s = cell_in_use(service.store, cell)[0].timing.lag_s
    pooled = pooled_document([timing for _, timing in found], assumed_s)
    return JSONResponse({"cell": name, "assumed_lag_s": assumed_s, "pooled": pooled, "runs": runs})
