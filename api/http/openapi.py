"""The OpenAPI document, and the entries of its operations for successes and problems."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from fastapi.routing import APIRoute
from pydantic import BaseModel, Field
from pydantic.json_schema import models_json_schema

from api.http.errors import MEDIA_TYPE
from api.problems import PROBLEM_TYPES
from api.schemas import PlanProgress, StateEvent, TargetEvent, TelemetryEvent

Responses = dict[int | str, dict[str, Any]]
REF_TEMPLATE = "#/components/schemas/{model}"
NAMES = "x-problems"  # names of the problem types in an operation's response
FRAMEWORK_SCHEMAS = ("HTTPValidationError", "ValidationError")  # FastAPI's own refusals, which are never answered


class FieldReason(BaseModel):
    """One refused field."""

    field: str
    reason: str


class ViolationAnswer(BaseModel):
    """A constraint that stands in the way, and by how much."""

    constraint: str = Field(description="Name of the certificate's check.")
    value: float | None = Field(
        description="Of the best motion, in `unit`; null if infinite, and with `limit` where nothing was found."
    )
    limit: float | None = Field(description="In `unit`.")
    unit: str
    at_s: float | None = Field(None, description="Time on the trajectory [s].")
    detail: str = Field("", description="Joint, pair of links or shape concerned.")
    proven: bool = Field(False, description="Whether no motion can avoid it; otherwise none was found.")


class SolverEnd(BaseModel):
    """How a search ended."""

    status: str = Field(description="`time_limit`, or the solver's own word.")
    iterations: int | None = None


class ProblemAnswer(BaseModel):
    """An error (RFC 9457). Its type says which of the further fields it has."""

    type: str = Field(description="/problems/<name>, a page that explains it.")
    title: str
    status: int
    detail: str
    instance: str
    errors: list[FieldReason] | None = Field(None, description="invalid-request: the first refused fields, 20 at most.")
    violations: list[ViolationAnswer] | None = Field(None, description="infeasible, solver-failed.")
    nearest: dict[str, Any] | None = Field(None, description="A feasible request near it, ready to be posted.")
    attempts: list[dict[str, Any]] | None = Field(None, description="infeasible, solver-failed: what was tried.")
    solver: SolverEnd | None = Field(None, description="solver-failed.")
    cell: str | None = Field(None, description="The cell concerned.")
    offers: list[str] | None = Field(None, description="not-acceptable: the media types that there are.")


OF_BODIES = {"invalid-request", "too-large", "unsupported-media-type", "request-timeout", "shutting-down"}
LINKS = {  # operation: the operations that take the id of what it made
    "make_plan": ("read_plan", "read_trajectory", "read_plan_curves"),
    "execute_plan": (
        "read_execution", "watch_execution", "read_recording", "abort_execution", "report_landing", "read_landings",
    ),
    "begin_experiment": ("read_experiment",),
    "make_batch": ("read_batch", "watch_batch", "read_batch_results", "cancel_batch"),
    "estimate_profile_of_cell": ("read_profile", "adopt_profile"),
}  # fmt: skip
MADE = "$response.body#/id"
KEY = "idempotency-key"  # a header: the same with another body is refused
UNROUTED = (
    ProblemAnswer,
    PlanProgress,
    StateEvent,
    TargetEvent,
    TelemetryEvent,
)  # models of media types that FastAPI does not know


def operation_id(route: APIRoute) -> str:
    """Returns the id of a route's operation: its function's name, which generated clients give to the call."""
    return route.name


def json_answer(status: int, model: type[BaseModel], description: str, *problems: str) -> Responses:
    """Returns the OpenAPI entries of a successful JSON response and of these problem types."""
    return {status: {"model": model, "description": description}, **problem_answers(*problems)}


def problem_answers(*names: str) -> Responses:
    """Returns the OpenAPI entries of these problem types, one per status."""
    entries: Responses = {}
    schema = {"$ref": REF_TEMPLATE.format(model=ProblemAnswer.__name__)}
    for status in sorted({PROBLEM_TYPES[name].status for name in names}):
        listed = [name for name, kind in PROBLEM_TYPES.items() if name in names and kind.status == status]
        description = ", ".join(f"`{name}`" for name in listed)
        entries[status] = {"description": description, NAMES: listed, "content": {MEDIA_TYPE: {"schema": schema}}}
    return entries


def openapi_schema(app: FastAPI, secured: bool) -> dict[str, Any]:
    """Returns the OpenAPI document of the service, generated once.

    Args:
        app: the service.
        secured: whether it asks for tokens.
    """
    if app.openapi_schema is None:
        schema = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
        _, added = models_json_schema([(model, "serialization") for model in UNROUTED], ref_template=REF_TEMPLATE)
        schemas = {**schema["components"]["schemas"], **added["$defs"]}
        schema["components"]["schemas"] = {k: v for k, v in schemas.items() if k not in FRAMEWORK_SCHEMAS}
        for operation in _operations(schema):
            _complete(operation, secured)
        if not secured:
            del schema["components"]["securitySchemes"]
        app.openapi_schema = schema
    return app.openapi_schema


def _operations(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for methods in schema["paths"].values():
        yield from methods.values()


def _complete(operation: dict[str, Any], secured: bool) -> None:
    """Adds the problems that follow from what an operation takes, and its security as it is configured."""
    guarded = "security" in operation  # such an operation reads the store
    if guarded and not secured:
        del operation["security"]
    named = {name for answer in operation["responses"].values() for name in answer.get(NAMES, ())}
    names = named | {"forbidden", "internal"}  # another host's page; a bug
    names |= {"not-ready"} if guarded else set()
    names = names | {"unauthenticated"} if guarded and secured else names - {"unauthenticated"}
    parameters = operation.get("parameters", ())
    names |= {"not-found"} if any(parameter["in"] == "path" for parameter in parameters) else set()
    names |= {"idempotency-conflict"} if any(parameter["name"] == KEY for parameter in parameters) else set()
    names |= {"invalid-request"}  # a query parameter that there is not
    names |= OF_BODIES if "requestBody" in operation else set()
    successes = {code: answer for code, answer in operation["responses"].items() if code < "400"}
    for code in successes.keys() & {"201", "202"}:
        if links := _links(operation["operationId"]):
            successes[code]["links"] = links
    problems = {str(status): answer for status, answer in problem_answers(*names).items()}
    operation["responses"] = {**successes, **problems}


def _links(operation: str) -> dict[str, Any]:
    """Returns what can be done with what an operation made (OpenAPI 3.1, Link Object)."""
    links: dict[str, Any] = {
        name: {"operationId": name, "parameters": {"id": MADE}} for name in LINKS.get(operation, ())
    }
    if operation == "make_plan":
        links["execute_plan"] = {"operationId": "execute_plan", "requestBody": {"plan_id": MADE}}
    return links
