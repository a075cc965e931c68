"""What is known of each request: its id, and one record at its end for the log, the metrics and the audit trail.

`X-Request-ID` is taken over from the client, or made, and echoed; it is kept with what the request made.
"""

from __future__ import annotations

import re
import time
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.http.errors import UNFINISHED
from store import AuditLine, new_id

ID_HEADER = "X-Request-ID"
ID_PATTERN = re.compile(r"[A-Za-z0-9._:+/=-]{1,128}")  # others are not echoed: they end up in logs
NOT_ALLOWED = 405  # the path has no such method: nobody asked for its act
ACTIONS = {  # what is audited, by route; acts that succeed are audited by the store, with the act
    "/execute": "execute",
    "/executions/{id}/abort": "abort",
    "/executions/{id}/replace": "replace",
    "/executions/{id}/landing": "landing",
    "/executions/{id}/landing/{landing}/withdraw": "withdraw",
    "/cells/{name}/acknowledge": "acknowledge",
    "/cells/{name}/robot": "robot",
    "/cells/{name}/retarget": "replace",
    "/cells/{name}/targets": "target",
    "/cells/{name}/targets/{id}": "forget-target",
    "/cells/{name}/profiles": "profile",
    "/cells/{name}/profiles/revert": "revert",
    "/profiles/{id}/adopt": "adopt",
    "/experiments": "experiment",
    "/batches": "batch",
    "/batches/{id}/cancel": "cancel-batch",
    "/jobs": "job",
    "/jobs/{id}/pause": "pause-job",
    "/jobs/{id}/resume": "resume-job",
    "/jobs/{id}/cancel": "cancel-job",
}


@dataclass(frozen=True)
class RequestRecord:
    """One answered request.

    Attributes:
        id: Its `X-Request-ID`.
        client: Address of the client.
        token: Name of the token; "local" without tokens; None where none was checked, or it was wrong.
        method, path: As requested.
        route: Path of the route with its parameters; None where there is none.
        status: Of the answer.
        duration_s: From the headers to the end of the answer [s].
        problem: Type of the problem; None for a success.
        detail: Of the problem.
    """

    id: str
    client: str
    token: str | None
    method: str
    path: str
    route: str | None
    status: int
    duration_s: float
    problem: str | None
    detail: str | None

    def log_fields(self) -> dict[str, Any]:
        """Returns the members of its line in the log."""
        fields = {**vars(self), "ms": round(1e3 * self.duration_s, 1)}
        return {name: value for name, value in fields.items() if name not in ("duration_s", "detail")}

    def refused_act(self) -> AuditLine | None:
        """Returns the line of the audit trail for an act that was refused or failed; None for everything else."""
        action = ACTIONS.get(self.route or "")
        if self.method not in ("POST", "DELETE") or action is None or self.status < 400 or self.status == NOT_ALLOWED:
            return None
        outcome = self.problem or str(self.status)
        return AuditLine(self.token or "unknown", action, self.client, self.id, self.path, outcome, self.detail)


class RequestLogMiddleware:
    """ASGI middleware around everything else.

    Args:
        app: The application behind it.
        record: Receives every request at its end.
    """

    def __init__(self, app: ASGIApp, record: Callable[[RequestRecord], Awaitable[None]]) -> None:
        self.app = app
        self.record = record

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Gives a request its id, passes it on, and records it."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        state = scope.setdefault("state", {})
        state["request_id"] = id = _request_id(scope)
        status = UNFINISHED
        began_at = time.perf_counter()

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message)[ID_HEADER] = id
            await send(message)

        try:
            await self.app(scope, receive, send_with_id)
        finally:
            await self.record(_record(scope, state, status, time.perf_counter() - began_at))


def client_address(scope: MutableMapping[str, Any]) -> str:
    """Returns the address of the client."""
    client = scope.get("client")
    return client[0] if client else "unknown"


def _request_id(scope: Scope) -> str:
    given = Headers(scope=scope).get(ID_HEADER, "")
    return given if ID_PATTERN.fullmatch(given) else new_id()


def _record(scope: Scope, state: MutableMapping[str, Any], status: int, duration_s: float) -> RequestRecord:
    route = getattr(scope.get("route"), "path", None)
    problem = state.get("problem")
    name, detail = (problem.name, problem.detail) if problem is not None else (None, None)
    client = client_address(scope)
    token = state.get("caller")
    place = (scope["method"], scope["path"], route)
    return RequestRecord(state["request_id"], client, token, *place, status, duration_s, name, detail)
