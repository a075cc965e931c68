"""The HTTP server: uvicorn that drains before it ends and cuts clients that are too slow.

Draining: the first SIGTERM or SIGINT makes the application refuse new work while it goes on answering; the server ends
when what was begun is answered. A second signal ends it at once.
"""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Awaitable, Callable, Sequence
from types import FrameType
from typing import Any, NoReturn

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from api.http import ProblemDetails, problem_document, problem_status

HEADERS_S = 10.0  # [s] from a request's first byte (or the connection) to the end of its headers: a few packets
STALL_S = 10.0  # [s] between two looks at a client that does not read its answer
READ_RATE_MIN_B_S = 1000.0  # [byte/s] slowest accepted reader, slower than any modem
KEEP_ALIVE_S = 75.0  # [s] idle connections are kept longer than any `Retry-After` that was given
HEADERS_BYTES = 65_536  # [byte] of a request's target and headers
HEADER_EXTRA_BYTES = 4  # [byte] a header has besides its name and value: colon, blank, end of the line
PARTS_MAX = 2_000  # chunks, or packets, of one body: a megabyte in the smallest packets that all networks carry
ABSOLUTE_TARGET = re.compile(rb"(?i:https?)://(?P<host>[^/?]+)(?P<path>/[^?]*)?(?P<query>\?.*)?")
ANSWERS_S = 10  # [s] for the answers of what was drained: storing a plan waits up to 5 s for a busy database


class BoundedConnection(h11.Connection):
    """A connection whose requests have bounded headers and a bounded number of parts, and whose targets are paths.

    Attributes:
        broken: which bound was broken, in words; None: none.
    """

    def __init__(self) -> None:
        super().__init__(h11.SERVER, HEADERS_BYTES)
        self._parts = 0
        self.broken: str | None = None

    def next_event(self) -> h11.Event | type[h11.NEED_DATA] | type[h11.PAUSED]:
        """Returns the next event.

        Raises:
            h11.RemoteProtocolError: It breaks a bound, or is no HTTP.
        """
        event = super().next_event()
        if isinstance(event, h11.Request):
            self._parts = 0
            size = sum(len(name) + len(value) + HEADER_EXTRA_BYTES for name, value in event.headers)
            if size + len(event.target) > HEADERS_BYTES:  # which the library forbids of incomplete ones alone
                self._break(f"The headers are larger than {HEADERS_BYTES} bytes.")
            return _with_path(event)
        if isinstance(event, h11.Data):
            self._parts += 1
            if self._parts > PARTS_MAX:
                self._break(f"The body comes in more than {PARTS_MAX} parts.")
        return event

    def _break(self, bound: str) -> NoReturn:
        self.broken = bound
        raise h11.RemoteProtocolError(bound)


