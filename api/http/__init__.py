"""HTTP in general, whatever the resource: errors, middleware, tokens, content negotiation, OpenAPI."""

from api.http.errors import PROBLEM_TYPES, ProblemDetails, ProblemType, invalid_field, translate
from api.http.middleware import SecurityMiddleware
from api.http.negotiation import preferred_media_type
from api.http.openapi import json_answer, openapi_schema, problem_answers
from api.http.problem_json import field_errors, install_error_handlers, problem_document
from api.http.tokens import Caller, StoredToken, create_token, find_caller, read_tokens

__all__ = [
    "PROBLEM_TYPES",
    "Caller",
    "ProblemDetails",
    "ProblemType",
    "SecurityMiddleware",
    "StoredToken",
    "create_token",
    "field_errors",
    "find_caller",
    "install_error_handlers",
    "invalid_field",
    "json_answer",
    "openapi_schema",
    "preferred_media_type",
    "problem_answers",
    "problem_document",
    "read_tokens",
    "translate",
]
