"""Answers as the OpenAPI page lists them."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from api.errors import PROBLEMS
from api.schemas.executions import ProblemAnswer

Responses = dict[int | str, dict[str, Any]]


def json_answer(status: int, model: type[BaseModel], description: str) -> Responses:
    """Returns the entry of a success."""
    return {status: {"model": model, "description": description}}


def problems_of(*names: str) -> Responses:
    """Returns the entries of these problem types, one a status."""
    entries: Responses = {}
    for status in sorted({PROBLEMS[name].status for name in names}):
        listed = ", ".join(f"`{name}`" for name in names if PROBLEMS[name].status == status)
        content = {"application/problem+json": {"schema": {"$ref": f"#/components/schemas/{ProblemAnswer.__name__}"}}}
        entries[status] = {"description": listed, "content": content}
    return entries
