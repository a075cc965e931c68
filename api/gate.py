"""The gate in front of every call: where a request may come from and what a body must be.

Pure ASGI, because a refusal here must reach clients that the framework never sees. Three rules: without tokens the
`Host` must be this machine (DNS rebinding); a browser's `Origin` must be the service itself (cross-site posts); a body
must be JSON. Every answer carries headers that keep a browser from doing more than the page asks for.
"""

from __future__ import annotations

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api import problems
from api.errors import Problem
from api.settings import BODY_LIMIT_BYTES, is_loopback_host

SECURITY_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}


class Gate:
    """ASGI middleware; `local_only` where the service runs without tokens."""

    def __init__(self, app: ASGIApp, local_only: bool) -> None:
        self.app = app
        self.local_only = local_only

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuses or passes on one request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        problem = self._refusal(scope["method"], headers)
        if problem is not None:
            await problems.response(problem, scope["path"])(scope, receive, _guarded(send))
        else:
            await self.app(scope, _limited(receive), _guarded(send))

    def _refusal(self, method: str, headers: Headers) -> Problem | None:
        host = _host_name(headers.get("host", ""))
        if self.local_only and not is_loopback_host(host):
            return Problem("forbidden", "without tokens the service answers to loopback addresses alone")
        origin = headers.get("origin")
        if origin and method not in ("GET", "HEAD") and origin.split("://")[-1] != headers.get("host"):
            return Problem("forbidden", f"requests from pages of {origin!a} are not accepted")
        length = headers.get("content-length", "0")
        if length.isdecimal() and int(length) > BODY_LIMIT_BYTES:
            return _too_large()
        if method in ("POST", "PUT", "PATCH") and _has_body(headers) and not _is_json(headers.get("content-type", "")):
            return Problem("unsupported-media-type", "the body must be application/json")
        return None


def _too_large() -> Problem:
    return Problem("too-large", f"the body is larger than {BODY_LIMIT_BYTES} bytes", limit_bytes=BODY_LIMIT_BYTES)


def _limited(receive: Receive) -> Receive:
    """Returns `receive` that refuses a body which grows beyond the limit without having said so."""
    received = 0

    async def limited() -> Message:
        nonlocal received
        message = await receive()
        received += len(message.get("body", b""))
        if received > BODY_LIMIT_BYTES:
            raise HTTPException(413)
        return message

    return limited


def _host_name(host: str) -> str:
    return host[: host.index("]") + 1] if host.startswith("[") and "]" in host else host.split(":")[0]


def _has_body(headers: Headers) -> bool:
    return headers.get("content-length", "0") != "0" or "transfer-encoding" in headers


def _is_json(content_type: str) -> bool:
    media = content_type.split(";")[0].strip().lower()
    return media == "application/json" or (media.startswith("application/") and media.endswith("+json"))


def _guarded(send: Send) -> Send:
    async def guarded(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in SECURITY_HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return guarded
