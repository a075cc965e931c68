"""Errors as `application/problem+json`, whoever made them."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from starlette.exceptions import HTTPException

from api.errors import PROBLEMS, TRANSLATIONS, Problem, from_status, translate
from api.settings import BODY_LIMIT_BYTES

MEDIA_TYPE = "application/problem+json"
DETAILS = {
    404: "nothing is at this address",
    405: "not with this method",
    413: f"the body is larger than {BODY_LIMIT_BYTES} bytes",
}
TAGS = {"float", "int", "pose", "point", "joint", "target", "body"}  # branches of unions in pydantic's paths


def document(problem: Problem, instance: str) -> dict[str, Any]:
    """Returns the problem as RFC 9457 has it."""
    kind = PROBLEMS[problem.name]
    head = {"type": f"/problems/{problem.name}", "title": kind.title, "status": kind.status, "detail": problem.detail}
    return {**head, "instance": instance, **_finite(problem.fields)}


def response(problem: Problem, instance: str) -> Response:
    """Returns the response that carries the problem. ASCII only: any text a client sent survives it."""
    body = json.dumps(document(problem, instance), allow_nan=False).encode()
    headers = {**problem.headers, "Cache-Control": "no-store"}
    return Response(body, PROBLEMS[problem.name].status, headers, media_type=MEDIA_TYPE)


def install(app: FastAPI) -> None:
    """Makes every error of `app` a problem."""
    app.add_exception_handler(Problem, _on_problem)
    app.add_exception_handler(RequestValidationError, _on_invalid)
    app.add_exception_handler(HTTPException, _on_http)
    app.add_exception_handler(Exception, _on_bug)
    for kind in TRANSLATIONS:
        app.add_exception_handler(kind, _on_translated)


def field_errors(errors: Sequence[Any]) -> list[dict[str, str]]:
    """Returns pydantic's findings as `{field, reason}`, one a field."""
    found: dict[str, str] = {}
    for error in errors:
        found.setdefault(_path(error["loc"]), str(error["msg"]))
    return [{"field": field, "reason": reason} for field, reason in found.items()]


def _path(location: Sequence[str | int]) -> str:
    """Returns ("body", "release", "joint", "positions", 3) as "release.positions[3]"."""
    path = ""
    for i, part in enumerate(location):
        if isinstance(part, int):
            path += f"[{part}]"
        elif not (part in TAGS and _is_tag(location, i)) and "[" not in part:
            path += f".{part}" if path else part
    return path or "body"


def _is_tag(location: Sequence[str | int], i: int) -> bool:
    part = location[i]
    if part == "body":
        return i == 0
    return part in ("float", "int") or (i > 0 and location[i - 1] == "release")


def _finite(value: Any) -> Any:
    """Returns `value` with null in place of what JSON cannot say."""
    if isinstance(value, dict):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


async def _on_problem(request: Request, error: Exception) -> Response:
    assert isinstance(error, Problem)
    return response(error, request.url.path)


async def _on_translated(request: Request, error: Exception) -> Response:
    return response(translate(error), request.url.path)


async def _on_invalid(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    errors = field_errors(error.errors())
    detail = "; ".join(f"{e['field']}: {e['reason']}" for e in errors)
    return response(Problem("invalid-request", detail, errors=errors), request.url.path)


async def _on_http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    detail = DETAILS.get(error.status_code, str(error.detail))
    return response(from_status(error.status_code, detail, error.headers), request.url.path)


async def _on_bug(request: Request, _error: Exception) -> Response:
    return response(Problem("internal", "something went wrong inside Fling; its log says what"), request.url.path)
