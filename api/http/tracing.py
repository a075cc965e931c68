"""A span for each request (OpenTelemetry's semantic conventions for HTTP servers), within the client's trace."""

from __future__ import annotations

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from fling import tracing


class TracingMiddleware:
    """ASGI middleware around everything else; it does nothing where there are no traces."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Passes a request on within its span."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        method = scope["method"]
        status = 0

        async def noting(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        about = {"http__request__method": method, "url__path": scope["path"]}
        with tracing.traced(method, "server", Headers(scope=scope), **about) as span:
            await self.app(scope, receive, noting)
            state = scope.get("state", {})
            route = getattr(scope.get("route"), "path", None)
            if route is not None:
                span.rename(f"{method} {route}")
            span.set(http__route=route, http__response__status_code=status, fling__request_id=state.get("request_id"))
            if status >= 500:
                span.fail(str(status))
