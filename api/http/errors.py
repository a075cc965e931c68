"""Every error of the service as `application/problem+json`: the translation of exceptions to problems."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Sequence
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import Match

from api.cell_repository import UnknownCell
from api.field_errors import reason, refused_fields
from api.planning import ClientGone, PlanningEnded, PlanningQueueFull
from api.problems import (
    PLANNER_PROBLEMS,
    ProblemDetails,
    internal,
    invalid_field,
    invalid_fields,
    problem_document,
    problem_status,
    retry_after,
)
from jobs.pool import PlannerBug, PoolBroken
from store import CellBusy, KeyTaken, StoreUnavailable, UnknownRow

MEDIA_TYPE = "application/problem+json"
BODY_LIMIT_BYTES = 1_000_000  # [byte] far above the few hundred bytes of a request
SOON_S = 1  # [s] to wait for what usually takes less: a busy database, a planner that starts
RESTART_S = 5  # [s] to wait for a service that ends: another one answers at once, this one after its restart
UNFINISHED = 499  # status of a request whose client was gone before the answer began; source: nginx
METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE")
BODY_TOO_LARGE = f"the body is larger than {BODY_LIMIT_BYTES} bytes"

log = logging.getLogger("fling")


def invalid_request(errors: Sequence[Any], model: type[BaseModel] | None = None) -> ProblemDetails:
    """Returns the problem of a request that pydantic refused with these errors; `model` is that of its body."""
    return invalid_fields(refused_fields(errors, model))


def translate(error: Exception) -> ProblemDetails:
    """Returns the problem for any exception of planner, planner pool, store or framework; "internal" for a bug."""
    kind = next(kind for kind in type(error).__mro__ if kind in TRANSLATIONS)
    return TRANSLATIONS[kind](error)


def _invalid(error: RequestValidationError) -> ProblemDetails:
    """Returns the problem of a refused request: nothing is at an address with an id of the wrong form."""
    errors = error.errors()
    wrong = next((found for found in errors if found["loc"][0] == "path"), None)
    if wrong is not None:
        return ProblemDetails("not-found", f"{wrong['loc'][1]}: {reason(wrong)}")
    return invalid_request(errors, getattr(error, "model", None))


def _from_framework(error: HTTPException) -> ProblemDetails:
    if error.status_code == 400:  # a body that is not JSON
        return invalid_field("body", str(error.detail))
    name, detail = FRAMEWORK_ERRORS.get(error.status_code, ("internal", str(error.detail)))
    return ProblemDetails(name, detail, headers=error.headers)


FRAMEWORK_ERRORS = {
    404: ("not-found", "there is nothing at this address"),
    408: ("request-timeout", "the body did not arrive in time"),
    405: ("method-not-allowed", "the method is not allowed here"),
    413: ("too-large", BODY_TOO_LARGE),
}
TRANSLATIONS: dict[type[Exception], Callable[[Any], ProblemDetails]] = {
    ProblemDetails: lambda e: e,
    **PLANNER_PROBLEMS,
    PlanningQueueFull: lambda e: ProblemDetails("overloaded", str(e), headers=retry_after(e.retry_after_s)),
    PlanningEnded: lambda e: ProblemDetails("shutting-down", str(e), headers=retry_after(RESTART_S)),
    PlannerBug: lambda _: internal(),
    PoolBroken: lambda e: ProblemDetails("not-ready", str(e), headers=retry_after(RESTART_S)),
    StoreUnavailable: lambda e: ProblemDetails("not-ready", e.advice, headers=retry_after(SOON_S), outage=e.kind),
    CellBusy: lambda e: ProblemDetails("robot-busy", str(e), cell=e.cell),
    KeyTaken: lambda _: ProblemDetails("idempotency-conflict", "this Idempotency-Key was used with another body"),
    UnknownCell: lambda e: ProblemDetails("not-found", str(e)),
    UnknownRow: lambda e: ProblemDetails("not-found", str(e)),
    RequestValidationError: lambda e: _invalid(e),
    HTTPException: _from_framework,
    Exception: lambda _: internal(),
}


def problem_response(problem: ProblemDetails, instance: str) -> Response:
    """Returns the response of a problem. ASCII only, so that any text of the client can be quoted."""
    body = json.dumps(problem_document(problem, instance), allow_nan=False).encode()
    headers = {**problem.headers, "Cache-Control": "no-store"}
    return Response(body, problem_status(problem), headers, media_type=MEDIA_TYPE)


def install_error_handlers(app: FastAPI) -> None:
    """Makes `app` answer every error with a problem document."""
    for kind in (ClientGone, ClientDisconnect, *TRANSLATIONS):
        app.add_exception_handler(kind, _on_error)


async def _on_error(request: Request, error: Exception) -> Response:
    if isinstance(error, ClientGone | ClientDisconnect):
        return Response(status_code=UNFINISHED)
    request.state.problem = problem = translate(error)  # for the log and the audit trail
    if problem.name == "internal":
        log.error("a bug: %r", error, extra={"fields": _place(request)})  # its traceback follows from the server
    if problem.name == "method-not-allowed":
        problem.headers["Allow"] = ", ".join(_allowed_methods(request))
    return problem_response(problem, request.url.path)


def _place(request: Request) -> dict[str, str | None]:
    return {"path": request.url.path, "request_id": getattr(request.state, "request_id", None)}


def _allowed_methods(request: Request) -> list[str]:
    """Returns the methods of every route at the address of a request; the framework names those of the first alone."""
    routes = request.app.router.routes
    found = []
    for method in METHODS:
        scope = {**request.scope, "method": "GET" if method == "HEAD" else method}  # HEAD is answered by GET
        if any(route.matches(scope)[0] is Match.FULL for route in routes):
            found.append(method)
    return found
