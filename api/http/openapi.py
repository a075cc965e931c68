"""The OpenAPI document, and the entries of its operations for successes and problems."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic import BaseModel, Field

from api.http.errors import PROBLEM_TYPES
from api.schemas import AnswerModel

Responses = dict[int | str, dict[str, Any]]
REF_TEMPLATE = "#/components/schemas/{model}"


class FieldReason(AnswerModel):
    """One refused field."""

    field: str
    reason: str


class ProblemAnswer(AnswerModel):
    """An error (RFC 9457)."""

    type: str = Field(description="/problems/<name>, a page that explains it.")
    title: str
    status: int
    detail: str
    instance: str
    errors: list[FieldReason] | None = Field(None, description="invalid-request: every refused field.")
    violations: list[dict[str, Any]] | None = Field(None, description="infeasible: constraint, value, limit, unit.")
    nearest: dict[str, Any] | None = Field(None, description="infeasible: the closest feasible request.")


def json_answer(status: int, model: type[BaseModel], description: str) -> Responses:
    """Returns the OpenAPI entry of a successful JSON response."""
    return {status: {"model": model, "description": description}}


def problem_answers(*names: str) -> Responses:
    """Returns the OpenAPI entries of these problem types, one per status."""
    entries: Responses = {}
    for status in sorted({PROBLEM_TYPES[name].status for name in names}):
        listed = ", ".join(f"`{name}`" for name in names if PROBLEM_TYPES[name].status == status)
        schema = {"$ref": REF_TEMPLATE.format(model=ProblemAnswer.__name__)}
        entries[status] = {"description": listed, "content": {"application/problem+json": {"schema": schema}}}
    return entries


def openapi_schema(app: FastAPI) -> dict[str, Any]:
    """Returns the OpenAPI document of the service, generated once."""
    if app.openapi_schema is None:
        schema = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
        answer = ProblemAnswer.model_json_schema(ref_template=REF_TEMPLATE)
        schema["components"]["schemas"] |= {**answer.pop("$defs", {}), ProblemAnswer.__name__: answer}
        app.openapi_schema = schema
    return app.openapi_schema
