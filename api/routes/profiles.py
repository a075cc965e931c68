"""Profiles: what to move for one, estimate one from what is known of a cell, list, read, adopt, revert."""

from __future__ import annotations

from typing import Annotated, Any

import orjson
from fastapi import APIRouter, Query, Response
from fastapi.responses import JSONResponse

from api.dependencies import AnyCaller, OperateCaller, Origin, RequestOrigin, Service, ServiceDep, id_in_path
from api.http import Caller, ProblemDetails, json_answer, problem_answers
from api.report import explained_svg
from api.routes.cells import CellName
from api.schemas import Adoption, CalibrationMoves, ProfileAnswer, ProfileList, iso_time
from learning import calibration_moves, estimate_profile, profile_bytes
from store import ProfileRow

router = APIRouter(tags=["profiles"])

ProfileId = Annotated[str, id_in_path("profile")]
# After 8 throws the delay is within its own scatter: docs/learning.md.
Throws = Annotated[int, Query(ge=2, le=100, description="Number of throws that are wanted.")]
WHOLE_ONLY = ("landings", "state", "covariance", "mixture", "joint_speeds", "timing", "cell_file")
OUTDATED = "the cell file has changed since the profile was learnt; estimate and adopt a new one"
ACTING = ("unauthenticated", "forbidden")


@router.get(
    "/cells/{name}/calibration",
    summary="Read the moves of a calibration",
    responses=json_answer(200, CalibrationMoves, "Requests, none of them planned.", "not-found", "invalid-request"),
)
def read_calibration(name: CellName, service: ServiceDep, caller: AnyCaller, throws: Throws = 8) -> JSONResponse:
    """Reads what to plan and execute, in turn, for a profile of a cell: small motions, then throws. Nothing moves."""
    return JSONResponse(calibration_moves(service.cell(name), throws))


@router.post(
    "/cells/{name}/profiles",
    status_code=201,
    summary="Estimate a profile",
    responses=json_answer(201, ProfileAnswer, "Stored, not adopted.", "not-found", "invalid-request", *ACTING),
)
def estimate_profile_of_cell(
    name: CellName, service: ServiceDep, caller: OperateCaller, origin: Origin
) -> JSONResponse:
    """Estimates lag, gripper, base and object from every execution and landing of a cell. Plans do not use it yet."""
    cell = service.cell(name)
    version = service.cell_version(name)
    document = profile_bytes(estimate_profile(service.store, cell))
    row = service.store.add_profile(name, cell.sha256, caller.name, document, origin.act(caller, "profile"), version)
    return JSONResponse(_whole(row, _adopted_id(service, name)), 201, {"Location": f"/profiles/{row.id}"})


@router.get(
    "/cells/{name}/profiles",
    summary="List profiles",
    responses=json_answer(200, ProfileList, "Newest first.", "not-found", "invalid-request"),
)
def list_profiles(name: CellName, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Lists what was learnt of a cell, newest first, and which profile it uses."""
    service.cell(name)
    adopted = _adopted_id(service, name)
    rows = [{k: v for k, v in _whole(row, adopted).items() if k not in WHOLE_ONLY}
            for row in service.store.profiles_of_cell(name)]  # fmt: skip
    return JSONResponse({"cell": name, "adopted": adopted, "warning": _warning(service, name), "profiles": rows})


@router.get(
    "/profiles/{id}",
    summary="Read a profile",
    responses=json_answer(200, ProfileAnswer, "With its evidence and covariance.", "not-found"),
)
def read_profile(id: ProfileId, service: ServiceDep, caller: AnyCaller) -> JSONResponse:
    """Reads one profile with its evidence and its posterior."""
    row = _find(service, id)
    return JSONResponse(_whole(row, _adopted_id(service, row.cell)))


@router.get("/profiles/{id}/picture.svg", include_in_schema=False)
def draw_profile(id: ProfileId, service: ServiceDep, caller: AnyCaller) -> Response:
    """Draws the throws behind a profile: off where they were to land, and off where the profile expects them."""
    landings = orjson.loads(_find(service, id).document).get("landings") or []
    return Response(explained_svg(landings), media_type="image/svg+xml")


@router.post(
    "/profiles/{id}/adopt",
    summary="Adopt a profile",
    responses={
        **json_answer(200, Adoption, "Plans use it from now on.", "not-found", *ACTING),
        **problem_answers("profile-not-adoptable", "robot-busy"),
    },
)
def adopt_profile(id: ProfileId, service: ServiceDep, caller: OperateCaller, origin: Origin) -> JSONResponse:
    """Uses a profile from now on; plans made before it cannot be executed any more. Limits and checks stay the same."""
    row = _find(service, id)
    cell = service.cell(row.cell)
    if id == "latest" and cell.link.kind != "sim":
        raise ProblemDetails("forbidden", "on a real arm a profile is adopted by its own id, not by 'latest'")
    if cell.sha256 != row.cell_sha256:
        raise ProblemDetails("profile-not-adoptable", f"cell {row.cell!r}: {OUTDATED}", cell=row.cell)
    return _use(service, row.cell, row.id, caller, origin)


@router.post(
    "/cells/{name}/profiles/revert",
    summary="Use the cell file's numbers",
    responses={
        **json_answer(200, Adoption, "The cell file's numbers are used again.", "not-found", "invalid-request"),
        **problem_answers("robot-busy", *ACTING),
    },
)
def revert_profile(name: CellName, service: ServiceDep, caller: OperateCaller, origin: Origin) -> JSONResponse:
    """Uses the cell file's own numbers again."""
    service.cell(name)
    return _use(service, name, None, caller, origin)


def _use(service: Service, cell: str, profile_id: str | None, caller: Caller, origin: RequestOrigin) -> JSONResponse:
    if service.store.open_execution(cell) is not None:
        raise ProblemDetails("robot-busy", f"cell {cell!r} is executing: adopt once it has finished", cell=cell)
    act = origin.act(caller, "revert" if profile_id is None else "adopt")
    service.store.adopt_profile(cell, profile_id, caller.name, act)
    return JSONResponse({"cell": cell, "profile": profile_id, "adopted_by": caller.name})


def _find(service: Service, id: str) -> ProfileRow:
    row = service.store.latest_profile() if id == "latest" else service.store.profile(id)
    if row is None:
        raise ProblemDetails("not-found", f"no profile {id!r}")
    return row


def _adopted_id(service: Service, cell: str) -> str | None:
    row = service.store.profile_in_use(cell, service.cell(cell).sha256)
    return None if row is None else row.id


def _warning(service: Service, cell: str) -> str | None:
    """Returns what a person should know of an adopted profile that is not used; None where there is none."""
    adopted = service.store.adopted_profile(cell)
    if adopted is None or adopted.cell_sha256 == service.cell(cell).sha256:
        return None
    return f"profile {adopted.id} is not used: {OUTDATED}"


def _whole(row: ProfileRow, adopted_id: str | None) -> dict[str, Any]:
    """Returns the JSON of a profile of a cell that uses `adopted_id`."""
    head = {"id": row.id, "created_at": iso_time(row.created_at), "created_by": row.created_by, "sha256": row.sha256}
    head["cell_version"] = row.cell_version
    return {**head, "adopted": adopted_id == row.id, **orjson.loads(row.document)}
