"""HTTP in general, whatever the resource: errors, middleware, tokens, content negotiation, OpenAPI."""

from api.http.draining import DrainingMiddleware
from api.http.errors import RESTART_S, SOON_S, install_error_handlers, invalid_request, translate
from api.http.event_stream import EVENTS, event_stream, event_stream_answer
from api.http.head import HeadMiddleware
from api.http.json_body import StrictJsonRoute
from api.http.middleware import SecurityMiddleware
from api.http.negotiation import has_current, preferred_media_type, unchanging
from api.http.openapi import ProblemAnswer, json_answer, openapi_schema, operation_id, problem_answers
from api.http.request_log import RequestLogMiddleware, RequestRecord, client_address
from api.http.tokens import (
    Caller,
    TokenRegistry,
    create_token,
    find_token,
    read_tokens,
    revoke_token,
)
from api.http.tracing import TracingMiddleware
from api.http.wrong_tokens import WrongTokens
from api.problems import (
    PROBLEM_TYPES,
    ProblemDetails,
    invalid_field,
    invalid_fields,
    problem_document,
    problem_status,
    retry_after,
)

__all__ = [
    "EVENTS",
    "PROBLEM_TYPES",
    "RESTART_S",
    "SOON_S",
    "Caller",
    "DrainingMiddleware",
    "HeadMiddleware",
    "ProblemAnswer",
    "ProblemDetails",
    "RequestLogMiddleware",
    "RequestRecord",
    "SecurityMiddleware",
    "StrictJsonRoute",
    "TokenRegistry",
    "TracingMiddleware",
    "WrongTokens",
    "client_address",
    "create_token",
    "event_stream",
    "event_stream_answer",
    "find_token",
    "has_current",
    "install_error_handlers",
    "invalid_field",
    "invalid_fields",
    "invalid_request",
    "json_answer",
    "openapi_schema",
    "operation_id",
    "preferred_media_type",
    "problem_answers",
    "problem_document",
    "problem_status",
    "read_tokens",
    "retry_after",
    "revoke_token",
    "translate",
    "unchanging",
]