class ImpatientProtocol(H11Protocol):
    """HTTP/1.1 whose clients must finish their headers in time and read their answers at a lowest rate."""

    headers_s = HEADERS_S
    stall_s = STALL_S
    _headers_timer: asyncio.TimerHandle | None = None
    _stall_timer: asyncio.TimerHandle | None = None

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.conn: BoundedConnection = BoundedConnection()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as uvicorn's own
        """Starts the time for the first request's headers."""
        super().connection_made(transport)
        self._await_headers()

    def connection_lost(self, exc: Exception | None) -> None:
        """Ends all timers."""
        self._headers_timer = _cancelled(self._headers_timer)
        self._stall_timer = _cancelled(self._stall_timer)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Starts the time for headers at their first byte, and ends it with their last."""
        if not self._is_answering():
            self._await_headers()
        super().data_received(data)
        if self._is_answering():
            self._headers_timer = _cancelled(self._headers_timer)

    def pause_writing(self) -> None:
        """Watches a client that does not read."""
        super().pause_writing()
        if self._stall_timer is None:
            self._await_reader()

    def resume_writing(self) -> None:
        """Ends that watch."""
        super().resume_writing()
        self._stall_timer = _cancelled(self._stall_timer)

    def _is_answering(self) -> bool:
        """Returns whether a request's headers have arrived and its answer is not complete."""
        return self.cycle is not None and not self.cycle.response_complete

    def _await_headers(self) -> None:
        if self._headers_timer is None:
            self._headers_timer = self.loop.call_later(self.headers_s, self._cut_headers)

    def _cut_headers(self) -> None:
        """Closes the connection; a request that was begun is answered first."""
        self._headers_timer = None
        if self.transport.is_closing():
            return
        if self.conn.our_state is h11.IDLE and self.conn.trailing_data[0]:
            detail = f"the headers took longer than {self.headers_s:g} s"
            self._refuse(ProblemDetails("request-timeout", detail))
        self.transport.close()

    def send_400_response(self, msg: str) -> None:
        """Answers bytes that are no HTTP with a problem, unless an answer is under way, and ends the connection."""
        if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
            self._refuse(ProblemDetails("bad-request", f"{self.conn.broken or msg} The connection is closed."))
        self.transport.close()

    def _should_upgrade(self) -> bool:
        return False  # a request for WebSocket is answered as the request it is

    def _refuse(self, problem: ProblemDetails) -> None:
        """Answers a request that the application never saw."""
        body = json.dumps(problem_document(problem, "")).encode()
        headers = [("Content-Type", "application/problem+json"), ("Connection", "close")]
        headers.append(("Content-Length", str(len(body))))
        head = h11.Response(status_code=problem_status(problem), headers=headers)
        for event in (head, h11.Data(data=body), h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")

    def _await_reader(self) -> None:
        unread = self.transport.get_write_buffer_size()
        self._stall_timer = self.loop.call_later(self.stall_s, self._cut_reader, unread)

    def _cut_reader(self, unread: int) -> None:
        """Cuts the connection of a client that has read too little since; else looks again later."""
        if unread - self.transport.get_write_buffer_size() < READ_RATE_MIN_B_S * self.stall_s:
            self.transport.abort()
        else:
            self._await_reader()


class DrainingServer(uvicorn.Server):
    """A server that ends in order.

    Args:
        config: Settings of uvicorn.
        drain: Called at the first signal; the server ends when it returns.
    """

    def __init__(self, config: uvicorn.Config, drain: Callable[[], Awaitable[None]]) -> None:
        super().__init__(config)
        self._drain = drain
        self._is_asked_to_end = False
        self._draining: asyncio.Task[None] | None = None

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Asks for the end; asked again, ends at once."""
        self.should_exit = self.force_exit = self._is_asked_to_end
        self._is_asked_to_end = True

    async def on_tick(self, counter: int) -> bool:
        """Begins to drain once asked to end, ten times a second."""
        if self._is_asked_to_end and self._draining is None:
            self._draining = asyncio.create_task(self._drain_and_exit())
        return await super().on_tick(counter)

    async def _drain_and_exit(self) -> None:
        try:
            await self._drain()
        finally:
            self.should_exit = True


def server_config(app: Callable[..., object], host: str, port: int, proxies: Sequence[str] = ()) -> uvicorn.Config:
    """Returns uvicorn's settings for the service.

    Args:
        app: The application.
        host: Address to listen on.
        port: Port to listen on.
        proxies: Addresses and networks whose `X-Forwarded-For` and `-Proto` are believed.
    """
    return uvicorn.Config(
        app,  # type: ignore[arg-type]  # an ASGI application
        host=host,
        port=port,
        http=ImpatientProtocol,
        ws="none",
        log_config=None,  # `api.logs` has configured it
        access_log=False,
        proxy_headers=bool(proxies),  # by default the library believes everybody on this machine
        forwarded_allow_ips=list(proxies),
        server_header=False,
        timeout_keep_alive=int(KEEP_ALIVE_S),
        timeout_graceful_shutdown=ANSWERS_S,
    )


def _with_path(request: h11.Request) -> h11.Request:
    """Returns a request whose target is a path: of an absolute URI, whose authority takes the place of `Host`.

    RFC 9112, section 3.2.2.
    """
    found = ABSOLUTE_TARGET.fullmatch(request.target)
    if found is None:
        return request
    headers = [(name, value) for name, value in request.headers if name != b"host"]
    return h11.Request(
        method=request.method,
        target=(found["path"] or b"/") + (found["query"] or b""),
        headers=[(b"host", found["host"]), *headers],
        http_version=request.http_version,
    )


def _cancelled(timer: asyncio.TimerHandle | None) -> None:
    if timer is not None:
        timer.cancel()
