"""HTTP in general, whatever the resource: errors, middleware, tokens, content negotiation, OpenAPI."""

from api.http.draining import DrainingMiddleware
from api.http.errors import (
    PROBLEM_TYPES,
    ProblemDetails,
    install_error_handlers,
    invalid_field,
    invalid_request,
    problem_document,
    problem_status,
    translate,
)
from api.http.middleware import SecurityMiddleware
from api.http.negotiation import preferred_media_type
from api.http.openapi import json_answer, openapi_schema, problem_answers
from api.http.request_log import RequestLogMiddleware, RequestRecord, client_address
from api.http.tokens import Caller, StoredToken, create_token, find_caller, read_tokens

__all__ = [
    "PROBLEM_TYPES",
    "Caller",
    "DrainingMiddleware",
    "ProblemDetails",
    "RequestLogMiddleware",
    "RequestRecord",
    "SecurityMiddleware",
    "StoredToken",
    "client_address",
    "create_token",
    "find_caller",
    "install_error_handlers",
    "invalid_field",
    "invalid_request",
    "json_answer",
    "openapi_schema",
    "preferred_media_type",
    "problem_answers",
    "problem_document",
    "problem_status",
    "read_tokens",
    "translate",
]
