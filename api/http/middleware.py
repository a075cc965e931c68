"""Security middleware in front of every request: allowed hosts and origins; size, time and media type of bodies.

Pure ASGI, so that it also covers requests that never reach the framework's routing. Without tokens the `Host` must be
this machine (against DNS rebinding); a browser's `Origin` must be the service itself (against cross-site posts); a body
must be JSON. Every response carries headers that restrict what a browser may do with it.
"""

from __future__ import annotations

import asyncio
import math
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.http.errors import BODY_LIMIT_BYTES, BODY_TOO_LARGE, problem_response
from api.problems import ProblemDetails
from fling import this_machine

BODY_S = 10.0  # [s] for a body of at most a megabyte, usually some hundred bytes
PORTS = {"http": 80, "https": 443}  # of an origin that names none
SECURITY_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}


class SecurityMiddleware:
    """ASGI middleware.

    Args:
        app: The application behind it.
        local_only: Whether only loopback hosts are served: the service runs without tokens.
    """

    def __init__(self, app: ASGIApp, local_only: bool) -> None:
        self.app = app
        self.local_only = local_only

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Rejects a request or passes it on."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        problem = self._rejection(scope["method"], headers)
        if problem is not None:
            scope.setdefault("state", {})["problem"] = problem
            await problem_response(problem, scope["path"])(scope, receive, _with_security_headers(send))
        else:
            await self.app(scope, _limited(receive), _with_security_headers(send))

    def _rejection(self, method: str, headers: Headers) -> ProblemDetails | None:
        host = _host_name(headers.get("host", ""))
        if self.local_only and not this_machine.is_loopback_host(host):
            return ProblemDetails("forbidden", "without tokens the service answers on loopback addresses only")
        origin = headers.get("origin")
        if origin is not None and method not in ("GET", "HEAD") and not _is_own(origin, headers.get("host", "")):
            return ProblemDetails("forbidden", f"requests from pages of {origin!a} are not accepted")
        length = headers.get("content-length", "0")
        if length.isdecimal() and int(length) > BODY_LIMIT_BYTES:
            return ProblemDetails("too-large", BODY_TOO_LARGE, limit_bytes=BODY_LIMIT_BYTES)
        if method in ("POST", "PUT", "PATCH") and _has_body(headers) and not _is_json(headers.get("content-type", "")):
            return ProblemDetails("unsupported-media-type", "the body must be application/json")
        return None


def _limited(receive: Receive) -> Receive:
    """Returns a `receive` that rejects a body that is too large or takes too long."""
    received = 0
    due_at = asyncio.get_running_loop().time() + BODY_S

    async def limited() -> Message:
        nonlocal received, due_at
        try:
            async with asyncio.timeout_at(due_at):
                message = await receive()
        except TimeoutError:
            raise HTTPException(408, headers={"Connection": "close"}) from None
        if not message.get("more_body", False):
            due_at = math.inf  # what follows is the client's disconnect
        received += len(message.get("body", b""))
        if received > BODY_LIMIT_BYTES:
            raise HTTPException(413)
        return message

    return limited


def _host_name(host: str) -> str:
    return host[: host.index("]") + 1] if host.startswith("[") and "]" in host else host.split(":")[0]


def _is_own(origin: str, host: str) -> bool:
    """Returns whether a page of `origin` comes from `host`: the same name and port (RFC 6454, section 7).

    The scheme may differ, as behind a proxy that ends TLS; it gives the port where none is written.
    """
    try:
        page = urlsplit(origin)
        own = urlsplit(f"{page.scheme}://{host}")
        same = (page.hostname, page.port or PORTS[page.scheme]) == (own.hostname, own.port or PORTS[page.scheme])
    except (ValueError, KeyError):
        return False
    return same and "@" not in page.netloc and origin.lower() == f"{page.scheme}://{page.netloc}".lower()


def _has_body(headers: Headers) -> bool:
    return headers.get("content-length", "0") != "0" or "transfer-encoding" in headers


def _is_json(content_type: str) -> bool:
    media = content_type.split(";")[0].strip().lower()
    return media == "application/json" or (media.startswith("application/") and media.endswith("+json"))


def _with_security_headers(send: Send) -> Send:
    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in SECURITY_HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return send_with_headers
