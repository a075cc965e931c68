"""The OpenAPI document, and the entries of its operations for successes and problems."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic import BaseModel, Field
from pydantic.json_schema import models_json_schema

from api.http.errors import MEDIA_TYPE, PROBLEM_TYPES
from api.schemas import StateEvent, TelemetryEvent

Responses = dict[int | str, dict[str, Any]]
REF_TEMPLATE = "#/components/schemas/{model}"


class FieldReason(BaseModel):
    """One refused field."""

    field: str
    reason: str


class ProblemAnswer(BaseModel):
    """An error (RFC 9457)."""

    type: str = Field(description="/problems/<name>, a page that explains it.")
    title: str
    status: int
    detail: str
    instance: str
    errors: list[FieldReason] | None = Field(None, description="invalid-request: every refused field.")
    violations: list[dict[str, Any]] | None = Field(None, description="constraint, value, limit, unit, proven.")
    nearest: dict[str, Any] | None = Field(None, description="infeasible: the closest feasible request.")


UNROUTED = (ProblemAnswer, StateEvent, TelemetryEvent)  # models of media types that FastAPI does not know


def json_answer(status: int, model: type[BaseModel], description: str, *problems: str) -> Responses:
    """Returns the OpenAPI entries of a successful JSON response and of these problem types."""
    return {status: {"model": model, "description": description}, **problem_answers(*problems)}


def problem_answers(*names: str) -> Responses:
    """Returns the OpenAPI entries of these problem types, one per status."""
    entries: Responses = {}
    schema = {"$ref": REF_TEMPLATE.format(model=ProblemAnswer.__name__)}
    for status in sorted({PROBLEM_TYPES[name].status for name in names}):
        listed = [f"`{name}`" for name, kind in PROBLEM_TYPES.items() if name in names and kind.status == status]
        entries[status] = {"description": ", ".join(listed), "content": {MEDIA_TYPE: {"schema": schema}}}
    return entries


def openapi_schema(app: FastAPI) -> dict[str, Any]:
    """Returns the OpenAPI document of the service, generated once."""
    if app.openapi_schema is None:
        schema = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
        _, added = models_json_schema([(model, "serialization") for model in UNROUTED], ref_template=REF_TEMPLATE)
        schema["components"]["schemas"] |= added["$defs"]
        app.openapi_schema = schema
    return app.openapi_schema
