"""Every error as `application/problem+json`, including those that the framework raises."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from starlette.exceptions import HTTPException

from api.http.errors import PROBLEM_TYPES, TRANSLATIONS, ProblemDetails, from_status, translate

MEDIA_TYPE = "application/problem+json"
BODY_LIMIT_BYTES = 1_000_000  # [byte] a request has a few hundred; source: the contract's 1 MB
BODY_TOO_LARGE = f"the body is larger than {BODY_LIMIT_BYTES} bytes"
DETAILS = {404: "there is nothing at this address", 405: "the method is not allowed here", 413: BODY_TOO_LARGE}
UNION_TAGS = {"float", "int", "pose", "point", "joint", "target", "body"}  # of unions, in pydantic's error locations


def problem_document(problem: ProblemDetails, instance: str) -> dict[str, Any]:
    """Returns the JSON document of a problem (RFC 9457).

    Args:
        problem: The error.
        instance: Path of the request.
    """
    kind = PROBLEM_TYPES[problem.name]
    head = {"type": f"/problems/{problem.name}", "title": kind.title, "status": kind.status, "detail": problem.detail}
    return {**head, "instance": instance, **_finite(problem.fields)}


def problem_response(problem: ProblemDetails, instance: str) -> Response:
    """Returns the response of a problem. ASCII only, so that any text of the client can be quoted."""
    body = json.dumps(problem_document(problem, instance), allow_nan=False).encode()
    headers = {**problem.headers, "Cache-Control": "no-store"}
    return Response(body, PROBLEM_TYPES[problem.name].status, headers, media_type=MEDIA_TYPE)


def install_error_handlers(app: FastAPI) -> None:
    """Makes `app` answer every error with a problem document."""
    app.add_exception_handler(ProblemDetails, _on_problem)
    app.add_exception_handler(RequestValidationError, _on_validation_error)
    app.add_exception_handler(HTTPException, _on_http_exception)
    app.add_exception_handler(Exception, _on_bug)
    for kind in TRANSLATIONS:
        app.add_exception_handler(kind, _on_translated)


def field_errors(errors: Sequence[Any]) -> list[dict[str, str]]:
    """Returns pydantic's errors as `{field, reason}`, one per field."""
    found: dict[str, str] = {}
    for error in errors:
        found.setdefault(_field_path(error["loc"]), str(error["msg"]))
    return [{"field": field, "reason": reason} for field, reason in found.items()]


def _field_path(location: Sequence[str | int]) -> str:
    """Returns ("body", "release", "joint", "positions", 3) as "release.positions[3]"."""
    path = ""
    for i, part in enumerate(location):
        if isinstance(part, int):
            path += f"[{part}]"
        elif not (part in UNION_TAGS and _is_tag(location, i)) and "[" not in part:
            path += f".{part}" if path else part
    return path or "body"


def _is_tag(location: Sequence[str | int], i: int) -> bool:
    part = location[i]
    if part == "body":
        return i == 0
    return part in ("float", "int") or (i > 0 and location[i - 1] == "release")


def _finite(value: Any) -> Any:
    """Returns `value` with null in place of NaN and infinity."""
    if isinstance(value, dict):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


async def _on_problem(request: Request, error: Exception) -> Response:
    assert isinstance(error, ProblemDetails)
    return problem_response(error, request.url.path)


async def _on_translated(request: Request, error: Exception) -> Response:
    return problem_response(translate(error), request.url.path)


async def _on_validation_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    errors = field_errors(error.errors())
    detail = "; ".join(f"{e['field']}: {e['reason']}" for e in errors)
    return problem_response(ProblemDetails("invalid-request", detail, errors=errors), request.url.path)


async def _on_http_exception(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    detail = DETAILS.get(error.status_code, str(error.detail))
    return problem_response(from_status(error.status_code, detail, error.headers), request.url.path)


async def _on_bug(request: Request, _error: Exception) -> Response:
    detail = "an internal error; the service's log has the details"
    return problem_response(ProblemDetails("internal", detail), request.url.path)
